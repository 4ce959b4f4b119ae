"""The ground, and how it looks to a camera that takes it for level.

Tracks and reports are compared on the level plane z = z_0. A place (p, z) on the slope is seen from a camera at c where
the line of sight meets that plane:

    p_0 = c + (p − c) (c_z − z_0) / (c_z − z)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mavlink.geodesy import LocalFrame

if TYPE_CHECKING:
    from gcs.mission.terrain_file import TerrainFile

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GAP_M, OUTLIER_STDS = 8.0, 3.5
"""Heights that differ by less than the first, metres, or by this many 1σ agree."""
MIN_HEIGHT_M = 2.0
"""Least height of a camera above what it sees, metres; nearer than that no line of sight is told from another."""
SURE_SHARE = 1.4
"""A detector knows vehicles of one size: heights of a camera that differ by more than this factor are too different."""
STEPS = 6
"""Steps of following a line of sight to the ground: on a slope of 10 % seen at 30° each leaves a sixth of the error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSource:
    """Height of the ground by one source."""

    name: str
    z: float
    """Height at the plane's point, metres."""
    std_m: float

    def contradicts(self, z: float, std_m: float) -> bool:
        """Tell whether it cannot be right where another one gives the height z, metres, with a 1σ of ``std_m``."""
        return abs(self.z - z) > max(GAP_M, OUTLIER_STDS * math.hypot(self.std_m, std_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """Heights from a terrain file in a local frame."""

    terrain: TerrainFile
    frame: LocalFrame

    def heights(self, p_enu: FloatArray) -> FloatArray:
        """Heights (k,) of the ground at places (k, 2 or 3), ENU metres in the file's datum; NaN where it has none."""
        level = np.column_stack([p_enu[:, :2], np.zeros(len(p_enu))])
        lat, lon, _ = self.frame.to_geodetic(level)
        return np.asarray(self.terrain.elevations(lat, lon) - self.frame.alt_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundSurface:
    """Surface that the vehicles drive on: a plane, with the relief of a terrain file upon it where there is one."""

    at: FloatArray
    """(2,) a point on it, east and north, metres."""
    z: float
    """Height of the surface there, metres."""
    slope: FloatArray
    """(2,) rise per metre east and north."""
    std_m: float
    """1σ of ``z``."""
    sources: tuple[HeightSource, ...] = ()
    datums_m: tuple[float, ...] = ()
    """Amount by which it is lower if the only source counts from another level, metres."""
    divided: bool = False
    """The vehicles' altitudes contradict each other."""
    relief: Relief | None = None
    bumps: Mapping[int, float] = field(default_factory=dict)
    """Bumps of the ground under each vehicle above all that, metres, by system id."""

    @property
    def other_heights_m(self) -> tuple[float, ...]:
        """Amounts by which the ground is lower than ``z`` if a source that disagrees is right, metres, one for each."""
        others = list(self.datums_m)
        for source in self.sources:
            lower = self.z - source.z
            if all(abs(lower - other) > GAP_M for other in (0.0, *others)):
                others.append(lower)
        return tuple(others)

    def is_doubtful_below(self, camera_z: float) -> bool:
        """Tell whether the sources leave open how far a camera is above the ground, by more than ``SURE_SHARE``."""
        above = camera_z - self.z
        heights = np.maximum([above, *(above + lower for lower in self.other_heights_m)], MIN_HEIGHT_M)
        return bool((np.maximum(heights, heights[0]) > SURE_SHARE * np.minimum(heights, heights[0])).any())

    def height_at(self, p_enu: FloatArray) -> FloatArray:
        """Heights (k,) at places (k, 2 or 3)."""
        plane = np.asarray(self.z + (p_enu[:, :2] - self.at) @ self.slope)
        if self.relief is None or not len(p_enu):
            return plane
        rise = self.relief.heights(np.concatenate([self.at[None], p_enu[:, :2]]))
        return np.asarray(plane + np.nan_to_num(rise[1:] - rise[0]))

    def bumps_under(self, system_id: IntArray) -> FloatArray:
        """Heights (k,) of the ground under vehicles (k,) above what it is at their places otherwise."""
        return np.array([self.bumps.get(i, 0.0) for i in system_id.tolist()], dtype=np.float64)

    def seen_on_level(self, p_enu: FloatArray, system_id: IntArray, camera_enu: FloatArray) -> FloatArray:
        """Places on the level plane where vehicles appear.

        Args:
            p_enu: (k, 3) metres; their own heights are not used.
            system_id: (k,) which they are.
            camera_enu: (3,) or (k, 3) the camera.

        Returns:
            (k, 3) with the height of the plane's point.
        """
        c_z = camera_enu[..., 2]
        z = self.height_at(p_enu) + self.bumps_under(system_id)
        share = (c_z - self.z) / np.maximum(c_z - z, MIN_HEIGHT_M)
        level = np.empty((len(p_enu), 3))
        level[:, :2] = camera_enu[..., :2] + (p_enu[:, :2] - camera_enu[..., :2]) * share[:, None]
        level[:, 2] = self.z
        return level

    def below_level(self, level_enu: FloatArray, camera_enu: FloatArray) -> FloatArray:
        """Places (k, 3) on the ground that appear at places (k, 3) on the level plane, from a camera at (3,)."""
        to = level_enu - camera_enu
        p = level_enu
        for _ in range(STEPS):
            # where the line of sight c + λ (p_0 − c) is as high as the ground at the place found before
            share = (camera_enu[2] - self.height_at(p)) / np.maximum(-to[:, 2], MIN_HEIGHT_M)
            p = camera_enu + to * share[:, None]
        return np.asarray(p)
