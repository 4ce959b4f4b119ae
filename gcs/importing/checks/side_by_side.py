"""Contradictions between the sources of a flight: places, altitudes and headings in another unit, frame or row."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import metres
from gcs.importing.ground_vehicles import GroundVehicles, path_lead
from gcs.importing.vehicle_log import PlaceTrack, VehicleLog
from mavlink.geodesy import separation_m

Floats = NDArray[np.float64]

_BY_HAND = (".csv", ".tsv", ".txt", ".gpx", ".kml")
"""Suffixes of files whose columns anybody may swap: other formats have fixed ones, or letters."""
_FAR_M, _AWAY_M = 100_000.0, 5_000.0
"""A UAV that is farther from its fleet than the first is not above it; than the second, it is reported."""
_APART_M, _HILL_M = 15.0, 25.0
"""Altitudes of take-off and fleet, and of one vehicle and the others, that are farther apart are reported."""
_LOW_M = 3.0
"""Whatever never was higher above its take-off and the fleet did not fly."""
_DEEP_M, _HIGH_M = 120.0, 1_000.0
"""Nothing flies deeper below its fleet, whichever of them counts from the ellipsoid; higher it is reported."""
_UNITS = {"feet": 0.3048, "centimetres": 0.01, "millimetres": 0.001, "tenths": 0.1}
_COMPARED, _TWIN_M = 100, 0.5
"""Positions of two vehicles that are compared; nearer to each other all the time is no other vehicle."""
_TURN, _LEVEL = np.radians(2.0 * np.pi + 0.01), np.radians(0.05)
"""Angles in radians that were taken for degrees are smaller than the first, and not all smaller than the second."""
_MOST_OF_TURN = 0.6
"""Share of a turn that a yaw covers which is asked for its unit without a course."""
_LEG_S, _MIN_LEG_M, _MIN_LEGS = 2.0, 2.0, 10
"""Legs that tell a course."""
_ALONG, _NEARER = np.radians(35.0), np.radians(10.0)
"""Headings of what drives are along its course, forwards or backwards; they fit better if by more than the second."""
_AGREED, _SCATTERED = 0.7, 0.5
"""Length of the mean of unit vectors above which directions agree, and below which they are scattered."""


def above_fleet(uav: VehicleLog, fleet: GroundVehicles) -> tuple[VehicleLog, tuple[str, ...]]:
    """The log of a UAV that is above its fleet, and what was assumed for that.

    Latitude and longitude are swapped where only that puts it there.

    Raises:
        ImportFileError: it is far from the fleet, or it cannot be known in which of both they are swapped.
    """
    lat, lon = float(np.median(uav.places.lat_deg)), float(np.median(uav.places.lon_deg))
    away_m = separation_m(lat, lon, *fleet.middle)
    if away_m < _FAR_M:
        return uav, ((f"{uav.source}: the UAV is {away_m / 1000.0:.0f} km from the fleet",) if away_m > _AWAY_M else ())
    tables = [log.source for log in fleet.logs.values() if _by_hand(log)]
    if abs(lon) <= 90.0 and separation_m(lon, lat, *fleet.middle) < _FAR_M:
        if tables and fleet.tlog is None:
            raise ImportFileError(
                f"{uav.source} and {tables[0]}: latitude and longitude stand the other way round in one of them, and "
                "nothing tells in which; change them over there"
            )
        places = replace(uav.places, lat_deg=uav.places.lon_deg, lon_deg=uav.places.lat_deg)
        return replace(uav, places=places), (f"{uav.source}: latitude and longitude stand the other way round in it",)
    raise ImportFileError(
        f"{uav.source}: the UAV is {away_m / 1000.0:.0f} km from the fleet{_sides((lat, lon), fleet.middle)}; do the "
        "files belong together?"
    )


def _by_hand(log: VehicleLog) -> bool:
    return log.source.partition(" (")[0].lower().endswith(_BY_HAND)


def _sides(place: tuple[float, float], other: tuple[float, float]) -> str:
    """Sign or order with which a place would be near another one, in words."""
    lat, lon = place
    ways = {
        "with the sign of its longitude (W, E) changed": (lat, -lon),
        "with the sign of its latitude (S, N) changed": (-lat, lon),
        "with both signs changed": (-lat, -lon),
        "with latitude and longitude changed over": (lon, lat),
    }
    near = (how for how, at in ways.items() if abs(at[0]) <= 90.0 and separation_m(*at, *other) < _AWAY_M)
    return "".join(f", and near {how}" for how in itertools.islice(near, 1))


def fleet_words(fleet: GroundVehicles) -> Iterator[str]:
    """Return sentences on which vehicles are far from the others, above or below them, on each other, or do not go
    where they look.

    Raises:
        ImportFileError: a vehicle's own log is of another place.
    """
    for system_id, track in fleet.places.items():
        name = fleet.logs[system_id].source if system_id in fleet.logs else "telemetry"
        whose = f"{name}, system {system_id}"
        others = [other for i, other in fleet.places.items() if i != system_id]
        if others:
            yield from _beside(whose, track, others, refuse=system_id in fleet.logs)
        if system_id in fleet.logs and fleet.logs[system_id].flies:
            yield f"{whose}: its heartbeats are an aircraft's: is it the log of the UAV?"
        yield from _course_words(whose, track)
    for (one_id, one), (other_id, other) in itertools.combinations(fleet.places.items(), 2):
        rows = np.flatnonzero((one.t_us > other.t_us[0]) & (one.t_us < other.t_us[-1]))
        apart_m = path_lead(other, one.select(rows[:: len(rows) // _COMPARED + 1]), np.zeros(1, np.int64)).now_m
        if apart_m < _TWIN_M:
            yield f"systems {one_id} and {other_id} go one way, {apart_m:.1f} m apart: one vehicle under two ids?"


def _beside(whose: str, track: PlaceTrack, others: list[PlaceTrack], *, refuse: bool) -> Iterator[str]:
    """One vehicle beside the others: of each the middle counts, however many positions it has."""
    lat, lon = float(np.median(track.lat_deg)), float(np.median(track.lon_deg))
    middle = (
        float(np.median([np.median(other.lat_deg) for other in others])),
        float(np.median([np.median(other.lon_deg) for other in others])),
    )
    away_m = separation_m(lat, lon, *middle)
    if away_m > _AWAY_M:
        problem = f"{whose} is {away_m / 1000.0:.0f} km from the other vehicles{_sides((lat, lon), middle)}"
        if refuse and away_m > _FAR_M:
            raise ImportFileError(f"{problem}; which of them is right? Correct the other, or leave it out")
        yield problem
        return
    known = [median_m(other.alt_m) for other in others if np.isfinite(other.alt_m).any()]
    up_m = median_m(track.alt_m) - (float(np.median(known)) if known else np.nan)
    if abs(up_m) > _HILL_M:
        unit = _unit_words(median_m(track.alt_m), float(np.median(known)), _HILL_M)
        yield (
            f"{whose} is {up_m:+.0f} m from the median altitude of the other vehicles: a hill, the ellipsoid for the "
            f"sea, an aircraft's log, or another unit{unit}"
        )


def _unit_words(alt_m: float, ground_m: float, near_m: float) -> str:
    """Unit in which an altitude would be near another one."""
    fits = (unit for unit, size in _UNITS.items() if abs(alt_m * size - ground_m) < near_m)
    return "".join(f" (as {unit} it would be near)" for unit in itertools.islice(fits, 1))


def median_m(column: Floats) -> float:
    """Median of what is known, NaN of nothing."""
    return float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else float("nan")


def _course_words(whose: str, track: PlaceTrack) -> Iterator[str]:
    """Direction in which a vehicle looks beside that in which it goes: nothing drives sideways all the time."""
    rows, course = _courses(track)
    headings = track.heading[rows]
    known = np.isfinite(headings)
    if np.count_nonzero(known) < _MIN_LEGS:
        return
    off, length = _mean_angle(headings[known] - course[known])
    most, askew = float(np.abs(headings[known]).max()), _askew(off) if length > _AGREED else np.pi
    # taken for degrees, radians were divided by 57 once too often
    off_if, length_if = _mean_angle(np.degrees(headings[known]) - course[known])
    if most <= _TURN and length_if > _AGREED and _askew(off_if) + _NEARER < askew:
        yield f"{whose}: its headings never exceed {np.degrees(most):.2f}° and follow its course as radians"
    elif askew < _ALONG:
        return
    elif length > _AGREED:
        yield f"{whose}: its heading is {np.degrees(off):+.0f}° from the course that it drives: another frame?"
    elif length < _SCATTERED:
        yield f"{whose}: its heading does not follow the course that it drives: another unit, frame or row?"


def _askew(angle: float) -> float:
    """Return the angle from the course, forwards or backwards."""
    return min(abs(angle), np.pi - abs(angle))


def _mean_angle(angles: Floats) -> tuple[float, float]:
    """Direction of the mean of unit vectors, and its length."""
    mean = complex(np.exp(1j * angles).mean())
    return float(np.angle(mean)), abs(mean)


def _courses(track: PlaceTrack) -> tuple[NDArray[np.int64], Floats]:
    """Rows in the middle of legs, and the course over each."""
    t_s = (track.t_us - track.t_us[0]) * 1e-6
    path_m = metres(np.column_stack([track.lat_deg, track.lon_deg]))
    ends = np.searchsorted(t_s, t_s + _LEG_S)
    begins = np.flatnonzero(ends < len(t_s))
    leg = path_m[ends[begins]] - path_m[begins]
    went = (np.linalg.norm(leg, axis=1) > _MIN_LEG_M) & (t_s[ends[begins]] - t_s[begins] < 2.0 * _LEG_S)
    begins, leg = begins[went], leg[went]
    return (begins + ends[begins]) // 2, np.arctan2(leg[:, 1], leg[:, 0])


def uav_words(uav: VehicleLog) -> Iterator[str]:
    """Return sentences on where angles of the UAV look as if they were radians under the name of degrees, which only a
    table's can be."""
    if not _by_hand(uav):
        return
    yaw = uav.attitudes.angles[:, 2] if len(uav.attitudes) else uav.places.heading[np.isfinite(uav.places.heading)]
    yaw = (yaw[np.isfinite(yaw)] + np.pi) % (2.0 * np.pi) - np.pi
    if len(yaw) and np.ptp(yaw) > _LEVEL and np.abs(yaw).max() <= _TURN:
        _, course = _courses(uav.places)
        # without a course nothing speaks against it: one that hovers may well look north all the time
        off, length = _mean_angle(course) if len(course) else (0.0, 1.0)
        if np.ptp(yaw) > _MOST_OF_TURN * _TURN or length < _AGREED or abs(off) > _NEARER:
            yield f"{uav.source}: its yaw never exceeds {np.degrees(np.abs(yaw).max()):.2f}°: are these radians?"
    pitch = uav.gimbal.angles[:, 1] if len(uav.gimbal) else np.empty(0)
    pitch = pitch[np.isfinite(pitch)]
    if len(pitch) and _LEVEL < np.abs(pitch).max() <= np.radians(0.5 * np.pi + 0.01):
        yield (
            f"{uav.source}: its gimbal never looks farther than {np.degrees(np.abs(pitch).max()):.2f}° from the "
            "horizon: are these radians?"
        )


def height_words(source: str, places: PlaceTrack, fleet: GroundVehicles) -> Iterator[str]:
    """Return sentences on what the UAV's altitudes and heights say against those of the fleet, and what is made of
    them.

    Raises:
        ImportFileError: the UAV would be deep below its fleet.
    """
    ground_m = fleet.ground_m
    # it may have stood for most of the time
    known = places.alt_m[np.isfinite(places.alt_m)]
    alt_m = float(np.quantile(known, 0.9)) if len(known) else np.nan
    above_m = alt_m - ground_m
    both = np.isfinite(places.alt_m) & np.isfinite(places.height_m)
    home_m = float(np.median((places.alt_m - places.height_m)[both])) - ground_m if both.any() else np.nan
    unit = _unit_words(alt_m, ground_m, _DEEP_M) if abs(above_m) > _DEEP_M else ""
    if above_m < -_DEEP_M:
        raise ImportFileError(
            f"{source}: the UAV's altitude of {alt_m:.0f} m is {-above_m:.0f} m below the ground vehicles' median of "
            f"{ground_m:.0f} m: one of them is in another unit{unit}; give both in metres"
            + "".join(f" ({words})" for words in fleet.contradictions)
        )
    heights = places.height_m[np.isfinite(places.height_m)]
    up_m = [up for up in (float(heights.max(initial=-np.inf)), above_m) if np.isfinite(up)]
    if up_m and max(up_m) < _LOW_M:
        yield f"{source}: it never is {_LOW_M:.0f} m above its take-off or the fleet: is it a ground vehicle's log?"
    elif above_m < 0.0 or above_m > _HIGH_M:
        yield (
            f"the UAV flies {above_m:+.0f} m above the fleet's median altitude: one of them counts from the ellipsoid, "
            f"or is in another unit{unit}"
        )
    if abs(home_m) > _APART_M:
        yield (
            f"the UAV took off {home_m:+.0f} m from the fleet's median altitude: a hill, or one of them counts "
            "altitudes from the ellipsoid and not from the sea"
        )
    elif np.isnan(home_m) and np.isnan(ground_m):
        yield "altitudes count from the UAV's take-off: no vehicle tells how high it is"
    elif np.isnan(home_m):
        missing = "altitude" if np.isfinite(places.height_m).any() else "height above the ground"
        yield f"the UAV's {missing} by the fleet's median altitude of {ground_m:.1f} m"
