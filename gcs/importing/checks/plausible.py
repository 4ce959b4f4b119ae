"""Plausible parts of a vehicle's log, whatever its format: no damaged times, places or angles, no unset heights."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from gcs.importing.checks.steps import STALE, STAYS, altitude_words, stays
from gcs.importing.vehicle_log import AngleTrack, LogClock, PlaceTrack, VehicleLog

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_DAY_US = 86_400_000_000
_OLD_US, _WEEKS_US = 1_262_304_000_000_000, 1024 * 7 * _DAY_US
"""Year 2010; and after how long a receiver's weeks begin again."""
_LAST_US = 253_402_300_799_000_000
"""End of the year 9999, the last that can be written."""
_FASTEST_MPS, _SLACK_M = 300.0, 200.0
"""Greatest speed of any vehicle of ours, and the slack within which a receiver that corrects itself steps."""
_DEG_M = 111_320.0
_FAR_M, _CLIMB_MPS = 30.0, 40.0
_FAR_RAD, _TURN_RAD_S, _TURN = 0.5, 2.0, 2.0 * math.pi + 0.01
"""Heights, metres and m/s, and headings, radians and rad/s, that are farther off than the first and back faster than
the second are damaged; and the largest angle that is one."""
_MIN_ROWS = 3
_MAX_IN_A_ROW = 8
"""Most damaged samples in a row; what is off for longer is where it is."""
_LEG_S, _OFF_MPS, _OFF_SHARE = 5.0, 2.0, 0.3
"""Time over which velocities that are off by more than this speed and this share are not those of the path."""
_ZERO_M, _UNSET_M = 0.5, 5.0
"""Bounds of a 0 that was written before a value was known: within the first of it, and no other value
is nearer than the second."""
MAX_M = 20_000.0
"""Greatest altitude or height, up or down."""
_USUAL_STEPS = 3.0
"""Usual steps, and the way between those before and after, that a sample which stands alone may be off by as well."""
_HOME_M = 1.0
"""Difference of a height's home from that of the others from which on it counts as none, m."""


def plausible(log: VehicleLog) -> VehicleLog:
    """A log without what lies more than a day from most of it, and without places that it cannot have reached."""
    log, words = _without_zeros(_within_a_day(log))
    # numbers of frames are no times
    reached = _reached(log.places) if log.clock != "frame" else np.ones(len(log.places), np.bool_)
    lost = int(np.count_nonzero(~reached))
    places, beyond = _within_the_air(log.places.select(reached) if lost else log.places)
    places, heights = _without_spikes(places)
    places, strange = _moving_as_reported(_with_heights(places)) if log.clock != "frame" else (places, 0)
    stale = 0
    if log.clock != "frame":
        more, stays_put = place_words(places, log.clock)
        words = (*words, *more)
        stale, places = int(np.count_nonzero(stays_put)), places.select(~stays_put)
    attitudes, body = _still(log.attitudes)
    gimbal, camera = _still(log.gimbal)
    left_out = {
        "positions too far from those around them": lost,
        "altitudes that cannot be": beyond,
        "altitudes out of the path and back at once": heights,
        "velocities that are not those of the path": strange,
        "attitudes that cannot be, or turn away and back at once": body + camera,
        STALE: log.notes.skipped.get(STALE, 0) + stale,
    }
    skipped = {**log.notes.skipped, **{reason: count for reason, count in left_out.items() if count}}
    notes = replace(log.notes, skipped=skipped, assumed=(*log.notes.assumed, *words, *_at_sea(places), *_of_old(log)))
    return replace(log, places=places, attitudes=attitudes, gimbal=gimbal, notes=notes)


def place_words(places: PlaceTrack, clock: LogClock) -> tuple[tuple[str, ...], Bools]:
    """Return sentences on steps that no vehicle makes, and which positions (n,) stay while the speed tells that it goes
    on."""

    def at(row: int) -> str:
        t_us = int(places.t_us[row])
        if clock != "utc":
            return f"{t_us * 1e-6:.1f} s of its time"
        return f"{datetime.fromtimestamp(min(t_us, _LAST_US) * 1e-6, UTC):%Y-%m-%d %H:%M:%S.%f}"[:-4]

    places = _with_heights(places)
    words = [
        *altitude_words(places.t_us, places.alt_m, "altitude", at),
        *altitude_words(places.t_us, places.height_m, "height", at),
    ]
    degrees, speed = np.column_stack([places.lat_deg, places.lon_deg]), np.hypot(*places.v_ned[:, :2].T)
    stale = stays(places.t_us, degrees, metres(degrees), speed) if len(places) else np.zeros(0, np.bool_)
    if stale.any():
        words.append(f"{STAYS} from {at(int(np.argmax(stale)) - 1)} on")
    return tuple(words), stale


def _without_zeros(log: VehicleLog) -> tuple[VehicleLog, tuple[str, ...]]:
    """Return a log without columns that are 0 all the time, as of a writer that has none, and which these are, in
    words."""
    unset = {
        "altitudes": log.places.alt_m,
        "attitudes": log.attitudes.angles,
        "angles of the gimbal": log.gimbal.angles,
    }
    names = [name for name, column in unset.items() if len(column) >= _MIN_ROWS and not column.any()]
    if "altitudes" in names:
        log = replace(log, places=replace(log.places, alt_m=np.full(len(log.places), np.nan)))
    log = replace(
        log,
        attitudes=AngleTrack.empty() if "attitudes" in names else log.attitudes,
        gimbal=AngleTrack.empty() if "angles of the gimbal" in names else log.gimbal,
    )
    return log, tuple(f"its {name} are all 0, which stands for unknown ones" for name in names)


def _within_the_air(places: PlaceTrack) -> tuple[PlaceTrack, int]:
    """Return positions without altitudes and heights in another unit, and how many had such."""
    alt, height = (np.abs(np.nan_to_num(column)) > MAX_M for column in (places.alt_m, places.height_m))
    alt_m, height_m = np.where(alt, np.nan, places.alt_m), np.where(height, np.nan, places.height_m)
    return replace(places, alt_m=alt_m, height_m=height_m), int(np.count_nonzero(alt | height))


def _of_old(log: VehicleLog) -> tuple[str, ...]:
    """Return sentences on where a date is older than what is read here: weeks of GPS begin again after 1024 of them."""
    first_us = log.zero_us if log.clock == "video" else int(log.places.t_us[0]) if len(log.places) else 0
    if log.clock not in ("video", "utc") or not 0 < first_us < _OLD_US:
        return ()
    date, then = (f"{datetime.fromtimestamp(t_us * 1e-6, UTC):%Y-%m-%d}" for t_us in (first_us, first_us + _WEEKS_US))
    if first_us + _WEEKS_US < _OLD_US:
        return (f"it is of {date} by its date: a clock that was never set?",)
    return (f"it is of {date} by its date: a receiver whose weeks have begun again? that would be {then}",)


def _at_sea(places: PlaceTrack) -> tuple[str, ...]:
    """Return sentences on where a path may be in radians: then it lies in the Gulf of Guinea, where nobody drives."""
    if not len(places) or np.abs(places.lat_deg).max() > 0.5 * math.pi or np.abs(places.lon_deg).max() > math.pi:
        return ()
    return (f"it lies in the sea at {places.lat_deg[0]:.3f}, {places.lon_deg[0]:.3f}: are these radians?",)


def _moving_as_reported(places: PlaceTrack) -> tuple[PlaceTrack, int]:
    """Return positions without velocities in another unit, or of a filter that does not fly; and how many these
    were."""
    known = np.flatnonzero(np.isfinite(places.v_ned[:, :2]).all(axis=1))
    t_s = (places.t_us[known] - places.t_us[0]) * 1e-6 if len(known) else np.empty(0)
    path = np.column_stack([places.lat_deg, places.lon_deg])[known]
    ends = np.searchsorted(t_s, t_s + _LEG_S)
    begins = np.flatnonzero(ends < len(known))
    ends = ends[begins]
    if len(begins) < _MIN_ROWS:
        return places, 0
    way = np.zeros((len(known), 2))
    # s = ∫ v dt, by trapezia
    v = places.v_ned[known, :2]
    way[1:] = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t_s)[:, None], axis=0)
    leg_s = (t_s[ends] - t_s[begins])[:, None]
    went, reported = (((at[ends] - at[begins]) / leg_s) for at in (metres(path), way))
    off = np.linalg.norm(reported - went, axis=1)
    if float(np.median(off - _OFF_SHARE * np.linalg.norm(went, axis=1))) < _OFF_MPS:
        return places, 0
    return replace(places, v_ned=np.full_like(places.v_ned, np.nan)), len(known)


def _without_spikes(places: PlaceTrack) -> tuple[PlaceTrack, int]:
    """Return positions without altitudes, heights and headings that nothing moves to and back, and how many had
    such."""

    def known(column: Floats, off: Bools) -> Floats:
        return np.where(off, np.nan, column)

    alt, height = (
        alone(places.t_us, column[:, None], _FAR_M, _CLIMB_MPS) for column in (places.alt_m, places.height_m)
    )
    heading = alone(places.t_us, _on_circle(places.heading), _FAR_RAD, _TURN_RAD_S)
    found = replace(
        places,
        alt_m=known(places.alt_m, alt),
        height_m=known(places.height_m, height),
        heading=known(places.heading, heading),
    )
    return found, int(np.count_nonzero(alt | height))


def _still(track: AngleTrack) -> tuple[AngleTrack, int]:
    """Return a track without attitudes in another unit, or that nothing turns to and back, and how many these are."""
    with np.errstate(invalid="ignore"):
        off = (np.abs(track.angles) > _TURN).any(axis=1)
    off |= alone(track.t_us, _axes(track.angles), _FAR_RAD, _TURN_RAD_S)
    kept = ~off
    return replace(track, t_us=track.t_us[kept], angles=track.angles[kept]), int(np.count_nonzero(off))


def _axes(angles: Floats) -> Floats:
    """(n, 6) where nose and right side point, √½ each: a yaw alone leaps where a camera looks straight down."""
    (roll_c, pitch_c, yaw_c), (roll_s, pitch_s, yaw_s) = np.cos(angles).T, np.sin(angles).T
    nose = yaw_c * pitch_c, yaw_s * pitch_c, -pitch_s
    right = yaw_c * pitch_s * roll_s - yaw_s * roll_c, yaw_s * pitch_s * roll_s + yaw_c * roll_c, pitch_c * roll_s
    return np.column_stack([*nose, *right]) / math.sqrt(2.0)


def _on_circle(angle: Floats) -> Floats:
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _within_a_day(log: VehicleLog) -> VehicleLog:
    """Return the log without damaged times, and other flights."""
    # of an even number the upper middle one: the mean of two may be near neither
    middle_us = int(log.places.t_us[len(log.places) // 2]) if len(log.places) else 0

    def near(t_us: Ints) -> Bools:
        return np.abs(t_us - middle_us) <= _DAY_US

    kept = near(log.places.t_us)
    lost = int(np.count_nonzero(~kept))
    body, gimbal, view = near(log.attitudes.t_us), near(log.gimbal.t_us), near(log.view.t_us)
    skipped = {**log.notes.skipped, "positions a day from the others": lost} if lost else log.notes.skipped
    return replace(
        log,
        places=log.places.select(kept),
        attitudes=replace(log.attitudes, t_us=log.attitudes.t_us[body], angles=log.attitudes.angles[body]),
        gimbal=replace(log.gimbal, t_us=log.gimbal.t_us[gimbal], angles=log.gimbal.angles[gimbal]),
        view=replace(log.view, t_us=log.view.t_us[view], hfov=log.view.hfov[view]),
        notes=replace(log.notes, skipped=skipped),
    )


def _reached(places: PlaceTrack) -> Bools:
    """(n,) which positions can be reached from that in the middle of all, over those between."""
    n = len(places)
    if n < _MIN_ROWS:
        return np.ones(n, np.bool_)
    lat, lon = np.median(places.lat_deg), np.median(places.lon_deg)
    east = (places.lon_deg - lon + 180.0) % 360.0 - 180.0
    at_m = np.column_stack([places.lat_deg - lat, east * math.cos(math.radians(float(lat)))]) * _DEG_M
    t_s = (places.t_us - places.t_us[0]) * 1e-6
    step_m, step_s = np.hypot(*np.diff(at_m, axis=0).T), np.diff(t_s)
    if (step_m <= _SLACK_M + _FASTEST_MPS * step_s).all():
        return np.ones(n, np.bool_)
    start = int(np.argmin(np.hypot(at_m[:, 0], at_m[:, 1])))
    kept = np.zeros(n, np.bool_)
    for rows in (range(start, n), range(start, -1, -1)):
        last = start
        for row in rows:
            away_m = math.hypot(*(at_m[row] - at_m[last]).tolist())
            if away_m <= _SLACK_M + _FASTEST_MPS * abs(float(t_s[row] - t_s[last])):
                kept[row], last = True, row
    return kept


def _with_heights(places: PlaceTrack) -> PlaceTrack:
    """Return positions without altitudes and heights of 0 that were written before there was a fix or a home.

    Beside altitudes a height of 0 counts as such where the other heights have another home.
    """
    alt_m, height_m = _known(places.alt_m), places.height_m
    zero = height_m == 0.0
    reported = np.isfinite(height_m) & np.isfinite(alt_m) & ~zero
    if not reported.any():
        return replace(places, alt_m=alt_m, height_m=_known(height_m))
    home_m = float(np.median((alt_m - height_m)[reported]))
    unset = zero & ~(np.abs(alt_m - home_m) <= _HOME_M)
    # some readers work out heights by altitudes
    unset |= np.isnan(alt_m) & (np.abs(places.alt_m - height_m - home_m) <= _HOME_M)
    return replace(places, alt_m=alt_m, height_m=np.where(unset, np.nan, height_m))


def _known(column: Floats) -> Floats:
    """Return the values without zeros that nothing comes near."""
    zero = np.abs(column) < _ZERO_M
    others = np.abs(column[np.isfinite(column) & ~zero])
    return np.where(zero, np.nan, column) if len(others) and others.min() > _UNSET_M else column


def alone(t_us: Ints, path: Floats, far: float, fastest: float) -> NDArray[np.bool_]:
    """(n,) which samples, some in a row at most, are farther off than ``far`` from those before and after.

    Args:
        t_us: (n,) increasing.
        path: (n, k) in any unit.
        far: in that unit; what is nearer may be noise.
        fastest: per second; nothing of which this is measured goes out and back faster.
    """
    usual = usual_step(path)
    found = np.zeros(len(t_us), np.bool_)
    for count in range(1, _MAX_IN_A_ROW + 1):
        for k in np.flatnonzero(_out_and_back(t_us, path, far + _USUAL_STEPS * usual, fastest, count)).tolist():
            found[k + 1 : k + 1 + count] = True
    return found


def _out_and_back(t_us: Ints, path: Floats, far: float, fastest: float, count: int) -> Bools:
    """Behind which samples a path leaps, and leaps back ``count`` samples later to where it was going."""
    if len(t_us) < count + 2:
        return np.zeros(0, np.bool_)
    leg = _steps(path)
    past = np.linalg.norm(path[count + 1 :] - path[: -count - 1], axis=1)
    with np.errstate(invalid="ignore"):
        fast = leg > fastest * np.diff(t_us) * 1e-6
        off = np.minimum(leg[:-count], leg[count:]) > far + _USUAL_STEPS * past
    return np.asarray(off & fast[:-count] & fast[count:])


def usual_step(path: Floats) -> float:
    """Median distance of samples (n, k) that follow each other and differ."""
    step = _steps(path)
    step = step[step > 0.0]
    return float(np.median(step)) if len(step) else 0.0


def metres(places: Floats) -> Floats:
    """Places (n, 2) in degrees as metres north and east of the middle of all."""
    lat, lon = np.median(places[:, 0]), np.median(places[:, 1])
    east = (places[:, 1] - lon + 180.0) % 360.0 - 180.0
    return np.column_stack([places[:, 0] - lat, east * math.cos(math.radians(float(lat)))]) * _DEG_M


def _steps(path: Floats) -> Floats:
    return np.asarray(np.linalg.norm(np.diff(path, axis=0), axis=1))
