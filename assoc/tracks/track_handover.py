"""Which tracks may be going on for others that broke off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import rays_to_ground
from assoc.history import TrackHistory

__all__ = ["replaced_tracks"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_BREAK_M, _BREAK_MPS = 2.0, 6.0
"""A track that goes on for another begins this near to where that was seen last, and this much farther per second."""


def replaced_tracks(t: float, history: TrackHistory, columns: IntArray, theta: FloatArray) -> BoolArray:
    """Tracks in whose place another began since they were seen.

    Args:
        t: Time of the newest frame, seconds.
        history: What was seen.
        columns: (m,) tracks.
        theta: (8,) pose correction.

    Returns:
        (m,).
    """
    first, last = history.first_s[columns], history.last_s[columns]
    if np.all(first <= np.min(last)):
        return np.zeros(len(columns), np.bool_)
    seen, place = np.zeros(len(columns)), np.zeros((len(columns), 2))
    for k, row in enumerate(history.last_rows(columns).tolist()):
        camera = history.R[row], history.p[row], float(history.z[row])
        seen[k], place[k] = history.t[row], rays_to_ground(history.ray[row, columns[[k]]], *camera, theta)[0]
    away = np.linalg.norm(place[:, None] - place[None], axis=2)
    near = away < (_BREAK_M + _BREAK_MPS * (t - seen))[:, None]
    return np.asarray(np.any((first[None] > last[:, None]) & near, axis=1))
