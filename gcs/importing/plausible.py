"""What of a vehicle's log can be, whatever its format: no damaged times, no places out of reach, no unset heights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.importing.vehicle_log import PlaceTrack, VehicleLog

__all__ = ["plausible"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_DAY_US = 86_400_000_000
_FASTEST_MPS, _SLACK_M = 300.0, 200.0
"""No vehicle of ours is faster; a receiver that corrects itself steps by less than the slack."""
_DEG_M = 111_320.0
_LEAST = 3
_HOME_M = 1.0
"""Heights whose home is off by more than this from that of the others are none."""


def plausible(log: VehicleLog) -> VehicleLog:
    """A log without what lies more than a day from most of it, and without places that it cannot have reached."""
    log = _within_a_day(log)
    # numbers of frames are no times
    reached = _reached(log.places) if log.clock != "frame" else np.ones(len(log.places), np.bool_)
    lost = int(np.count_nonzero(~reached))
    places = _with_heights(log.places.select(reached) if lost else log.places)
    skipped = {**log.notes.skipped, "positions too far from those around them": lost} if lost else log.notes.skipped
    return replace(log, places=places, notes=replace(log.notes, skipped=skipped))


def _within_a_day(log: VehicleLog) -> VehicleLog:
    """Without damaged times, and other flights."""
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
    if n < _LEAST:
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
    """Heights of exactly 0 are written before there is a home: they are none where the others have another home."""
    zero = places.height_m == 0.0
    told = np.isfinite(places.height_m) & np.isfinite(places.alt_m) & ~zero
    if not zero.any() or not told.any():
        return places
    home_m = float(np.median((places.alt_m - places.height_m)[told]))
    unset = zero & (np.abs(places.alt_m - home_m) > _HOME_M)
    return replace(places, height_m=np.where(unset, np.nan, places.height_m)) if unset.any() else places
