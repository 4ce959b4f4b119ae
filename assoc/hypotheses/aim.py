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

from assoc.geometry.ground import OFFSET, PITCH, THETA, YAW, bearing_and_depression
from assoc.hypotheses.search import UpdateContext

FloatArray = NDArray[np.float64]

_FAR_M = 20.0
"""1σ of places along the line of sight by the pitch's, metres, from which on the fit does not find the way."""
_STD_M, _STD_RAD = 3.0, 0.002
"""1σ of a pair's directions: metres across the line of sight or along the ground, and radians."""
_GAIN = 50.0
"""A: a track in the direction of a vehicle counts 4 nats, one that is not nothing."""
_MOST_STDS = 3.0
"""Corrections of more prior σ than this, both together, are not tried."""
_DISTINCT = 2.0
"""Starts differ by more than this many σ of a pair."""
_STARTS, _MAX_TRACKS, _MAX_TRIED = 3, 16, 400
"""Number of poses, and most tracks and corrections that are compared for them."""
_MIN_SQUARE = 1e-6


def aimed(context: UpdateContext, offset_s: float) -> list[FloatArray]:
    """Poses whose heading and pitch put most tracks of the newest frame where vehicles report to be, best first.

    Args:
        context: Tracks, reports and the prior.
        offset_s: δ by which they are compared.

    Returns:
        (9,) each; none where the camera looks so steeply that every start leads there.
    """
    history, row = context.history, context.history.n - 1
    rays = history.ray[row, context.columns[: context.live]]
    d = rays[np.isfinite(rays[:, 0])] @ history.R[row].T
    d = d[:: 1 + len(d) // _MAX_TRACKS]
    place, _ = context.log.extrapolated(float(history.t[row]) - offset_s)
    place = place[np.isfinite(place[:, 0])]
    to = np.column_stack([place, np.full(len(place), history.z[row])]) - history.p[row]
    if len(d) < 2 or len(to) < 2:
        return []
    seen, wanted = bearing_and_depression(d), bearing_and_depression(to)
    height, away = -float(to[0, 2]), np.linalg.norm(to, axis=1)
    std = context.prior.std[[YAW, PITCH]]
    if height <= 0.0 or std[1] * height / max(np.sin(np.median(wanted[:, 1])) ** 2, _MIN_SQUARE) < _FAR_M:
        return []
    sides = np.stack([_STD_M / away, _STD_M * height / away**2], axis=1) + _STD_RAD
    # (m, n, 2) yaw and pitch of each pair: a camera that is pitched up sees everything lower
    aim = (wanted[None] - seen[:, None]) * (1.0, -1.0)
    aim[..., 0] = (aim[..., 0] + np.pi) % (2.0 * np.pi) - np.pi
    tried = aim.reshape(-1, 2)
    cost = np.sum((tried / std) ** 2, axis=1)
    usual = np.argsort(cost, kind="stable")[:_MAX_TRIED]
    tried, cost = (each[usual[cost[usual] < _MOST_STDS**2]] for each in (tried, cost))
    # (c, m, n, 2) what is left of each pair under each aim
    left = (aim[None] - tried[:, None, None]) / sides
    near = np.min(np.sum(left**2, axis=3), axis=2)
    score = np.sum(np.log1p(_GAIN * np.exp(-0.5 * near)), axis=1) - 0.5 * cost
    found: list[FloatArray] = []
    apart = _DISTINCT * np.median(sides, axis=0)
    for k in np.argsort(-score, kind="stable").tolist():
        if all(np.any(np.abs(tried[k] - other[[YAW, PITCH]]) > apart) for other in found):
            start = np.zeros(THETA)
            start[OFFSET], start[[YAW, PITCH]] = offset_s, tried[k]
            found.append(start)
            if len(found) == _STARTS:
                break
    return found
