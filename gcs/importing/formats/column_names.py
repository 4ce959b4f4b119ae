"""Columns of anybody's tables: which of ours each is, by its name, and what its numbers are to be multiplied by.

A unit is the end of a name, ``alt_ft``, or stands behind it in brackets, ``altitude (feet)``, ``OSD.height [m]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from infra.plain_text import plain

Floats = NDArray[np.float64]

_NAMES = {
    "lat": ("latitude", "lat_deg", "latitude_deg", "gps.lat", "gps_lat", "osd.latitude", "field.latitude"),
    "lon": (
        *("longitude", "lng", "long", "lon_deg", "longitude_deg", "longtitude", "gps.lon", "gps_lon"),
        *("osd.longitude", "field.longitude"),
    ),
    "alt_m": (
        *("altitude", "alt", "altitude_m", "abs_alt", "ele", "elevation", "altitudeamsl", "altitude_above_sealevel"),
        *("amsl", "alt_amsl", "altitude_amsl", "alt_msl", "msl_alt", "osd.altitude"),
    ),
    "height_m": (
        *("height", "rel_alt", "relative_alt_m", "relative_alt", "altituderelative", "height_above_takeoff"),
        *("osd.height", "ascent"),
    ),
    "hae_m": (
        *("hae", "alt_hae", "altitude_hae", "ellipsoid_height", "height_ellipsoid", "alt_ellipsoid", "field.altitude"),
    ),
    "time": ("timestamp", "utc", "datetime", "custom.updatetime"),
    "time_us": ("t_us", "unix_us", "timestamp_us"),
    "time_ms": ("timestamp_ms",),
    "time_ns": ("timestamp_ns",),
    "time_s": ("unix_s",),
    "elapsed_s": ("t_s", "elapsed"),
    "counted_ms": ("time_millisecond",),
    "speed_mps": ("groundspeed", "ground_speed", "speed", "osd.hspeed"),
    "course_deg": ("bearing", "course", "gps.courseoverground"),
    "std_m": ("h_acc", "h_acc_m", "accuracy"),
    "system_id": ("sysid",),
    "heading_deg": ("heading", "compass_heading"),
    "yaw_deg": ("yaw", "osd.yaw"),
    "pitch_deg": ("pitch", "osd.pitch"),
    "roll_deg": ("roll", "osd.roll"),
    "gimbal_yaw_deg": ("gimbal_yaw", "gimbal_heading", "gimbalyaw", "gimbal.yaw"),
    "gimbal_pitch_deg": ("gimbal_pitch", "gimbalpitch", "gimbal.pitch"),
    "gimbal_roll_deg": ("gimbal_roll", "gimbalroll", "gimbal.roll"),
}
"""Other names of our columns: of QGroundControl, GPSLogger, Airdata, Litchi, ROS's ``rostopic echo -p`` (whose
altitudes count from the ellipsoid), and what reads DJI's own records."""
_MAVLINK = {
    f"global_position_int.{field}": ours
    for field, ours in {
        **{"lat": "lat_e7", "lon": "lon_e7", "alt": "alt_mm", "relative_alt": "height_mm"},
        **{"vx": "vn_cm/s", "vy": "ve_cm/s", "vz": "vd_cm/s"},
    }.items()
}
"""Columns of MAVLink's dump as a table, and ours with their units."""
_ALIASES = {other: ours for ours, others in _NAMES.items() for other in others}
KNOWN = frozenset(_NAMES) | {"frame", "hfov_deg", "vn_mps", "ve_mps", "vd_mps", "id"}
_TO_DEG, _TO_M, _TO_MPS = math.degrees(1.0), 0.3048, 1852.0 / 3600.0
_SCALED = {
    **{"rad": ("_deg", _TO_DEG), "radians": ("_deg", _TO_DEG), "cdeg": ("_deg", 0.01), "e7": ("", 1e-7)},
    **{"deg": ("_deg", 1.0), "degrees": ("_deg", 1.0), "°": ("_deg", 1.0)},
    **{"mm": ("_m", 1e-3), "cm": ("_m", 0.01), "ft": ("_m", _TO_M), "feet": ("_m", _TO_M)},
    **{"m": ("_m", 1.0), "meters": ("_m", 1.0), "metres": ("_m", 1.0)},
    **{"m/s": ("_mps", 1.0), "mps": ("_mps", 1.0), "cm/s": ("_mps", 0.01), "mph": ("_mps", 0.44704)},
    **{"km/h": ("_mps", 1.0 / 3.6), "kmh": ("_mps", 1.0 / 3.6), "kph": ("_mps", 1.0 / 3.6)},
    **{"utc": ("time", 1.0), "local": ("time", 1.0)},
    **{"kn": ("_mps", _TO_MPS), "kt": ("_mps", _TO_MPS), "knots": ("_mps", _TO_MPS)},
}
"""Units, the ending that a column of ours of that kind has, and the factor."""
_IN_BRACKETS = re.compile(r"[ _]*[\[(]([^\])]{1,20})[\])]$")
_AROUND = " \t\r\n\"'\ufeff#%"
_HIGHEST_M = 20_000.0
_MIN_E7 = 1e5
"""Coordinates in 1e-7 degrees; smaller ones would be on the equator."""
_TURN_DEG, _TURN_RAD = 360.5, 2.0 * math.pi + 0.01
_BULK_SHARE = 0.9
"""Share of numbers that are no larger: a few may be damaged, or say that nothing is known."""
_LEVEL_RAD = 0.05
"""Bound below which all angles are too small for their unit to matter."""
_UNNAMED = {
    ("roll", "pitch", "yaw", "heading"): 0.6,
    ("gimbal_roll", "gimbal_pitch", "gimbal_yaw"): 0.5 * math.pi + 0.01,
}
"""Angles whose names tell no unit, and a roll or pitch above which they can be no radians of something that flies."""
_ELLIPSOID = "heights above the ellipsoid are not taken for altitudes, which are up to 100 m apart"
_BY_LITCHI = "altitude counts from the take-off, as ascent stands beside it"


def column_of(cell: str) -> tuple[str, float]:
    """Our name of a column, and what its numbers are to be multiplied by."""
    name = _lower(cell)
    name = _MAVLINK.get(name, name)
    if name in _ALIASES or name in KNOWN:
        return _ALIASES.get(name, name), 1.0
    base, _, unit = name.rpartition("_")
    ending, factor = _SCALED.get(unit, ("", 0.0))
    ours = _ALIASES.get(base, base if base in KNOWN else base + ending)
    # a unit of something else is a column of something else
    of_angle = ending == "_deg" and ours in ("lat", "lon")
    if factor and ours in KNOWN and (ours.endswith(ending) or of_angle):
        return ours, factor
    return name, 1.0


def _lower(cell: str) -> str:
    name = _IN_BRACKETS.sub(r"_\1", cell.strip(_AROUND)).lower()
    return name.replace(" ", "_")


def in_our_units(
    columns: dict[str, Floats], cells: Sequence[str], where: str
) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """Columns in degrees and metres, and what was assumed.

    Args:
        columns: (n,) each, by our names.
        cells: names as they stand in the table.

    Raises:
        ImportFileError: angles may be degrees or radians, or numbers are none of their unit.
    """
    found, assumed = dict(columns), list[str]()
    given = {column_of(cell)[0]: _lower(cell) for cell in reversed(cells)}
    if "hae_m" in found:
        assumed.append(_ELLIPSOID)
    if given.get("height_m", "").startswith("ascent") and "alt_m" in found:
        found["height_m"] = found.pop("alt_m")
        assumed.append(_BY_LITCHI)

    def scaled(of: tuple[str, ...], least: float, factor: float, meaning: str, share: float = _BULK_SHARE) -> bool:
        there = [name for name in of if name in found and np.isfinite(found[name]).any()]
        large = any(_most(found[name], share) > least for name in there)
        if large:
            found.update({name: found[name] * factor for name in there})
            assumed.append(f"{', '.join(there)} are {meaning} by their size")
        return large

    if scaled(("lat", "lon"), _MIN_E7, 1e-7, "degrees × 1e7"):
        # so MAVLink has them
        scaled(("alt_m", "height_m"), _HIGHEST_M, 1e-3, "millimetres")
    _check_named(found, cells, where)
    for name in ("heading_deg", "course_deg"):
        # some rows may have a number that stands for an unknown one
        scaled((name,), _TURN_DEG, 0.01, "centidegrees", 0.5)
    for group in _UNNAMED:
        scaled(tuple(f"{name}_deg" for name in group if name != "heading"), _TURN_DEG, 0.01, "centidegrees")
    _check_unnamed(found, {_lower(cell) for cell in cells}, where)
    return found, tuple(assumed)


def _check_named(found: dict[str, Floats], cells: Sequence[str], where: str) -> None:
    """See that numbers can be of the unit that the name of their column tells.

    Raises:
        ImportFileError: they cannot.
    """
    for cell in cells:
        ours, factor = column_of(cell)
        most = _most(found[ours]) if ours in found else 0.0
        if factor == _TO_DEG and most > math.degrees(_TURN_RAD):
            raise ImportFileError(
                f"{where}: {_shown(cell)} goes up to {most / factor:.4g}: no radians within a turn; are they …_deg?"
            )
        if ours in ("alt_m", "height_m") and most > _HIGHEST_M:
            reason = f"{_shown(cell)} goes up to {most / factor:.0f}, which is {most / 1000.0:.0f} km"
            raise ImportFileError(f"{where}: {reason}: tell the unit in its name, as …_m, …_cm, …_mm or …_ft")


def _check_unnamed(found: dict[str, Floats], names: set[str], where: str) -> None:
    """See that angles whose names tell no unit are degrees.

    Raises:
        ImportFileError: they may be radians.
    """
    for group, tilted in _UNNAMED.items():
        bare = [name for name in group if name in names and np.isfinite(found[f"{name}_deg"]).any()]
        most = {name: float(np.nanmax(np.abs(found[f"{name}_deg"]))) for name in bare}
        tilt = max((most[name] for name in bare if not name.endswith(("yaw", "heading"))), default=0.0)
        if bare and tilt <= tilted and _LEVEL_RAD < max(most.values()) <= _TURN_RAD:
            raise ImportFileError(
                f"{where}: {', '.join(bare)} never exceed {max(most.values()):.2f}: degrees or radians? call them "
                f"{bare[0]}_deg or {bare[0]}_rad, and so on"
            )


def _most(column: Floats, share: float = _BULK_SHARE) -> float:
    """Size that a share of the numbers stays below, 0 of none."""
    known = np.abs(column[np.isfinite(column)])
    return float(np.quantile(known, share)) if len(known) else 0.0


def _shown(cell: str) -> str:
    return plain(cell.strip(_AROUND))[:40]
