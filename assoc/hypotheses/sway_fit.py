"""The sway of a camera, from the reports of the vehicles that it probably sees.

Boxes show how a camera turns within a fraction of a second, but vehicles that drive on together look like a camera that
turns slowly, and attitude that comes seldom or not at all leaves that open. Their reports tell the two apart, since a
turn displaces all of them at once. With the residuals r of a hypothesis's pairs at the reports' own times t, their
biases b, and the derivatives J of a place by θ and by the turn,

    r + J_θ Δθ + J_s s(t) − b = noise,     s ~ GP(0, σ² (1 + λ|Δt|) exp(−λ|Δt|)),     b ~ N(0, σ_b²)

is solved by least squares for s at knots, Δθ and b together (Matérn 3/2: Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, eq. 4.17).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import interpolated
from assoc.geometry.ground import OFFSET, THETA, ground_tracks
from assoc.geometry.sway import Sway, SwayPrior
from assoc.hypotheses.search import Hypothesis, UpdateContext, posing_pairs

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STEP_S = 0.25
"""Interval between two knots, seconds: what sways faster is seen by the boxes."""
_AHEAD_S = 1.0
"""Time beyond the newest frame, seconds, for which the sway is predicted, for the frames until the next update."""
_JITTER = 1e-4
"""Part of σ² that is added to each knot's variance, so that the covariance can be inverted."""
_MAX_SIGMAS = 5.0
"""Number of σ of the sway or θ beyond which the hypothesis is wrong."""
_MIN_VEHICLES = 3
"""Least number of vehicles: fewer do not tell a turn of the camera from what their own reports err."""
_MAX_PAIRS = 12
"""Most pairs that are fitted: more hardly tell more, and the work grows with them."""
_OUTLIER = 3.0
"""A residual of more σ weighs less."""
_ROUNDS = 2
"""Rounds of reweighting."""
_FREE = OFFSET
"""Numbers of θ before δ, which are fitted along: δ moves the vehicles themselves."""


def fit_sway(context: UpdateContext, hypothesis: Hypothesis, prior: SwayPrior) -> tuple[FloatArray, Sway] | None:
    """Fit sway and θ to the vehicles of a hypothesis.

    Args:
        context: What the update worked on, with the sway that the hypothesis was found under.
        hypothesis: Which tracks are which vehicles.
        prior: What may sway.

    Returns:
        θ (9,) and the sway, which continues beyond the newest frame; None: too few vehicles, or none explains them.
    """
    theta = hypothesis.theta
    rows, vehicles = (of[:_MAX_PAIRS] for of in posing_pairs(context, hypothesis.vehicle))
    if len(np.unique(vehicles)) < _MIN_VEHICLES:
        return None
    start, before = context.rows_under(theta)
    tracks = ground_tracks(context.history, start, theta, context.columns[rows], before)
    samples = context.samples
    report, pair = np.nonzero(samples.vehicle[:, None] == vehicles[None, :])
    t = samples.t[report] + theta[OFFSET]
    p, _, valid = interpolated(tracks, t, pair, context.gap_max_s)
    report, pair, t, p = report[valid], pair[valid], t[valid], p[valid]
    if not len(t):
        return None
    row = np.clip(np.searchsorted(tracks.t, t), 0, len(tracks.t) - 1)
    J = np.nan_to_num(tracks.jacobian[row, pair])
    by_turn, std = J[..., list(prior.axes)], prior.std
    # the residuals without any sway
    r = p - samples.p[report]
    if context.sway is not None:
        r = r - np.einsum("nij,nj->ni", J, context.sway.at(t))
    knots = np.arange(np.floor(tracks.t[0] / _STEP_S), np.ceil((tracks.t[-1] + _AHEAD_S) / _STEP_S) + 1) * _STEP_S
    A = np.concatenate(
        [_by_knots(by_turn, (t - knots[0]) / _STEP_S, len(knots)), J[..., :_FREE], _by_biases(pair, len(rows))], axis=2
    )
    part = context.prior.part_at(theta)
    n_sway, n = len(prior.axes) * len(knots), A.shape[2]
    precision = np.diag(np.full(n, 1.0 / context.noise.bias_std**2))
    precision[:n_sway, :n_sway] = np.kron(_precision(len(knots), prior.length_s), np.eye(len(prior.axes)) / std**2)
    posed = np.arange(n_sway, n_sway + _FREE)
    precision[posed, posed] = 1.0 / part.std[:_FREE] ** 2
    pull = np.zeros(n)
    pull[posed] = (part.mean - theta)[:_FREE] / part.std[:_FREE] ** 2
    pixel_m = np.nan_to_num(tracks.pixel_m[row, pair])
    variance = context.noise.white_var + context.noise.floor_var + context.noise.pixel_var * pixel_m**2
    x, H = _least_squares(A, -r, variance, precision, pull)
    s, own = x[:n_sway], precision[:n_sway, :n_sway]
    # ½ sᵀΛs + ½ ln|Λ + JᵀJ| − ½ ln|Λ|
    spent = 0.5 * (s @ own @ s + np.linalg.slogdet(H[:n_sway, :n_sway])[1] - np.linalg.slogdet(own)[1])
    sway = Sway(t=knots, off=s.reshape(-1, len(prior.axes)), prior=prior, cost=prior.counted * float(spent))
    fitted = theta + np.concatenate([x[posed], np.zeros(THETA - _FREE)])
    off = np.abs(fitted - part.mean)[:_FREE] / part.std[:_FREE]
    if not (np.all(np.abs(sway.off) < _MAX_SIGMAS * std) and np.all(off < _MAX_SIGMAS)):
        return None
    return fitted, sway


def _by_knots(by_turn: FloatArray, at: FloatArray, n_knots: int) -> FloatArray:
    """(N, 2, AK) derivatives by the knots, from those by what sways (N, 2, A) at times in units of a step (N,)."""
    columns = np.zeros((len(at), 2, n_knots, by_turn.shape[2]))
    k = np.clip(at.astype(np.int64), 0, n_knots - 2)
    w, each = (at - k)[:, None, None], np.arange(len(at))
    columns[each, :, k] = (1.0 - w) * by_turn
    columns[each, :, k + 1] = w * by_turn
    return columns.reshape(len(at), 2, -1)


def _by_biases(pair: IntArray, n_pairs: int) -> FloatArray:
    """(N, 2, 2P) derivatives by the biases of the residuals' pairs (N,)."""
    columns = np.zeros((len(pair), 2, n_pairs, 2))
    columns[np.arange(len(pair)), :, pair] = -np.eye(2)
    return columns.reshape(len(pair), 2, 2 * n_pairs)


def _least_squares(
    A: FloatArray, z: FloatArray, variance: FloatArray, precision: FloatArray, pull: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """x (n,) of A x = z, (N, 2, n) and (N, 2), and its precision (n, n).

    Residuals have variances (N,), x a Gaussian prior, and outliers are weighted down.
    """
    weight = 1.0 / variance
    x: FloatArray = np.zeros(len(pull))
    H = precision
    for _ in range(_ROUNDS):
        AtW = (A * weight[:, None, None]).reshape(-1, len(pull)).T
        # (Λ + AᵀWA) x = Λμ + AᵀWz
        H = precision + AtW @ A.reshape(-1, len(pull))
        x = np.asarray(np.linalg.solve(H, pull + AtW @ z.ravel()), np.float64)
        off = np.sum((z - A @ x) ** 2, axis=1) / variance
        weight = np.minimum(1.0, _OUTLIER**2 / np.maximum(off, 1e-9)) / variance
    return x, H


@lru_cache(maxsize=128)
def _precision(n_knots: int, length_s: float) -> FloatArray:
    """(K, K) inverse of the correlation of the sway's knots about one axis."""
    lag = np.sqrt(3.0) / length_s * _STEP_S * np.abs(np.subtract.outer(np.arange(n_knots), np.arange(n_knots)))
    return np.asarray(np.linalg.inv((1.0 + lag) * np.exp(-lag) + _JITTER * np.eye(n_knots)))
