"""Pick of the operator: a vehicle, or a box that has no name."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.snapshot import Box, Snapshot, VehicleRow

Pick = tuple[int, int]
"""System id of a vehicle, or 0; track id of a box without a name, or 0."""


def picked_box(snapshot: Snapshot, selected: int, track: int) -> Box | None:
    """The box of the picked vehicle, or the picked box itself; None when there is none in this frame."""
    if selected:
        return next((box for box in snapshot.boxes if box.system_id == selected), None)
    return next((box for box in snapshot.boxes if track and box.track_id == track), None)


def beside(snapshot: Snapshot, vehicles: Iterable[VehicleRow], pick: Pick, steps: int) -> Pick:
    """The pick that many steps further: through the vehicles as the table has them, then through unnamed boxes."""
    choice = [(row.system_id, 0) for row in vehicles]
    choice += [(0, track) for track in sorted(box.track_id for box in snapshot.boxes if not box.system_id) if track]
    if not choice:
        return pick
    if pick not in choice:
        return choice[0 if steps > 0 else -1]
    return choice[(choice.index(pick) + steps) % len(choice)]


def followed(snapshot: Snapshot, pick: Pick) -> Pick:
    """The pick, as the vehicle once the picked box has a name."""
    box = picked_box(snapshot, 0, pick[1])
    return pick if box is None or not box.system_id else (box.system_id, 0)
