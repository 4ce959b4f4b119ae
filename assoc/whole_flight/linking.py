"""Pieces of tracks, joined to objects: a track that was lost goes on in one that begins where it was heading.

Pieces of one stranger beside a vehicle are one coincidence and not several. A piece goes on in another one if that
begins within 2.5 s where the first would be by then, both drive alike, and neither could be a third piece's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import ground_tracks
from assoc.history import TrackHistory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_GAP_S = 2.5
"""Longest time out of sight, seconds."""
_REACH_M, _REACH_MPS = 1.0, 0.6
"""Distance from where it was heading within which an object reappears, metres, and this much more for each second."""
_AMBIGUOUS = 2.0
"""Reach, in multiples of that one, in which no other piece may begin or end."""
_SPEED_OVER_S = 1.0
"""Time over which a velocity is measured, seconds."""
_FEWEST = 4
"""Boxes from which a velocity is measured, at least."""
_UNLIKE_MPS, _UNLIKE_MPS2 = 0.6, 0.6
"""Pieces of one object differ by no more than this in velocity, m/s, and this much more for each second."""


def linked(history: TrackHistory, theta: FloatArray, names: IntArray) -> IntArray:
    """First piece of the object to which each of the S columns in use of a history belongs, (S,).

    Args:
        history: Rays of the pieces.
        theta: (9,) a pose correction: it need not be good, as places are compared within seconds.
        names: (S,) vehicle that each is known to be so far, −1 unknown: two are not joined.
    """
    n = int(np.count_nonzero(history.track_id))
    tracks = ground_tracks(history, 0, theta, np.arange(n))
    ends, begins = (_ends(tracks.t, tracks.p, last=last) for last in (True, False))
    gap_s = begins[None, :, 0] - ends[:, None, 0]
    # half way between both, each by its own velocity
    half = 0.5 * gap_s[..., None]
    away = np.linalg.norm(
        begins[None, :, 1:3] - begins[None, :, 3:] * half - ends[:, None, 1:3] - ends[:, None, 3:] * half, axis=2
    )
    unlike = np.linalg.norm(begins[None, :, 3:] - ends[:, None, 3:], axis=2)
    reach_m = _REACH_M + _REACH_MPS * gap_s
    timely = (gap_s > 0.0) & (gap_s <= _GAP_S) & np.isfinite(away)
    good = timely & (away < reach_m) & (unlike < _UNLIKE_MPS + _UNLIKE_MPS2 * gap_s)
    rival = timely & (away < _AMBIGUOUS * reach_m)
    good &= (np.sum(rival, axis=0, keepdims=True) == 1) & (np.sum(rival, axis=1, keepdims=True) == 1)
    good &= (names[:, None] == names) | (names[:, None] < 0) | (names < 0)
    group = np.arange(n)
    # in the order of time, so that the earlier piece is in its group already
    for piece, following in sorted(np.argwhere(good).tolist(), key=lambda pair: float(ends[pair[0], 0])):
        group[following] = group[piece]
    return group


def _ends(t: FloatArray, p: FloatArray, *, last: bool) -> FloatArray:
    """(S, 5) time, east, north and velocity of each track (F, S, 2) at its last or first box; NaN unknown."""
    ends = np.full((p.shape[1], 5), np.nan)
    for k in range(p.shape[1]):
        rows = np.flatnonzero(np.isfinite(p[:, k, 0]))
        if not len(rows):
            continue
        edge = rows[-1] if last else rows[0]
        near = rows[np.abs(t[rows] - t[edge]) <= _SPEED_OVER_S]
        if len(near) < _FEWEST:
            continue
        line = np.polynomial.polynomial.polyfit(t[near] - t[edge], p[near, k], 1)
        ends[k] = t[edge], *line[0], *line[1]
    return ends
