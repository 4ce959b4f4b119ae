"""Views of other cameras of a flight, beside one's snapshot: their aircraft, footprints, and who is named there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import NAMED, Snapshot, VehicleRow


def with_elsewhere(snapshot: Snapshot, others: Iterable[tuple[str, Snapshot]]) -> Snapshot:
    """A camera's snapshot with what others see."""
    elsewhere: dict[int, tuple[str, ...]] = {}
    aircraft, footprints = list[VehicleRow](), list[NDArray[np.float64]]()
    for name, theirs in others:
        for row in theirs.vehicles:
            if row.role == "ugv" and row.standing in NAMED:
                elsewhere[row.system_id] = (*elsewhere.get(row.system_id, ()), name)
        aircraft.append(replace(theirs.vehicles[0], p_enu=_moved(theirs.vehicles[0].p_enu, theirs, snapshot)))
        if theirs.footprint_enu is not None:
            corners = np.column_stack([theirs.footprint_enu, np.zeros(len(theirs.footprint_enu))])
            footprints.append(_moved(corners, theirs, snapshot)[:, :2])
    uav, *rest = (replace(row, elsewhere=elsewhere.get(row.system_id, ())) for row in snapshot.vehicles)
    return replace(snapshot, vehicles=(uav, *aircraft, *rest), footprints_elsewhere=tuple(footprints))


def _moved(p_enu: NDArray[np.float64], of: Snapshot, into: Snapshot) -> NDArray[np.float64]:
    """Places (..., 3) of one camera's snapshot in the frame of another's; NaN while one of them has none."""
    if of.origin is None or into.origin is None:
        return np.full_like(p_enu, np.nan)
    return into.origin.to_enu(*of.origin.to_geodetic(p_enu))
