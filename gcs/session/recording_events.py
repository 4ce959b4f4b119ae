"""Events about the recording for the operator: each fault once, and its end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

from gcs.health.station_alarms import STALLED_S
from gcs.snapshot import Event, Level
from infra.files.record_state import RecordState
from infra.reporting import ReportGrowth

__all__ = ["RecordingEvents"]

SLOW_S = 2.0
"""A disk that has not confirmed for so long is slow."""


class RecordingEvents:
    """Compares the states of the files with their previous ones."""

    def __init__(self) -> None:
        self._previous: dict[str, RecordState] = {}
        self._slow: set[str] = set()
        self._lost: defaultdict[str, ReportGrowth] = defaultdict(ReportGrowth)

    def update(self, t_us: int, states: Mapping[str, RecordState]) -> tuple[Event, ...]:
        """Events since the last call; ``states`` by what the operator calls the files."""
        events = []
        for name, state in states.items():
            previous = self._previous.get(name, RecordState(name=state.name))
            for level, text in self._changes(name, previous, state):
                events.append(Event(t_us=t_us, level=level, kind="recording", text=f"{name}: {text}"))
            self._previous[name] = state
        return tuple(events)

    def _changes(self, name: str, previous: RecordState, state: RecordState) -> Iterator[tuple[Level, str]]:
        if state.faults > previous.faults or (state.failing_s and state.reason != previous.reason):
            yield "alarm", f"cannot be written{state.because}; kept in memory until it can"
        if state.failing_s == 0 and (previous.failing_s > 0 or state.faults > previous.faults):
            goes_on = f", goes on in {state.name}" if state.name != previous.name else ""
            yield "info", f"written again{goes_on}"
        if self._lost[name].due(state.lost):
            yield "alarm", f"{state.lost} rows lost{state.because}"
        slow = state.sync_age_s > SLOW_S and not state.stalled_s > STALLED_S  # of that there is an alarm, for all files
        if slow != (name in self._slow):
            self._slow ^= {name}
            if slow:
                yield "warning", f"disk is slow: the last {state.sync_age_s:.0f} s would not survive a power cut"
            else:
                yield "info", "disk keeps up again"
