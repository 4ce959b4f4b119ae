"""Starting poses for a camera that looks far: its heading and pitch are aimed so that boxes fall on vehicles.

A camera at the height h that looks down by ε moves a place by h/sin²ε · Δpitch along the line of sight: at 6° and 50 m
up by 80 m a degree. From the pose that is reported no pair is near then, and nothing leads to the right one. So each
pair of a track and a vehicle tells a heading and a pitch, and those under which most tracks are in the direction of a
vehicle are starts:

    Σ_k ln(1 + A exp(−½ min_j (Δβ²/σ_β² + Δε²/σ_ε²)_kj)) − ½ (yaw²/σ_yaw² + pitch²/σ_pitch²).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import OFFSET, PITCH, THETA, YAW
from assoc.hypotheses.search import UpdateContext

FloatArray = NDArray[np.float64]

_FAR_M = 8.0
"""1σ of places along the line of sight by the pitch's, metres, from which on the fit does not find the way."""
_STD_M, _STD_RAD = 3.0, 0.002
"""1σ of a pair's directions: metres across the line of sight or along the ground, and radians."""
_GAIN = 50.0
"""A: a track in the direction of a vehicle counts 4 nats, one that is not nothing."""
_MOST_STDS = 3.0
"""Corrections of more prior σ than this are not tried."""
_DISTINCT = 2.0
"""Starts differ by more than this many σ of a pair."""
_STARTS = 3
_MIN_SQUARE = 1e-6


def aimed(context: UpdateContext, theta: FloatArray) -> list[FloatArray]:
    """Poses whose heading and pitch put most tracks of the newest frame where vehicles report to be, best first.

    Args:
        context: Tracks, reports and the prior.
        theta: (9,) the pose by whose clock they are compared; heading and pitch count from the one that is reported.

    Returns:
        (9,) each; none where the camera looks so steeply that every start leads there.
    """
    history, row = context.history, context.history.n - 1
    rays = history.ray[row, context.columns[: context.live]]
    d = rays[np.isfinite(rays[:, 0])] @ history.R[row].T
    place, _ = context.log.extrapolated(float(history.t[row] - theta[OFFSET]))
    place = place[np.isfinite(place[:, 0])]
    to = np.column_stack([place, np.full(len(place), history.z[row])]) - history.p[row]
    if len(d) < 2 or len(to) < 2:
        return []
    (bearing, down), (wanted, deep) = _angles(d), _angles(to)
    height, away = -float(np.median(to[:, 2])), np.linalg.norm(to, axis=1)
    std = context.prior.std[[YAW, PITCH]]
    if height <= 0.0 or std[1] * height / max(np.sin(float(np.median(deep))) ** 2, _MIN_SQUARE) < _FAR_M:
        return []
    sides = np.stack([_STD_M / away, _STD_M * height / away**2], axis=1) + _STD_RAD
    # (m, n, 2) yaw and pitch of each pair: a camera that is pitched up sees everything lower
    aim = np.stack([_wrapped(wanted[None] - bearing[:, None]), down[:, None] - deep[None]], axis=2)
    tried = aim.reshape(-1, 2)
    tried = tried[np.all(np.abs(tried) < _MOST_STDS * std, axis=1)]
    # (c, m, n, 2) what is left of each pair under each aim
    left = (aim[None] - tried[:, None, None]) / sides
    near = np.min(np.sum(left**2, axis=3), axis=2)
    score = np.sum(np.log1p(_GAIN * np.exp(-0.5 * near)), axis=1) - 0.5 * np.sum((tried / std) ** 2, axis=1)
    found: list[FloatArray] = []
    usual = _DISTINCT * np.median(sides, axis=0)
    for k in np.argsort(-score, kind="stable").tolist():
        if all(np.any(np.abs(tried[k] - other[[YAW, PITCH]]) > usual) for other in found):
            start = np.zeros(THETA)
            start[OFFSET], start[[YAW, PITCH]] = theta[OFFSET], tried[k]
            found.append(start)
            if len(found) == _STARTS:
                break
    return found


def _angles(d: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bearings, clockwise from north, and angles below the horizon, (k,) radians, of directions (k, 3) ENU."""
    return np.arctan2(d[:, 0], d[:, 1]), np.arctan2(-d[:, 2], np.hypot(d[:, 0], d[:, 1]))


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
