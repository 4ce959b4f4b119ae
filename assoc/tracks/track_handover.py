"""Lost tracks that the tracker probably continued under a new id."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import rays_to_ground
from assoc.history import TrackHistory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_REACH_M, _REACH_MPS = 2.0, 6.0
"""A continuation starts within the first distance of where the lost track was seen last, plus the second per second."""
_EXCHANGE_MPS = 3.0
"""Distance of a vehicle, after a second, from where a tracker expects it: it brakes, or sets off."""


def replaced_tracks(t: float, history: TrackHistory, columns: IntArray, theta: FloatArray) -> BoolArray:
    """Tracks near whose last place another track began after they were last seen.

    Args:
        t: Time of the newest frame, seconds.
        history: Rays and camera poses.
        columns: (m,) columns of the tracks.
        theta: (9,) pose correction.

    Returns:
        (m,) whether each was replaced.
    """
    first, last = history.first_s[columns], history.last_s[columns]
    if np.all(first <= np.min(last)):
        return np.zeros(len(columns), np.bool_)
    seen, place = _last_places(history, columns, theta)
    away = np.linalg.norm(place[:, None] - place[None], axis=2)
    near = away < (_REACH_M + _REACH_MPS * (t - seen))[:, None]
    return np.asarray(np.any((first[None] > last[:, None]) & near, axis=1))


def exchangeable(t: float, history: TrackHistory, before: IntArray, theta: FloatArray) -> BoolArray:
    """Tracks that a tracker may have exchanged over a gap: where they broke off one could have driven to another.

    Args:
        t: Time of the first frame after it.
        history: Rays and camera poses.
        before: (k,) columns of the tracks that broke off, −1 none.
        theta: (9,) pose correction.

    Returns:
        (k,) whether each may be another of them now.
    """
    broken = np.flatnonzero(before >= 0)
    result = np.zeros(len(before), np.bool_)
    if len(broken) > 1:
        seen, place = _last_places(history, before[broken], theta)
        away = np.linalg.norm(place[:, None] - place[None], axis=2)
        np.fill_diagonal(away, np.inf)
        result[broken] = np.any(away < (_REACH_M + _EXCHANGE_MPS * (t - seen))[:, None], axis=1)
    return result


def _last_places(history: TrackHistory, columns: IntArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m,) when each track was seen last, seconds, and (m, 2) where, metres."""
    seen, place = np.zeros(len(columns)), np.zeros((len(columns), 2))
    for k, row in enumerate(history.last_rows(columns).tolist()):
        camera = history.R[row], history.p[row], float(history.z[row])
        seen[k], place[k] = history.t[row], rays_to_ground(history.ray[row, columns[[k]]], *camera, theta)[0]
    return seen, place
