"""The roll call: who was seen, when first, how long and how surely."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.mission.mission import Mission
from gcs.snapshot import Snapshot

__all__ = ["RollCall", "RollCallRow"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RollCallRow:
    """What was seen of one vehicle."""

    system_id: int
    name: str
    first_named_s: float
    """Since the first frame; NaN: never named."""
    boxes: int
    """That got its name."""
    frames_in_view: int
    """In which it reported to be where the camera looks."""
    confidence: float
    """Mean over its boxes; NaN: never named."""


@dataclass(slots=True)
class _Entry:
    first_us: int = 0
    boxes: int = 0
    frames_in_view: int = 0
    confidence: float = 0.0


class RollCall:
    """Adds up snapshots into one row a vehicle."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._entries = {i: _Entry() for i in mission.ugv_ids}
        self._start_us = 0
        self._stop_us = 0
        self.frames = 0
        self.boxes = 0
        self.unnamed = 0
        self.attitude_frames = 0

    def add(self, snapshot: Snapshot) -> None:
        """Take in one frame."""
        self._start_us = self._start_us or snapshot.t_us
        self._stop_us = snapshot.t_us
        self.frames += 1
        self.attitude_frames += snapshot.pose == "known"
        for row in snapshot.vehicles:
            if row.system_id in self._entries and row.in_view:
                self._entries[row.system_id].frames_in_view += 1
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

    @property
    def named(self) -> int:
        """Vehicles that were named at least once."""
        return sum(entry.boxes > 0 for entry in self._entries.values())

    @property
    def span_s(self) -> float:
        """From the first frame to the last."""
        return (self._stop_us - self._start_us) * 1e-6

    def rows(self) -> list[RollCallRow]:
        """One a vehicle, in the mission's order."""
        return [
            RollCallRow(
                system_id=system_id,
                name=self._mission.name_of(system_id),
                first_named_s=(entry.first_us - self._start_us) * 1e-6 if entry.boxes else math.nan,
                boxes=entry.boxes,
                frames_in_view=entry.frames_in_view,
                confidence=entry.confidence / entry.boxes if entry.boxes else math.nan,
            )
            for system_id, entry in self._entries.items()
        ]
