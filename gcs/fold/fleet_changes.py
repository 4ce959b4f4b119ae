"""Changes of the fleet in flight: each counts from one turn of the fold on, in a replay from the same one."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from gcs.mission.fleet_changes import changed, words_of
from gcs.mission.mission import Mission
from gcs.snapshot import Event, FleetChange


class FleetChanges:
    """Holds changes, of the operator or of a recording, until the turn from which on they count: one a turn."""

    def __init__(self) -> None:
        self._waiting: deque[FleetChange] = deque()

    def make(self, change: FleetChange) -> None:
        """Change the fleet with the next turn; one of a recording with the turn that it counted from."""
        self._waiting.append(change)

    def next_due(self, mission: Mission, t_us: int, frame: int, latest_us: int) -> tuple[Mission, list[Event]]:
        """The mission of a turn, and an event where it is another one with it.

        Args:
            mission: until now.
            t_us: what the turn is folded for, Unix µs.
            frame: its frame, or the newest before it.
            latest_us: the latest time of the turns before.
        """
        if not self._waiting:
            return mission, []
        change = self._waiting[0]
        # the first turn later than all before it is the same one in a replay, where frames come late too
        if t_us <= latest_us if not change.t_us else t_us < change.t_us or frame < change.frame:
            return mission, []
        self._waiting.popleft()
        made = replace(change, t_us=change.t_us or t_us, frame=frame)
        try:
            after = changed(mission, made)
        except ValueError as error:
            text = f"the fleet is not changed: {error}"
            return mission, [Event(t_us=t_us, level="warning", kind="operator", text=text, system_id=change.system_id)]
        text = words_of(made, mission, after)
        event = Event(t_us=t_us, level="info", kind="operator", text=text, system_id=change.system_id, change=made)
        return after, [event]
