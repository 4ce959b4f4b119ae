"""Summary of a flight for a report, added up from its snapshots in memory that does not grow with it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.certainty import CONFIRMED
from gcs.health.alarm_history import AlarmSpan
from gcs.mission.mission import Mission
from gcs.report.rollcall import RollCall
from gcs.snapshot import Box, Event, Snapshot, VehicleRow
from mavlink.geodesy import LocalFrame

FloatArray = NDArray[np.float64]

MAX_PARTS: Final = 400
"""Most parts of a flight's time: more than a page shows side by side."""
FRAMES_A_PART: Final = 3
"""Least number of frames in a part, on average: a part without a frame looks like one without a name."""
MAX_CHANGES: Final = 20
LONGEST_STEP_US: Final = 1_000_000
"""Longest time for which a frame's names are taken to hold while no other is looked at."""


@dataclass(slots=True)
class Spread:
    """Mean, least and greatest of values that come one by one; NaN while there is none."""

    count: int = 0
    total: float = 0.0
    least: float = math.nan
    most: float = math.nan

    def add(self, value: float) -> None:
        """Take in a value; one that is unknown or infinite counts for nothing."""
        if math.isfinite(value):
            self.count, self.total = self.count + 1, self.total + value
            self.least, self.most = float(np.fmin(self.least, value)), float(np.fmax(self.most, value))

    @property
    def mean(self) -> float:
        """Mean of all values; NaN without any."""
        return self.total / self.count if self.count else math.nan


@dataclass(slots=True, kw_only=True, eq=False)
class VehicleRecord:
    """One vehicle, in n parts of the flight's time; NaN where there is nothing."""

    system_id: int
    name: str
    confidence: FloatArray
    """(n,) least confidence of its name."""
    in_view: NDArray[np.bool_]
    """(n,) whether it reported to be in the picture."""
    reported: FloatArray
    """(n, 2) east, north, m, where it reported to be, about the first origin of the flight."""
    seen: FloatArray
    """(n, 2) where its box was on the ground."""
    named: Spread = field(default_factory=Spread)
    """Confidence of its name, box by box."""
    residual_m: Spread = field(default_factory=Spread)
    """Distance from its box to its report, m, box by box."""
    std_m: Spread = field(default_factory=Spread)
    """1σ of its position, moment by moment while positions come: what is extrapolated over a silence is none."""
    loss: Spread = field(default_factory=Spread)
    """Share of its packets that were lost, moment by moment."""
    fixes: Counter[str] = field(default_factory=Counter)
    """Moments by the receiver's fix."""
    runners_up: Counter[str] = field(default_factory=Counter)
    """Frames by who else it might have been."""
    named_us: int = 0
    """Time for which its box had its name: from each such frame to the next one, ``LONGEST_STEP_US`` at most."""
    sure_us: int = 0
    """Frame in which its name was confirmed first, 0 never."""
    changes: list[tuple[int, int, int]] = field(default_factory=list)
    """Time, Unix µs, and the tracks that had its name before and after."""
    changed: int = 0
    """Number of times that another track got its name."""
    track_id: int = 0

    @classmethod
    def empty(cls, system_id: int, name: str, parts: int) -> VehicleRecord:
        """Record of a vehicle of which nothing is known yet."""
        reported, seen = np.full((2, parts, 2), np.nan)
        return cls(
            system_id=system_id,
            name=name,
            confidence=np.full(parts, np.nan),
            in_view=np.zeros(parts, dtype=np.bool_),
            reported=reported,
            seen=seen,
        )


class FlightSummary:
    """Adds up the snapshots of a whole flight, with frames and without, which come in order of time.

    Args:
        start_us: when the flight began, Unix µs.
        stop_us: when it ended.
        frame_s: usual time between frames; between moments, where there are none.

    Attributes:
        name_of: a vehicle's name, by its system id.
        parts: into how many its time is divided.
        alarms: of flight and replay, in order of their coming.
        events: warnings, what the operator did and marked, in order of time.
    """

    def __init__(self, mission: Mission, start_us: int, stop_us: int, frame_s: float) -> None:
        self.start_us, self.stop_us = start_us, max(stop_us, start_us + 1)
        self.parts = min(max(int(self.span_s / (FRAMES_A_PART * frame_s)), 1), MAX_PARTS)
        self.name_of = mission.name_of
        self.rollcall = RollCall(mission)
        self.vehicles = {i: VehicleRecord.empty(i, mission.name_of(i), self.parts) for i in mission.ugv_ids}
        self.uav: VehicleRecord | None = None
        self.alarms: Sequence[AlarmSpan] = ()
        self.events: Sequence[Event] = ()
        self._origin: LocalFrame | None = None
        self._looked_us = 0
        self._named: set[int] = set()

    @property
    def span_s(self) -> float:
        """Duration of the flight, s."""
        return (self.stop_us - self.start_us) * 1e-6

    def part_of(self, t_us: int) -> int:
        """Index of the part of the flight's time that a moment is in."""
        share = (t_us - self.start_us) / (self.stop_us - self.start_us)
        return min(max(int(share * self.parts), 0), self.parts - 1)

    def add(self, at_us: int, snapshot: Snapshot) -> None:
        """Take in what is known at the next moment of the flight, Unix µs."""
        frames = self.rollcall.frames
        self.rollcall.add(snapshot, at_us)
        part = self.part_of(at_us)
        self._origin = self._origin or snapshot.origin
        for row in snapshot.vehicles:
            if row.role == "uav":
                self.uav = self.uav or VehicleRecord.empty(row.system_id, row.name, self.parts)
                self._add_report(self.uav, part, row, snapshot.origin)
            elif row.system_id in self.vehicles:
                self._add_report(self.vehicles[row.system_id], part, row, snapshot.origin)
        if self.rollcall.frames == frames:
            return
        step_us = min(at_us - self._looked_us, LONGEST_STEP_US) if self._looked_us else 0
        for system_id in self._named:
            self.vehicles[system_id].named_us += step_us
        self._looked_us, self._named = at_us, set()
        for box in snapshot.new_boxes:
            if box.system_id not in self.vehicles:
                continue
            if not box.coasting or box.in_turn:
                self._named.add(box.system_id)
            if not box.coasting:
                self._add_box(self.vehicles[box.system_id], at_us, box, snapshot)

    def set_reports(self, alarms: Sequence[AlarmSpan], events: Iterable[Event]) -> None:
        """Take in what was reported: every alarm, every event."""
        events = sorted(events, key=lambda event: event.t_us)
        coming = {(span.alarm.kind, span.alarm.system_id, span.alarm.text) for span in alarms}
        self.rollcall.set_reports(alarms, events)
        self.alarms = alarms
        self.events = [
            event
            for event in events
            if event.kind in ("mark", "operator")
            or (event.level != "info" and (event.kind, event.system_id, event.text) not in coming)
        ]

    def _add_box(self, vehicle: VehicleRecord, at_us: int, box: Box, snapshot: Snapshot) -> None:
        part = self.part_of(at_us)
        vehicle.named.add(box.confidence)
        vehicle.residual_m.add(box.residual_m)
        if box.confidence >= CONFIRMED:
            vehicle.sure_us = vehicle.sure_us or snapshot.t_us
        if box.runner_up:
            vehicle.runners_up[snapshot.name_of(box.runner_up)] += 1
        if math.isnan(vehicle.seen[part, 0]):
            vehicle.seen[part] = self._place(box.p_enu, snapshot.origin)
        if vehicle.track_id not in (0, box.track_id):
            vehicle.changed += 1
            if len(vehicle.changes) < MAX_CHANGES:
                vehicle.changes.append((at_us, vehicle.track_id, box.track_id))
        vehicle.track_id = box.track_id

    def _add_report(self, vehicle: VehicleRecord, part: int, row: VehicleRow, origin: LocalFrame | None) -> None:
        vehicle.in_view[part] |= bool(row.in_view)
        if row.standing in ("confirmed", "tentative"):
            vehicle.confidence[part] = np.fmin(vehicle.confidence[part], row.confidence)
        if row.position_state == "ok":
            vehicle.std_m.add(row.std_m)
        vehicle.loss.add(row.loss)
        vehicle.fixes[row.fix or "no fix told"] += 1
        if row.position_state == "ok" and math.isnan(vehicle.reported[part, 0]):
            vehicle.reported[part] = self._place(row.p_enu, origin)

    def _place(self, p_enu: FloatArray, origin: LocalFrame | None) -> FloatArray:
        """(2,) about the first origin: it moves when the UAV turns out to be elsewhere."""
        if origin is None or self._origin is None or origin == self._origin or not np.isfinite(p_enu).all():
            return p_enu[:2]
        return np.asarray(self._origin.to_enu(*origin.to_geodetic(p_enu)), dtype=np.float64)[:2]
