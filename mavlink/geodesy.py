"""WGS-84 ↔ local east-north-up, and rotations between north-east-down, east-north-up and bodies.

Symbols: ``R_a_b`` maps vectors of b into a. Body: forward-right-down (FRD). Roll φ, pitch θ, yaw ψ turn
north-east-down (NED) into the body in the order z, y, x; yaw is clockwise from north. Quaternions are w, x, y, z.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavlink.errors import GeodesyError

Array = NDArray[np.float64]

_EARTH_RADIUS_M = 6_371_009.0  # mean; good to half a percent anywhere

R_ENU_NED: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Maps NED vectors into ENU, and ENU vectors into NED: it is its own inverse."""
R_ENU_NED.flags.writeable = False


class LocalFrame:
    """East-north-up metres about a fixed point on the WGS-84 ellipsoid.

    Altitudes above sea level may be given instead of ellipsoid heights, in all places alike: the geoid's undulation
    changes by centimetres over the few kilometres that this frame is for, and cancels in differences.

    Args:
        lat_deg: latitude of the origin, −90..90.
        lon_deg: longitude of the origin, −180..180.

    Raises:
        GeodesyError: the origin is not a place on Earth.
    """

    __slots__ = ("_transformer", "alt_m", "lat_deg", "lon_deg")

    def __init__(self, lat_deg: float, lon_deg: float, alt_m: float = 0.0) -> None:
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and math.isfinite(alt_m)):
            raise GeodesyError(f"no such place: latitude {lat_deg}, longitude {lon_deg}, altitude {alt_m}")
        from pyproj import Transformer  # takes 0.1 s to load, and screens are there before the first position

        self.lat_deg = float(lat_deg)
        self.lon_deg = float(lon_deg)
        self.alt_m = float(alt_m)
        self._transformer: Any = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lon_0={self.lon_deg!r} +lat_0={self.lat_deg!r} +h_0={self.alt_m!r}"
        )

    def __repr__(self) -> str:
        return f"LocalFrame({self.lat_deg!r}, {self.lon_deg!r}, {self.alt_m!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LocalFrame) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash((self.lat_deg, self.lon_deg, self.alt_m))

    def to_enu(self, lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> Array:
        """Places to ENU metres.

        Args:
            lat_deg: (...) latitudes.
            lon_deg: (...) longitudes.
            alt_m: (...) altitudes.

        Returns:
            (..., 3) east, north, up. NaN in, NaN out.
        """
        lat, lon, alt = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (lat_deg, lon_deg, alt_m)))
        p_enu = np.stack(self._transformer.transform(lon.copy(), lat.copy(), alt.copy()), axis=-1)
        return np.where(np.isfinite(p_enu), p_enu, np.nan)

    def to_enu_point(self, lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
        """One place to ENU metres: :meth:`to_enu` without the arrays, for packets that come one by one."""
        east, north, up = self._transformer.transform(lon_deg, lat_deg, alt_m)
        return east, north, up

    def to_geodetic(self, p_enu: ArrayLike) -> tuple[Array, Array, Array]:
        """ENU metres to places.

        Args:
            p_enu: (..., 3) east, north, up.

        Returns:
            Latitudes, longitudes in degrees and altitudes in metres, (...) each.
        """
        p = np.asarray(p_enu, dtype=np.float64)
        lon, lat, alt = self._transformer.transform(
            p[..., 0].copy(), p[..., 1].copy(), p[..., 2].copy(), direction="INVERSE"
        )
        lost = ~np.isfinite(np.asarray(lat))
        return tuple(np.where(lost, np.nan, a) for a in (lat, lon, alt))  # type: ignore[return-value]


def separation_m(lat_a_deg: float, lon_a_deg: float, lat_b_deg: float, lon_b_deg: float) -> float:
    """Distance of two places over a spherical Earth, metres; for the question of which country, not of which lane."""
    lat_a, lat_b = math.radians(lat_a_deg), math.radians(lat_b_deg)
    # hav c = hav Δφ + cos φ₁ cos φ₂ hav Δλ
    across = math.sin(0.5 * math.radians(lon_b_deg - lon_a_deg))
    hav = math.sin(0.5 * (lat_b - lat_a)) ** 2 + math.cos(lat_a) * math.cos(lat_b) * across * across
    return 2.0 * _EARTH_RADIUS_M * math.asin(math.sqrt(min(hav, 1.0)))


def wrap_pi(angle: float) -> float:
    """Wrap an angle into [−π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def rotation_from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """R_ned_body (3, 3) of a body with this attitude.

    R = Rz(ψ) Ry(θ) Rx(φ)
    """
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_from_quaternion(q: ArrayLike) -> Array:
    """R (3, 3) of a quaternion w, x, y, z, which need not be normalised; NaN when it is zero."""
    w, x, y, z = (float(v) for v in np.asarray(q, dtype=np.float64))
    n = w * w + x * x + y * y + z * z
    s = 2.0 / n if n > 0.0 else math.nan
    # R = I + s (w [v]× + [v]×²),  v = (x, y, z)
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Unit quaternion w, x, y, z of the same rotation as :func:`rotation_from_euler`."""
    cr, sr = math.cos(roll / 2.0), math.sin(roll / 2.0)
    cp, sp = math.cos(pitch / 2.0), math.sin(pitch / 2.0)
    cy, sy = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternion(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a quaternion, NaN when it is zero. At pitch ±90° only roll ∓ yaw is defined."""
    n = w * w + x * x + y * y + z * z
    if not n > 0.0:
        return math.nan, math.nan, math.nan
    # sin θ = 2 (wy − zx) / n
    sin_pitch = max(-1.0, min(1.0, 2.0 * (w * y - z * x) / n))
    roll = math.atan2(2.0 * (w * x + y * z), n - 2.0 * (x * x + y * y))
    yaw = math.atan2(2.0 * (w * z + x * y), n - 2.0 * (y * y + z * z))
    return roll, math.asin(sin_pitch), yaw
