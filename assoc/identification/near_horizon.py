"""Names near the horizon, from angles: a box tells the direction of its vehicle well and its distance hardly.

A pixel of a camera 20 m up is 10 m long along the line of sight at 500 m, and a degree of tilt moves the place by half
of the distance. So boxes and reports are compared as the camera sees them, by bearing and by depression. Per pair and
angle, measured less expected,

    together: a(t) = φ + b(t) + noise,      apart: a(t) = c + r t + b(t) + noise,

φ what the camera's heading and tilt are off by, the same for all pairs; b a Gauss–Markov error (where in the box the
antenna is, bias, lens); c and r the offset and drift of two things that have nothing to do with each other. All are
Gaussian and enter linearly: a filter of b whitens a, 1 and t together, and with the Gram matrix G of the three

    ln p(together)/p(apart) = φ G_1a − φ² G_11/2 − hᵀA⁻¹h/2 + ln(|A|/|Λ|)/2,    A = G_[1,t] + Λ,  h = G_[1,t],a,

Λ the prior precision of (c, r). The names' marginals are averaged over a grid of φ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from assoc.evidence.motion import ReportLog
from assoc.geometry.ground import bearing_and_depression
from assoc.hypotheses.marginals import loopy_marginals
from assoc.identification.fleet_fit import log_assignments, unproven, weighed
from assoc.params import MANY_PAIRS, IdentifierParams
from assoc.records import CameraState, Observation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FLAT_SINE = 0.05
"""Sine of the depression, 3°, below which a ray tells no place on the ground."""
_LOOK_S, _MOSTLY = 2.0, 0.5
"""Time constant with which a look counts, seconds, and the share of flat rays from which the camera looks there."""
_EVERY_S = 0.5
"""Time between two comparisons, seconds: what is closer has the same errors."""
_MEMORY_S = 120.0
"""Time constant with which comparisons lose weight, seconds."""
_LOST_S = 10.0
"""A track that has not been seen for this long, seconds, is forgotten."""
_BIAS_TAU_S = 60.0
"""Correlation time of b, seconds."""
_BIAS_M, _LENS_RAD = 5.0, float(np.deg2rad(0.5))
"""1σ of b: of a position across the line of sight, metres, and of the camera's angles."""
_JITTER_PX, _JITTER_SHARE = 1.5, 0.02
"""1σ of a box's middle: pixels, and a share of its extent."""
_SPEED_STD_MPS = 0.5
"""1σ of the speed with which a report is extrapolated, m/s."""
_OLDEST_S = 90.0
"""Greatest age of a report that is extrapolated, seconds."""
_APART_MPS = 4.0
"""1σ of how fast two unrelated things move against each other, m/s."""
_MIN_DRIFT = 1e-4
"""Least 1σ of the drift of two unrelated things, rad/s."""
_MIN_RANGE_M = 10.0
"""Least distance that is taken for a vehicle, metres."""
_YAW_RAD = np.deg2rad(np.linspace(-15.0, 15.0, 61))
_TILT_RAD = np.deg2rad(np.linspace(-6.0, 6.0, 17))
"""Grid of φ, radians: errors of the camera's heading and of its tilt that are tried."""
_COARSER = 2
"""Step through that grid among more pairs than ``MANY_PAIRS``: costs fall to a quarter."""
_MARGIN_RAD = float(np.deg2rad(3.0))
"""Margin beyond the picture's border within which a vehicle counts as in view, radians: the heading may be off."""
_USUAL_HALF_VIEW = 0.5
"""Half the angle of view where it is unknown, radians."""
_HAS_BOX = 0.7
"""Prior ln odds of each pair of track and vehicle: one in view has a box more often than not."""
_LIKELY_NATS, _MAX_CELLS = 10.0, 150
"""Cells of the grid are left out that are this much less likely, nats, and beyond this many."""
_TILT_STD_RAD = float(np.deg2rad(2.0))
"""Prior 1σ of the tilt: near the horizon it is hardly ever calibrated."""
_SURE = 9.0
"""ln odds that film and telemetry belong together from which a name may be sure: three boxes are in the directions of
three of eight vehicles by chance."""
_MIN_FIT = -30.0
"""Least that a pair counts, nats: less than an operator's statement."""


@dataclass(frozen=True, slots=True)
class _Comparisons:
    """Comparisons of m tracks with n vehicles. Axes: track, vehicle, angle (bearing, depression)."""

    mean: FloatArray
    """(m, n, 2, 3) filtered b of the columns a, 1, t; t counts from the newest comparison."""
    var: FloatArray
    """(m, n, 2) its variance, rad²."""
    gram: FloatArray
    """(m, n, 2, 3, 3) G."""

    def select(self, rows: IntArray) -> _Comparisons:
        """Comparisons of some tracks; −1: of one without comparisons."""
        blank = _no_pairs(1, self.var.shape[1])
        return _Comparisons(
            np.concatenate([self.mean, blank.mean])[rows],
            np.concatenate([self.var, blank.var])[rows],
            np.concatenate([self.gram, blank.gram])[rows],
        )

    def later(self, dt: float) -> _Comparisons:
        """Return the comparisons with t counted from dt seconds later, and with less weight."""
        shift = np.eye(3)
        shift[2, 1] = -dt
        gram = shift @ self.gram @ shift.T * np.exp(-dt / _MEMORY_S)
        return _Comparisons(self.mean @ shift.T, self.var, gram)


def _no_pairs(m: int, n: int) -> _Comparisons:
    """Return comparisons in which nothing was compared yet."""
    return _Comparisons(np.zeros((m, n, 2, 3)), np.full((m, n, 2), np.inf), np.zeros((m, n, 2, 3, 3)))


@dataclass(frozen=True, slots=True)
class _Expected:
    """Expected directions of n vehicles as the camera sees them, by their reports."""

    angle: FloatArray
    """(n, 2) bearing and depression, radians, NaN unknown."""
    away_m: FloatArray
    """(n,) metres."""
    age_s: FloatArray
    """(n,) of their reports."""
    drift: FloatArray
    """(n, 2) 1σ of r, rad/s."""
    in_view: int
    """Number of vehicles whose bearing lies within the view or near its border."""
    spread: FloatArray
    """(2,) 1σ of c, radians: half the view's width; how far depressions of the vehicles differ."""


class NearHorizon:
    """The comparisons of the tracks so far."""

    def __init__(self, n: int, params: IdentifierParams) -> None:
        self._params = params
        self._track_id: IntArray = np.empty(0, np.int64)
        self._seen_s = np.empty(0)
        self._pairs = _no_pairs(0, n)
        self._t = -np.inf
        self._flat, self._looked_s = 0.0, -np.inf
        self.log_ratio = np.nan
        """ln odds that film and telemetry belong together, NaN before anything was compared."""

    def looks_there(self, t: float, observation: Observation, camera: CameraState) -> bool:
        """Tell whether most of the tracks of the last seconds were so near the horizon that angles tell who they are.

        Args:
            t: Time of the frame, seconds.
            observation: Its tracks.
            camera: The camera.
        """
        seen = observation.gap_s <= 0.0
        if camera.attitude_known and seen.any():
            ray = observation.ray_cam[seen]
            sine = -(ray @ camera.R_enu_cam[2]) / np.sqrt(np.sum(ray * ray, axis=1))
            flat = float(np.mean(sine < _FLAT_SINE))
            weight = float(np.exp((self._looked_s - t) / _LOOK_S))
            self._flat, self._looked_s = weight * self._flat + (1.0 - weight) * flat, t
        return self._flat > _MOSTLY

    def is_due(self, t: float, observation: Observation) -> bool:
        """Tell whether to compare tracks and reports again at a time, s: after half a second, or for a new track."""
        return t - self._t >= _EVERY_S or not np.isin(observation.track_id, self._track_id).all()

    @property
    def probability(self) -> float:
        """Probability that film and telemetry belong together; NaN before anything was compared."""
        return float(expit(self.log_ratio))

    def names(
        self, t: float, observation: Observation, camera: CameraState, log: ReportLog, stated: FloatArray
    ) -> FloatArray:
        """Take in a frame.

        Args:
            t: Its time, seconds.
            observation: Its tracks.
            camera: The camera.
            log: Reports up to then.
            stated: (m, n) what operators' statements count, nats.

        Returns:
            (m, n + 1) marginals of the tracks; the last column is "none of ours".
        """
        expected = _expected(t, camera, log)
        self._compare(t, observation, camera, expected)
        rows = self._rows(observation.track_id)
        p, total = _marginals(self._pairs.select(rows), expected, stated, float(np.deg2rad(self._params.yaw_std_deg)))
        if len(rows):
            self.log_ratio = total
        p = weighed(p, float(expit(total)))
        return p if total > _SURE else unproven(p)

    def _rows(self, track_id: IntArray) -> IntArray:
        """(m,) rows of tracks in the table, −1 unknown."""
        row_of = {key: row for row, key in enumerate(self._track_id.tolist())}
        return np.array([row_of.get(key, -1) for key in track_id.tolist()], np.int64)

    def _compare(self, t: float, observation: Observation, camera: CameraState, expected: _Expected) -> None:
        """Compare the tracks that are seen with all reports."""
        dt = t - self._t if np.isfinite(self._t) else 0.0
        self._t = t
        seen = np.flatnonzero(observation.gap_s <= 0.0)
        ids = observation.track_id[seen]
        kept = np.flatnonzero((self._seen_s > t - _LOST_S) | np.isin(self._track_id, ids))
        begun = ids[~np.isin(ids, self._track_id)]
        pairs = self._pairs.select(np.concatenate([kept, np.full(len(begun), -1)])).later(dt)
        self._track_id = np.concatenate([self._track_id[kept], begun])
        self._seen_s = np.concatenate([self._seen_s[kept], np.full(len(begun), t)])
        at = self._rows(ids)
        self._seen_s[at] = t
        extent = np.full((len(seen), 2), camera.px_rad)
        if observation.extent_rad is not None:
            extent = observation.extent_rad[seen]
        angle = bearing_and_depression(observation.ray_cam[seen] @ camera.R_enu_cam.T)
        self._pairs = _filtered(pairs, at, dt, angle, extent, camera.px_rad, expected)


def _expected(t: float, camera: CameraState, log: ReportLog) -> _Expected:
    """Directions in which the camera should see the vehicles at a time, seconds."""
    p, age = log.extrapolated(t, _OLDEST_S)
    to = np.column_stack([p, np.full(len(p), camera.ground_z)]) - camera.p_enu
    away = np.maximum(np.nan_to_num(np.hypot(to[:, 0], to[:, 1])), _MIN_RANGE_M)
    angle = np.where((np.abs(age) <= _OLDEST_S)[:, None], bearing_and_depression(to), np.nan)
    drift = _APART_MPS / away
    height = max(float(camera.p_enu[2]) - camera.ground_z, 0.0)
    ahead = camera.R_enu_cam[:, 2]
    front = np.isfinite(angle[:, 0]) & (to[:, :2] @ ahead[:2] > 0.0)
    depressions = float(np.std(angle[front, 1])) if np.count_nonzero(front) > 1 else 0.0
    half = float(np.arctan(camera.half_view[0])) if np.isfinite(camera.half_view[0]) else _USUAL_HALF_VIEW
    axis = np.arctan2(ahead[0], ahead[1])
    aside = np.abs(np.arctan2(np.sin(angle[:, 0] - axis), np.cos(angle[:, 0] - axis)))
    return _Expected(
        angle=angle,
        in_view=int(np.count_nonzero(aside < half + _MARGIN_RAD)),
        away_m=away,
        age_s=np.abs(age),
        drift=np.maximum(np.column_stack([drift, drift * height / away]), _MIN_DRIFT),
        spread=np.array([half, depressions]),
    )


def _filtered(
    pairs: _Comparisons,
    at: IntArray,
    dt: float,
    angle: FloatArray,
    extent: FloatArray,
    px_rad: float,
    expected: _Expected,
) -> _Comparisons:
    """The comparisons with one more.

    Args:
        pairs: Those before.
        at: (k,) rows of the tracks that are seen.
        dt: Seconds since the last one.
        angle: (k, 2) their bearings and depressions, radians.
        extent: (k, 2) how wide and high their boxes are, radians.
        px_rad: Radians per pixel.
        expected: Where the vehicles should be.
    """
    away, known = expected.away_m[None, :, None], np.isfinite(expected.angle[:, 0])[None, :, None]
    # the antenna is anywhere in the box: σ² = w²/12
    prior = extent[:, None, :] ** 2 / 12.0 + _LENS_RAD**2 + (_BIAS_M / away * _along(expected)) ** 2
    white = (_JITTER_SHARE * extent[:, None, :] + _JITTER_PX * px_rad) ** 2
    # b⁻ = λ b;  what a report is extrapolated by wanders with its age: d(σ_v age)² = 2 σ_v² age dt
    decay = np.exp(-dt / _BIAS_TAU_S)
    age_s = np.minimum(expected.age_s, _OLDEST_S)[None, :, None]
    aged = 2.0 * (_SPEED_STD_MPS / away * _along(expected)) ** 2 * age_s * dt
    mean, var = decay * pairs.mean[at], pairs.var[at]
    var = np.where(np.isfinite(var), decay**2 * var + (1.0 - decay**2) * prior, prior) + aged
    a = angle[:, None, :] - np.nan_to_num(expected.angle)[None]
    a[..., 0] = np.arctan2(np.sin(a[..., 0]), np.cos(a[..., 0]))
    e = np.stack([a, np.ones_like(a), np.zeros_like(a)], axis=-1) - mean
    s = var + white
    gain = np.where(known, var / s, 0.0)
    out = _Comparisons(pairs.mean.copy(), pairs.var.copy(), pairs.gram.copy())
    out.mean[at] = mean + gain[..., None] * e
    out.var[at] = var - gain * var
    out.gram[at] += np.where(known, 1.0 / s, 0.0)[..., None, None] * e[..., :, None] * e[..., None, :]
    return out


def _along(expected: _Expected) -> FloatArray:
    """(1, n, 2) how much of a length on the ground counts in each angle: all in bearing, sin δ of it in depression."""
    return np.column_stack([np.ones(len(expected.away_m)), np.nan_to_num(np.sin(np.abs(expected.angle[:, 1])))])[None]


def _marginals(
    pairs: _Comparisons, expected: _Expected, stated: FloatArray, yaw_std: float
) -> tuple[FloatArray, float]:
    """Marginals (m, n + 1) over the grid of φ, and ln odds of the fleet against chance."""
    m, n = pairs.var.shape[:2]
    if not m or not n:
        return np.concatenate([np.zeros((m, n)), np.ones((m, 1))], axis=1), 0.0
    G = pairs.gram
    offset = np.maximum(expected.spread[None, None], np.sqrt(np.where(np.isfinite(pairs.var), pairs.var, 1.0)))
    scale = np.stack([np.broadcast_to(offset, (m, n, 2)), np.broadcast_to(expected.drift[None], (m, n, 2))], axis=-1)
    # with regressors in units of their prior 1σ, Λ = I
    A = G[..., 1:, 1:] * scale[..., :, None] * scale[..., None, :] + np.eye(2)
    h = G[..., 1:, 0] * scale
    apart = 0.5 * np.linalg.slogdet(A)[1] - 0.5 * np.sum(h * np.linalg.solve(A, h[..., None])[..., 0], axis=-1)
    cells, every = [], 1 if m * n <= MANY_PAIRS else _COARSER
    yaw, tilt = _YAW_RAD[::every], _TILT_RAD[::every]
    for k, grid in enumerate((yaw, tilt)):
        phi = grid[:, None, None]
        cells.append(phi * G[..., k, 1, 0] - 0.5 * phi**2 * G[..., k, 1, 1] + apart[..., k])
    compared = G[..., 0, 1, 1] > 0.0
    score = cells[0][:, None] + cells[1][None]
    score = np.where(compared | (stated > 0.0), np.maximum(score, _MIN_FIT) + stated + _HAS_BOX, -1e4).reshape(-1, m, n)
    prior = -0.5 * ((yaw / yaw_std) ** 2)[:, None] - 0.5 * ((tilt / _TILT_STD_RAD) ** 2)[None]
    prior = (prior - logsumexp(prior)).ravel()
    # with the best vehicle of each track whoever else has it: at least the total
    bound = prior + np.sum(np.logaddexp(0.0, logsumexp(score, axis=2)), axis=1)
    likely = np.argsort(-bound)[:_MAX_CELLS]
    likely = likely[bound[likely] > bound[likely[0]] - _LIKELY_NATS]
    found, total = loopy_marginals(score[likely])
    value = prior[likely] + total
    weight = np.exp(value - logsumexp(value))
    # each assignment had its share before anything was seen
    chance = log_assignments(np.full(expected.in_view, _HAS_BOX), m)
    return np.asarray(np.einsum("c,cij->ij", weight, found)), float(logsumexp(value)) - chance
