"""The place in the picture where a vehicle should be by its report, in words."""

from __future__ import annotations

import math
from typing import Final

from gcs.health.heard import is_heard
from gcs.health.vehicle_alarms import CONTRADICTED, DOUBTED
from gcs.report.box_shapes import drawable
from gcs.snapshot import Box, Snapshot, VehicleRow
from gcs.tui.draw.format import as_far_as_known

NEVER_HEARD: Final = "never heard"
PLACES: Final = (("upper left", "top", "upper right"), ("left", "", "right"), ("lower left", "bottom", "lower right"))
"""Thirds of the picture, from its top left."""


def expected_place(snapshot: Snapshot, row: VehicleRow) -> str:
    """The expected place of a vehicle without a box, by its report, and whether the picture shows that place."""
    if why := _not_known(snapshot, row):
        return f"not known: {why}"
    if row.expected_px is None:
        return "behind the camera: the picture does not show it"
    x, y = row.expected_px
    across = "left" if x < 0 else "right" if x >= snapshot.width else ""
    along = "above" if y < 0 else "below" if y >= snapshot.height else ""
    if across or along:
        away = math.hypot(max(-x, x - snapshot.width, 0.0), max(-y, y - snapshot.height, 0.0))
        side = " and ".join(word for word in (along, across) if word) + " of" * bool(across)
        return f"{side} the picture, {away:.0f} px outside"
    place = "in the middle of the picture"
    column, third = min(int(3 * x / snapshot.width), 2), min(int(3 * y / snapshot.height), 2)
    if (column, third) != (1, 1):
        place = f"in the picture at the {PLACES[third][column]}"
    if row.standing == "no new frame":
        return f"{place}, of which there is no new frame"
    there = next((box for box in snapshot.boxes if drawable(box) and _covers(box, x, y)), None)
    if there is None:
        return f"{place}, where no box is"
    if there.system_id == row.system_id:
        return f"{place}, where its box is"
    return f"{place}, where {snapshot.name_of(there.system_id) if there.system_id else f'track {there.track_id}'} is"


def _not_known(snapshot: Snapshot, row: VehicleRow) -> str:
    """Reason why nobody knows where the picture should show a vehicle, empty for none."""
    if row.position_state not in ("ok", "stale"):
        return "it has no usable position" if is_heard(row) else as_far_as_known(snapshot, NEVER_HEARD)
    if row.system_id in snapshot.conflicts:
        return CONTRADICTED
    if row.doubted_for:
        return DOUBTED
    return "the camera's pose is unknown" if snapshot.pose == "unknown" else ""


def _covers(box: Box, x: float, y: float) -> bool:
    """Tell whether a place is within a box's length of its middle."""
    return math.hypot(box.cx - x, box.cy - y) <= max(box.w, box.h)
