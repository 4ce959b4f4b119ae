"""Sequence numbers: packets missing by them, and senders told apart by them."""

from __future__ import annotations

__all__ = ["SequenceLoss", "SequenceRuns"]

_LATE = 128  # steps forward from here on are really steps back: a packet that was overtaken
_CHANNELS = 32
_AHEAD, _BEHIND = 16, 8  # steps that still continue a run: losses, and packets that were overtaken
_RUN_US = 3_000_000
_RUNS = 4


class SequenceLoss:
    """Share of packets lost lately; every sender counts its packets per channel, modulo 256.

    Args:
        memory: packets after which old ones count half.
    """

    __slots__ = ("_last", "_memory", "expected", "received")

    def __init__(self, memory: float = 400.0) -> None:
        self._memory = memory
        self._last: dict[tuple[int, int], int] = {}
        self.expected = 0.0
        """Packets sent lately, by their numbers; old ones count less."""
        self.received = 0.0

    def take(self, link: int, component_id: int, seq: int) -> None:
        """Counts one packet."""
        key = (link, component_id)
        last = self._last.get(key)
        if last is None and len(self._last) >= _CHANNELS:
            return
        step = 1 if last is None else (seq - last) & 0xFF
        self.received += 1.0
        if step == 0 or step >= _LATE:
            self.expected += 1.0 if step == 0 else 0.0
            return
        self._last[key] = seq
        self.expected += step
        if self.expected > self._memory:
            self.expected *= 0.5
            self.received *= 0.5

    @property
    def share(self) -> float:
        """0 nothing lost .. 1 everything."""
        return max(0.0, 1.0 - self.received / self.expected) if self.expected > 0.0 else 0.0


class SequenceRuns:
    """Which of several counters on one channel a packet belongs to: two senders there count past each other."""

    __slots__ = ("_next", "_runs")

    def __init__(self) -> None:
        self._runs: list[list[int]] = []  # number, last sequence number, Unix µs of the last packet
        self._next = 0

    def take(self, seq: int, t_us: int) -> int:
        """Number of the run that this packet continues, a new one when it continues none."""
        best, best_step = None, _AHEAD + _BEHIND
        for run in self._runs:
            step = (seq - run[1] + _BEHIND) & 0xFF  # 0 .. _BEHIND + _AHEAD: continues the run
            step = abs(step - _BEHIND - 1) if step <= _BEHIND + _AHEAD else 0x100
            if step < best_step and abs(t_us - run[2]) < _RUN_US:
                best, best_step = run, step
                if step == 0:
                    break
        if best is None:
            return self._begin(seq, t_us)
        if (seq - best[1]) & 0xFF < _LATE:
            best[1] = seq
        best[2] = t_us
        return best[0]

    def _begin(self, seq: int, t_us: int) -> int:
        if len(self._runs) >= _RUNS:
            self._runs.remove(min(self._runs, key=lambda run: run[2]))
        self._next += 1
        self._runs.append([self._next, seq, t_us])
        return self._next
