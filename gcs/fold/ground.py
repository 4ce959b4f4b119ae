"""The ground as a plane, and how it looks to a camera that takes it for level.

Tracks and reports are compared on the level plane z = z_0. A place (p, z) on the slope is seen from a camera at c where
the line of sight meets that plane:

    p_0 = c + (p − c) (c_z − z_0) / (c_z − z)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ground", "Source"]

FloatArray = NDArray[np.float64]

LEAST_HEIGHT_M = 2.0
"""A camera is at least so high above what it sees; nearer than that no line of sight is told from another."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """What one source makes of the ground's height."""

    name: str
    z: float
    """At the plane's point, metres."""
    std_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The plane that the vehicles drive on."""

    at: FloatArray
    """(2,) a point on it, east and north, metres."""
    z: float
    """Its height there, metres."""
    slope: FloatArray
    """(2,) rise per metre east and north."""
    std_m: float
    """1σ of ``z``."""
    sources: tuple[Source, ...] = ()

    def height_at(self, p_enu: FloatArray) -> FloatArray:
        """Heights (...,) at places (..., 2 or 3)."""
        return np.asarray(self.z + (p_enu[..., :2] - self.at) @ self.slope)

    def seen_on_level(self, p_enu: FloatArray, camera_enu: FloatArray) -> FloatArray:
        """Where places on the ground appear on the level plane.

        Args:
            p_enu: (k, 3) metres; their own heights are not used.
            camera_enu: (3,) or (k, 3) the camera.

        Returns:
            (k, 3) with the height of the plane's point.
        """
        c_z = camera_enu[..., 2]
        share = (c_z - self.z) / np.maximum(c_z - self.height_at(p_enu), LEAST_HEIGHT_M)
        level = camera_enu[..., :2] + (p_enu[:, :2] - camera_enu[..., :2]) * share[:, None]
        return np.column_stack([level, np.full(len(level), self.z)])

    def below_level(self, level_enu: FloatArray, camera_enu: FloatArray) -> FloatArray:
        """Places (k, 3) on the ground that appear at places (k, 3) on the level plane, from a camera at (3,).

        Where a line of sight c + λ (p_0 − c) meets the slope,

            λ = (c_z − z(c)) / (c_z − z_0 + s·(p_0 − c))
        """
        to = level_enu - camera_enu
        above = float(camera_enu[2] - self.height_at(camera_enu))
        falls = np.maximum(self.slope @ to[:, :2].T - to[:, 2], LEAST_HEIGHT_M)
        return np.asarray(camera_enu + to * (above / falls)[:, None])
