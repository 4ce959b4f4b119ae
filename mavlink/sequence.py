"""Packets missing by their sequence numbers."""

from __future__ import annotations

__all__ = ["SequenceLoss"]

_MEMORY = 400.0  # packets after which old ones count half
_LATE = 128  # steps forward from here on are really steps back: a packet that was overtaken
_CHANNELS = 32


class SequenceLoss:
    """Share of packets lost lately; every sender counts its packets per channel, modulo 256."""

    __slots__ = ("_expected", "_last", "_received")

    def __init__(self) -> None:
        self._last: dict[tuple[int, int], int] = {}
        self._expected = 0.0
        self._received = 0.0

    def take(self, link: int, component_id: int, seq: int) -> None:
        """Counts one packet."""
        key = (link, component_id)
        last = self._last.get(key)
        if last is None and len(self._last) >= _CHANNELS:
            return
        step = 1 if last is None else (seq - last) & 0xFF
        self._received += 1.0
        if step == 0 or step >= _LATE:
            self._expected += 1.0 if step == 0 else 0.0
            return
        self._last[key] = seq
        self._expected += step
        if self._expected > _MEMORY:
            self._expected *= 0.5
            self._received *= 0.5

    @property
    def share(self) -> float:
        """0 nothing lost .. 1 everything."""
        return max(0.0, 1.0 - self._received / self._expected) if self._expected > 0.0 else 0.0
