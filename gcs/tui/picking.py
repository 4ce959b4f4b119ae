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


def found(vehicles: Iterable[VehicleRow], words: str) -> VehicleRow | None:
    """The vehicle that a part of a name or an id means, None for nobody.

    A whole id or name counts most, then how a name begins, how it ends, and what is in it; of equals, the first one.

    Args:
        vehicles: in the order of the table.
        words: as typed, at least a letter; case does not matter.
    """
    sought = words.casefold()

    def rank(row: VehicleRow) -> int:
        name = row.name.casefold()
        fits = (sought in (str(row.system_id), name), name.startswith(sought), name.endswith(sought), sought in name)
        return fits.index(True)

    meant = [row for row in vehicles if sought == str(row.system_id) or sought in row.name.casefold()]
    return min(meant, key=rank, default=None)


def followed(snapshot: Snapshot, pick: Pick) -> Pick:
    """The pick, as the vehicle once the picked box has a name."""
    box = picked_box(snapshot, 0, pick[1])
    return pick if box is None or not box.system_id else (box.system_id, 0)
