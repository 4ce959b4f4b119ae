"""East-north-up metres to WGS-84, written apart from the program's own geodesy, as its oracle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

A_M = 6378137.0
"""WGS-84: semi-major axis."""
F = 1.0 / 298.257223563
"""WGS-84: flattening."""
E2 = F * (2.0 - F)
"""First eccentricity squared."""


def to_geodetic(
    p_enu: ArrayLike, latitude_deg: float, longitude_deg: float, altitude_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitude and longitude (degrees) and ellipsoidal height (m) of p_enu (..., 3) about an origin."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    N = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    origin = np.array(
        [
            (N + altitude_m) * np.cos(lat) * np.cos(lon),
            (N + altitude_m) * np.cos(lat) * np.sin(lon),
            (N * (1.0 - E2) + altitude_m) * np.sin(lat),
        ]
    )
    R_ecef_enu = np.array(
        [
            [-np.sin(lon), -np.sin(lat) * np.cos(lon), np.cos(lat) * np.cos(lon)],
            [np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat) * np.sin(lon)],
            [0.0, np.cos(lat), np.sin(lat)],
        ]
    )
    ecef = origin + np.asarray(p_enu, dtype=np.float64) @ R_ecef_enu.T
    x, y, z = ecef[..., 0], ecef[..., 1], ecef[..., 2]
    rho = np.hypot(x, y)
    phi = np.arctan2(z, rho * (1.0 - E2))
    for _ in range(6):
        # φ ← atan2(z + e² N(φ) sin φ, ρ)
        phi = np.arctan2(z + E2 * A_M / np.sqrt(1.0 - E2 * np.sin(phi) ** 2) * np.sin(phi), rho)
    height = rho * np.cos(phi) + z * np.sin(phi) - A_M * np.sqrt(1.0 - E2 * np.sin(phi) ** 2)
    return np.degrees(phi), np.degrees(np.arctan2(y, x)), height
