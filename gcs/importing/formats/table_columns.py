"""Columns of anybody's tables: what they are called, and in which unit their numbers can only be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.vehicle_log import LogClock

Floats = NDArray[np.float64]

_ALIASES = {
    "latitude": "lat", "lat_deg": "lat", "latitude_deg": "lat", "gps.lat": "lat",
    "longitude": "lon", "lng": "lon", "lon_deg": "lon", "longitude_deg": "lon", "longtitude": "lon", "gps.lon": "lon",
    "altitude": "alt_m", "alt": "alt_m", "altitude_m": "alt_m", "abs_alt": "alt_m", "ele": "alt_m",
    "elevation": "alt_m", "altitudeamsl": "alt_m",
    "height": "height_m", "rel_alt": "height_m", "relative_alt_m": "height_m", "altituderelative": "height_m",
    "timestamp": "time", "utc": "time", "datetime": "time", "t_us": "time_us", "unix_us": "time_us",
    "timestamp_us": "time_us", "timestamp_ms": "time_ms", "timestamp_ns": "time_ns",
    "unix_s": "time_s", "t_s": "elapsed_s", "elapsed": "elapsed_s",
    "groundspeed": "speed_mps", "speed": "speed_mps", "bearing": "course_deg", "gps.courseoverground": "course_deg",
    "h_acc": "std_m", "h_acc_m": "std_m", "accuracy": "std_m", "sysid": "system_id",
    **{name: f"{name}_deg" for name in (
        "yaw", "pitch", "roll", "heading", "gimbal_yaw", "gimbal_pitch", "gimbal_roll"
    )},
}  # fmt: skip
"""Other names of columns."""
KNOWN = frozenset(_ALIASES.values()) | {"frame", "hfov_deg", "vn_mps", "ve_mps", "vd_mps", "id"}
_SCALED = {"_rad": ("_deg", math.degrees(1.0)), "_cdeg": ("_deg", 0.01), "_e7": ("", 1e-7), "_mm": ("_m", 1e-3)}
"""Endings of other units, and the factor."""
_UNIX_NAMES = ("time", "time_s", "time_ms", "time_us", "time_ns")
TIMES = ("time_us", "time_ms", "time_ns", "time_s", "time", "elapsed_s", "frame")
"""Columns of times, best first."""
_UNITS = (("s", 1e6), ("ms", 1e3), ("µs", 1.0), ("ns", 1e-3))
_UNIX_FROM_US, _UNIX_TO_US = 1e14, 4.1e15
"""Unix times of 1973 to 2099; smaller numbers count from another moment."""
_LONGEST_STEP_S = 60.0
"""Longest interval between two rows of a table that tells a path."""
_HIGHEST_M = 20_000.0
_LEAST_E7 = 1e5
"""Coordinates in 1e-7 degrees; smaller ones would be on the equator."""
_TURN_DEG, _TURN_RAD = 360.5, 2.0 * math.pi + 0.01
_LEVEL_RAD = 0.05
"""Angles that are all smaller are so little that the unit does not matter."""
_UNNAMED = {
    ("roll", "pitch", "yaw", "heading"): 0.6,
    ("gimbal_roll", "gimbal_pitch", "gimbal_yaw"): 0.5 * math.pi + 0.01,
}
"""Angles whose names tell no unit, and a roll or pitch above which they can be no radians of something that flies."""


def column_of(cell: str) -> tuple[str, float]:
    """Our name of a column, and what its numbers are to be multiplied by."""
    name = cell.strip(" \t\r\n\"'\ufeff").lower().replace(" ", "_")
    for end, (ours, factor) in _SCALED.items():
        known = _ALIASES.get(name.removesuffix(end), name.removesuffix(end) + ours)
        if name.endswith(end) and known in KNOWN:
            return known, factor
    return _ALIASES.get(name, name), 1.0


def unix_us(name: str, times: Floats, *, dated: bool, where: str) -> tuple[Floats, LogClock, tuple[str, ...]]:
    """Times in µs, the clock that they are of, and what was assumed.

    Seconds, ms, µs and ns since 1970 are told apart by their size, whatever the column is called: no other reading of
    them is a date of our time. Smaller numbers are on a clock of their own, or of the video.

    Args:
        times: (n,) as they stand in it, of dates Unix seconds.

    Raises:
        ImportFileError: they can be of no clock.
    """
    if name in ("elapsed_s", "frame"):
        return times * (1e6 if name == "elapsed_s" else 1.0), "video" if name == "elapsed_s" else "frame", ()
    if dated:
        return times * 1e6, "utc", ()
    middle = float(np.median(times))
    for unit, us in _UNITS:
        if _UNIX_FROM_US <= middle * us < _UNIX_TO_US:
            _check_steps(times, us, unit, where)
            named = name == "time" or name == f"time_{unit.replace('µ', 'u')}"
            return times * us, "utc", () if named else (f"{where} is in {unit} since 1970 by its size",)
    if name in ("time", "time_s"):
        if middle * 1e6 >= _UNIX_FROM_US:
            raise ImportFileError(f"{where}: {middle:.0f} is no Unix time of 1973 to 2099 in s, ms, µs or ns")
        _check_steps(times, 1e6, "s", where)
        return times * 1e6, "video", ()
    us = {"time_ms": 1e3, "time_us": 1.0, "time_ns": 1e-3}[name]
    return times * us, "own", ()


def _check_steps(times: Floats, us: float, unit: str, where: str) -> None:
    """See that rows follow each other as those of a path.

    Raises:
        ImportFileError: they would be minutes apart.
    """
    steps = np.abs(np.diff(times))
    steps = steps[steps > 0.0]
    if len(steps) and float(np.median(steps)) * us * 1e-6 > _LONGEST_STEP_S:
        raise ImportFileError(
            f"{where}: cannot be {unit}, since rows are {np.median(steps):.6g} apart; time since a start does not tell "
            "when that was: give Unix time, ISO 8601, or elapsed_s since the film's first frame"
        )


def in_our_units(columns: dict[str, Floats], names: set[str], where: str) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """Columns in degrees and metres, and what was assumed.

    Args:
        columns: (n,) each, by our names.
        names: of the columns as the table has them.

    Raises:
        ImportFileError: angles may be degrees or radians.
    """
    found, assumed = dict(columns), []

    def scaled(of: tuple[str, ...], least: float, factor: float, said: str) -> None:
        there = [name for name in of if name in found and np.isfinite(found[name]).any()]
        if any(np.nanmedian(np.abs(found[name])) > least for name in there):
            found.update({name: found[name] * factor for name in there})
            assumed.append(f"{', '.join(there)} are {said} by their size")

    scaled(("lat", "lon"), _LEAST_E7, 1e-7, "degrees × 1e7")
    scaled(("alt_m", "height_m"), _HIGHEST_M, 1e-3, "millimetres")
    for name in ("heading_deg", "course_deg"):
        scaled((name,), _TURN_DEG, 0.01, "centidegrees")
    for group, tilted in _UNNAMED.items():
        scaled(tuple(f"{name}_deg" for name in group), _TURN_DEG, 0.01, "centidegrees")
        bare = [name for name in group if name in names and np.isfinite(found[f"{name}_deg"]).any()]
        most = {name: float(np.nanmax(np.abs(found[f"{name}_deg"]))) for name in bare}
        tilt = max((most[name] for name in bare if not name.endswith(("yaw", "heading"))), default=0.0)
        if bare and tilt <= tilted and _LEVEL_RAD < max(most.values()) <= _TURN_RAD:
            raise ImportFileError(
                f"{where}: {', '.join(bare)} never exceed {max(most.values()):.2f}: degrees or radians? call them "
                f"{bare[0]}_deg or {bare[0]}_rad, and so on"
            )
    return found, tuple(assumed)
