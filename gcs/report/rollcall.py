"""The roll call: who was seen, when first, how long and how surely."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.mission.mission import Mission
from gcs.snapshot import Snapshot

__all__ = ["RollCall"]


@dataclass(slots=True)
class _Entry:
    first_us: int = 0
    boxes: int = 0
    frames_in_view: int = 0
    confidence: float = 0.0


class RollCall:
    """Adds up snapshots into one line a vehicle."""

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
        for box in snapshot.boxes:
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

    def lines(self) -> list[str]:
        """The table, one line a vehicle."""
        span_s = (self._stop_us - self._start_us) * 1e-6
        lines = [
            f"{'id':>3}  {'name':<12} {'first named':>11} {'boxes':>6} {'of frames in view':>17} {'confidence':>10}"
        ]
        for system_id, entry in self._entries.items():
            name = self._mission.name_of(system_id)
            if not entry.boxes:
                seen = "reported in view, never named" if entry.frames_in_view else "never in view"
                lines.append(f"{system_id:>3}  {name:<12} {seen}")
                continue
            first_s = (entry.first_us - self._start_us) * 1e-6
            share = f"{min(entry.boxes / entry.frames_in_view, 1):.1%}" if entry.frames_in_view else "-"
            mean = entry.confidence / entry.boxes
            lines.append(f"{system_id:>3}  {name:<12} {first_s:>10.1f}s {entry.boxes:>6} {share:>17} {mean:>10.1%}")
        lines.append(
            f"{self.named} of {len(self._entries)} vehicles named; {self.boxes} boxes in {self.frames} frames, "
            f"{self.unnamed} unnamed; {span_s:.1f} s"
        )
        return lines
