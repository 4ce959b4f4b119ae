"""The mission's fences in local metres: their outlines, and how far each vehicle is from breaking one."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.mission.fence import Fence
from gcs.mission.mission import Mission
from gcs.snapshot import VehicleRow
from mavlink.geodesy import LocalFrame

FloatArray = NDArray[np.float64]
CIRCLE_CORNERS = 72
"""Corners of the outline that is drawn of a circle: off by a thousandth of its radius."""


class Fences:
    """The fences of one mission about one origin at a time."""

    def __init__(self, mission: Mission) -> None:
        self._fences = mission.fence
        self._held = [frozenset(fence.vehicles or mission.ugv_ids) for fence in mission.fence]
        self._origin: LocalFrame | None = None
        self.outlines: tuple[FloatArray, ...] = ()
        """(n, 2) ENU metres of each fence, empty before the origin is known."""

    def set_origin(self, origin: LocalFrame | None) -> None:
        """Place the fences about an origin."""
        if origin is not self._origin:
            self._origin = origin
            self.outlines = tuple(_outline(fence, origin) for fence in self._fences) if origin else ()

    def compare(self, rows: tuple[VehicleRow, ...]) -> tuple[VehicleRow, ...]:
        """The fleet table with each vehicle's nearest fence and its distance from it."""
        if not self.outlines:
            return rows
        nearest = (self._nearest(row.system_id, row.p_enu) for row in rows)
        return tuple(
            replace(row, fence=name, fence_m=distance_m) for row, (name, distance_m) in zip(rows, nearest, strict=True)
        )

    def _nearest(self, system_id: int, p_enu: FloatArray) -> tuple[str, float]:
        """The fence that a vehicle at ``p_enu`` (3,) is nearest to break, or breaks most.

        Returns:
            Its name, empty where none holds for the vehicle; and metres on the right side, negative beyond, NaN
            unknown.
        """
        name, least_m = "", math.nan
        for fence, held, outline in zip(self._fences, self._held, self.outlines, strict=False):
            if system_id not in held:
                continue
            if fence.centre is None:
                inside_m = distance_inside(outline, p_enu[:2])
            else:
                inside_m = fence.radius_m - math.dist(outline.mean(axis=0), p_enu[:2])
            right_m = inside_m if fence.keep == "in" else -inside_m
            if not least_m <= right_m:
                name, least_m = fence.name, right_m
        return name, least_m


def distance_inside(corners: FloatArray, p: FloatArray) -> float:
    """Distance of a point (2,) inside of a polygon (n, 2), metres; negative outside, NaN where the point is unknown."""
    if not np.isfinite(p).all():
        return math.nan
    # in single precision: about the point, so that millimetres are left of it
    return float(cv2.pointPolygonTest((corners - p).astype(np.float32), (0.0, 0.0), True))


def _outline(fence: Fence, origin: LocalFrame) -> FloatArray:
    places = fence.polygon if fence.centre is None else (fence.centre,)
    lat_deg, lon_deg = np.array(places, dtype=np.float64).T
    corners = origin.to_enu(lat_deg, lon_deg, origin.alt_m)[:, :2]
    if fence.centre is None:
        return corners
    way = np.linspace(0.0, 2.0 * math.pi, CIRCLE_CORNERS, endpoint=False)
    return corners + fence.radius_m * np.column_stack([np.sin(way), np.cos(way)])
