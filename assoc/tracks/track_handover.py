"""Which lost tracks were probably continued by the tracker under a new id."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import rays_to_ground
from assoc.history import TrackHistory

__all__ = ["replaced_tracks"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_REACH_M, _REACH_MPS = 2.0, 6.0
"""A continuation starts within the first distance of where the lost track was seen last, plus the second per second."""


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
    seen, place = np.zeros(len(columns)), np.zeros((len(columns), 2))
    for k, row in enumerate(history.last_rows(columns).tolist()):
        camera = history.R[row], history.p[row], float(history.z[row])
        seen[k], place[k] = history.t[row], rays_to_ground(history.ray[row, columns[[k]]], *camera, theta)[0]
    away = np.linalg.norm(place[:, None] - place[None], axis=2)
    near = away < (_REACH_M + _REACH_MPS * (t - seen))[:, None]
    return np.asarray(np.any((first[None] > last[:, None]) & near, axis=1))
