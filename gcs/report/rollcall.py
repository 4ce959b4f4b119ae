"""The roll call: who was seen, when first, how long and how surely, and of the others why not.

All that counts a flight's frames, boxes, silences and alarms quotes it: a frame counts when the detector looked at it,
silences and alarms are of the whole flight, with frames and without.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from gcs.health.alarm_history import AlarmHistory, AlarmSpan
from gcs.health.heard import is_heard, refused_because
from gcs.mission.mission import Mission
from gcs.snapshot import Event, Snapshot, VehicleRow
from infra.wall_clock import steady_us
from mavlink.state import SILENT_S

Outcome = Literal[
    "named",
    "in view, never named",
    "never where the camera looked",
    "where the camera looked is not known",
    "no frame was looked at",
    "no position",
    "all refused",
    "never heard",
]
"""Outcome for a vehicle."""
_MANY = 0.02
"""Share of frames for which it is worth a remark that nobody knows whether a vehicle was in view."""
WITHOUT_POSITION: Final[frozenset[Outcome]] = frozenset({"no position", "all refused", "never heard"})
"""Outcomes of vehicles whose place was never known while a frame was looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RollCallRow:
    """Row of the roll call: what was seen of one vehicle."""

    system_id: int
    name: str
    first_named_s: float
    """Time of the first name since the first frame that was looked at, s; NaN: never named."""
    boxes: int
    """Number of boxes that got its name."""
    frames_in_view: int
    """Number of frames in which it reported to be where the camera looks, of those that were looked at."""
    frames_unknown: int
    """Number of frames in which its place or the camera's was not known, of those that were looked at."""
    share: float
    """Share of the frames in view in which a box had its name, 0 to 1; NaN: never in view."""
    confidence: float
    """Mean over its boxes; NaN: never named."""
    outcome: Outcome
    why: str
    """Reason for the outcome, plain text, possibly from the air; empty for nothing."""
    longest_silence_s: float
    """Longest time without a position, from the flight's begin to its end."""
    silence_frozen: bool
    """True if one position came over and over in that time."""

    @property
    def first_named(self) -> str:
        """Time from the first frame that was looked at to its first name, ``14.7 s``; ``–``: never named."""
        return _seconds(self.first_named_s) if self.boxes else "–"

    @property
    def remark(self) -> str:
        """Notes for the operator besides the figures, empty for nothing."""
        parts = [] if self.outcome == "named" else [f"{self.outcome}: {self.why}" if self.why else self.outcome]
        if self.longest_silence_s > SILENT_S and self.outcome not in WITHOUT_POSITION:
            lacked = "its position stood still" if self.silence_frozen else "no position"
            parts.append(f"{lacked} for {self.longest_silence_s:.1f} s")
        if self.outcome == "named" and self.frames_unknown > _MANY * (self.frames_unknown + self.frames_in_view):
            parts.append(f"not known whether in view in {self.frames_unknown} frames")
        return "; ".join(parts)


@dataclass(frozen=True, slots=True)
class AlarmCounts:
    """Number of alarms of each level that a flight raised."""

    alarms: int
    warnings: int


def count_alarms(spans: Iterable[AlarmSpan]) -> AlarmCounts:
    """Count the alarms of a flight, each once however long it lasted; what only its replay finds is none of them."""
    levels = [span.alarm.level for span in spans if span.alarm.reported != "now"]
    return AlarmCounts(levels.count("alarm"), levels.count("warning"))


@dataclass(slots=True)
class _Entry:
    first_us: int = 0
    boxes: int = 0
    frames_in_view: int = 0
    frames_in_turn: int = 0
    """Frames in which another one had its turn to be looked at."""
    named_in_view: int = 0
    frames_out_of_view: int = 0
    frames_positioned: int = 0
    confidence: float = 0.0
    heard: bool = False
    positioned: bool = False
    refused: str = ""
    """Reason of the last refusal."""
    waits_for: str = ""
    """Reason why it has no position yet by its own word."""
    placed_s: float = 0.0
    """Time of its last position, since the flight's begin: before its first one it is silent from there."""
    silence_s: float = 0.0
    silence_frozen: bool = False
    frozen: bool = False
    """True if its position has stood still since it was last good."""


class RollCall:
    """Adds up snapshots into one row a vehicle.

    Attributes:
        frames: that were looked at.
        boxes: seen in them.
        unnamed: of these, those without a name.
        attitude_frames: in which the camera's pose was known.
        marks: that the operator made.
        uav_name: name of the aircraft that filmed.
        uav_id: its system id.
        other_views: the same of the flight's further cameras.
    """

    def __init__(self, mission: Mission) -> None:
        self.uav_id = mission.uav.system_id
        self.uav_name = mission.name_of(self.uav_id)
        self.other_views: tuple[RollCall, ...] = ()
        self._names = {i: mission.name_of(i) for i in mission.ugv_ids}
        self._entries = {i: _Entry() for i in mission.ugv_ids}
        self._begin_us: int | None = None
        self._start_us = self._stop_us = self._came = 0
        self._as_flown = True
        self._last_frame = -1
        self._alarms = AlarmHistory()
        self._reported_alarms: AlarmCounts | None = None
        self.frames = self.boxes = self.unnamed = self.attitude_frames = self.marks = 0

    def add(self, snapshot: Snapshot, at_us: int | None = None) -> None:
        """Take in the next snapshot, with a new frame or without; at_us: see :meth:`add_fleet`."""
        self.add_fleet(snapshot, at_us)
        self.add_boxes(snapshot)

    def add_in_flight(self, snapshot: Snapshot) -> None:
        """Take in the next snapshot of a flight that is under way; silences are those of its replay, however late."""
        self.add(snapshot, steady_us(snapshot.now_us))

    def add_fleet(self, snapshot: Snapshot, at_us: int | None = None) -> None:
        """Take in how the fleet is: who is heard and has a position, alarms, marks.

        Args:
            at_us: its time by a clock that nobody sets, µs from any moment on; None: as it is stamped.
        """
        at_us = snapshot.now_us if at_us is None else at_us
        if self._begin_us is None:
            self._begin_us = at_us
        # a frame that was taken before the last moment has ages of its own time, and counts as of that moment
        taken_us = at_us - (snapshot.now_us - snapshot.t_us)
        for row in snapshot.vehicles:
            if row.role == "uav":
                self.uav_name = row.name
            else:
                entry = self._entries.setdefault(row.system_id, _Entry())
                self._names[row.system_id] = row.name
                _watch(entry, row, (taken_us - self._begin_us) * 1e-6)
        self._alarms.add(at_us, snapshot.alarms)
        self.marks += _marks(snapshot.events)

    def add_boxes(self, snapshot: Snapshot) -> None:
        """Take in what is seen, where the snapshot is of a frame that was looked at and did not come before."""
        if snapshot.seen_us != snapshot.t_us or snapshot.frame == self._last_frame:
            return
        self._last_frame = snapshot.frame
        self._start_us = self._start_us or snapshot.t_us
        self._stop_us = snapshot.t_us
        self.frames += 1
        self.attitude_frames += snapshot.pose == "known"
        named = {box.system_id for box in snapshot.new_boxes if not box.coasting}
        waits = {box.system_id for box in snapshot.new_boxes if box.in_turn}  # of whom this frame tells nothing
        for row in snapshot.vehicles:
            if (entry := self._entries.get(row.system_id)) is not None:
                entry.frames_in_turn += row.in_view is True and row.system_id in waits
                entry.frames_in_view += row.in_view is True and row.system_id not in waits
                entry.named_in_view += row.in_view is True and row.system_id in named
                entry.frames_out_of_view += row.in_view is False
                entry.frames_positioned += row.position_state in ("ok", "stale")
        for box in snapshot.new_boxes:
            if box.coasting:
                continue
            self.boxes += 1
            entry = self._entries.get(box.system_id)
            if entry is None:
                self.unnamed += 1
                continue
            entry.first_us = entry.first_us or snapshot.t_us
            entry.boxes += 1
            entry.confidence += box.confidence

    def of(self, uav_id: int) -> RollCall:
        """The roll call of the camera on an aircraft; of the first one, where none is."""
        return next((calls for calls in (self, *self.other_views) if calls.uav_id == uav_id), self)

    def set_frame_count(self, frames: int, *, as_flown: bool = True) -> None:
        """Take in how many frames came, and whether it is known, as of what flew, which of them nobody looked at."""
        self._came, self._as_flown = frames, as_flown

    def set_reports(self, alarms: Iterable[AlarmSpan], events: Iterable[Event]) -> None:
        """Take in the alarms and marks that a recorded flight itself reported, with what its replay finds besides."""
        self._reported_alarms, self.marks = count_alarms(alarms), _marks(events)

    @property
    def alarms(self) -> AlarmCounts:
        """Number of alarms that were raised."""
        return self._reported_alarms or count_alarms(self._alarms.spans)

    @property
    def reports(self) -> str:
        """Numbers of alarms, warnings and marks, in words."""
        counts = {"alarm": self.alarms.alarms, "warning": self.alarms.warnings, "mark": self.marks}
        return ", ".join(f"{count} {what}{'s' * (count != 1)}" for what, count in counts.items())

    @property
    def skipped_frames(self) -> int:
        """Frames that came and of which nothing tells that anybody looked: a machine that cannot keep up skips some."""
        return max(self._came - self.frames, 0)

    @property
    def skipped(self) -> str:
        """Sentence on the frames without boxes, empty for none: boxes of others do not tell a frame without any from
        one skipped."""
        if self._as_flown or not self.skipped_frames:
            return f"{self.skipped_frames} more frames came and were not looked at" if self.skipped_frames else ""
        return f"{self.skipped_frames} more frames have no boxes: nothing was found in them, or nobody looked"

    @property
    def named(self) -> int:
        """Vehicles that were named at least once."""
        return sum(entry.boxes > 0 for entry in self._entries.values())

    @property
    def span_s(self) -> float:
        """Duration from the first frame that was looked at to the last, s."""
        return (self._stop_us - self._start_us) * 1e-6

    @property
    def first_frame_us(self) -> int:
        """Time of the first frame that was looked at, Unix µs, from which ``first_named_s`` counts."""
        return self._start_us

    def rows(self) -> list[RollCallRow]:
        """Return a row for each vehicle, in the mission's order."""
        return [self._row(system_id, entry) for system_id, entry in self._entries.items()]

    def _row(self, system_id: int, entry: _Entry) -> RollCallRow:
        outcome, why = self._outcome(entry)
        return RollCallRow(
            system_id=system_id,
            name=self._names[system_id],
            first_named_s=(entry.first_us - self._start_us) * 1e-6 if entry.boxes else math.nan,
            boxes=entry.boxes,
            frames_in_view=entry.frames_in_view,
            frames_unknown=self._unknown(entry),
            share=entry.named_in_view / entry.frames_in_view if entry.frames_in_view else math.nan,
            confidence=entry.confidence / entry.boxes if entry.boxes else math.nan,
            outcome=outcome,
            why=why,
            longest_silence_s=entry.silence_s,
            silence_frozen=entry.silence_frozen,
        )

    def _outcome(self, entry: _Entry) -> tuple[Outcome, str]:
        if entry.boxes:
            return "named", ""
        if entry.frames_in_view:
            return "in view, never named", f"{entry.frames_in_view} of {self.frames} frames"
        if entry.positioned:
            return self._outcome_out_of_view(entry)
        if entry.refused:
            return "all refused", entry.refused
        return ("no position", entry.waits_for) if entry.heard else ("never heard", "")

    def _unknown(self, entry: _Entry) -> int:
        return self.frames - entry.frames_in_view - entry.frames_in_turn - entry.frames_out_of_view

    def _outcome_out_of_view(self, entry: _Entry) -> tuple[Outcome, str]:
        """Outcome for one that had a position at some time, but was never in view."""
        if not self.frames:
            return "no frame was looked at", ""
        if not entry.frames_positioned:
            return "no position", "in any frame that was looked at"
        if not entry.frames_out_of_view:
            return "where the camera looked is not known", ""
        unknown = self._unknown(entry)
        why = f"its place or the camera's is not known in {unknown} of {self.frames} frames" if unknown else ""
        return "never where the camera looked", why


def _seconds(seconds: float) -> str:
    return f"{seconds:.1f} s"


def _marks(events: Iterable[Event]) -> int:
    return sum(event.kind == "mark" for event in events)


def _watch(entry: _Entry, row: VehicleRow, at_s: float) -> None:
    """Take in how a vehicle is this long after the flight's begin."""
    entry.heard |= is_heard(row)
    entry.positioned |= row.position_state in ("ok", "stale")
    entry.refused = refused_because(row) or entry.refused
    entry.waits_for = row.refused_for or entry.waits_for
    # an age leaps where the wall clock was set: a position that came is not older for that
    entry.placed_s = max(entry.placed_s, at_s - row.position_age_s)
    # in the last moment of a silence the next position has come already, and is of a later time
    entry.frozen = row.frozen or (entry.frozen and row.position_state != "ok")
    if at_s - entry.placed_s > entry.silence_s:
        entry.silence_s, entry.silence_frozen = at_s - entry.placed_s, entry.frozen
