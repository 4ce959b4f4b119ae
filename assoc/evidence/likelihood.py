"""Log likelihood ratio that a track is a vehicle against that the two are unrelated: recursion over blocks.

Model of a pair that belongs together, per axis: residual = b(t) + white noise, where b is a Gauss–Markov bias
(1σ σ_b, correlation time τ). The mean r̄ and scatter S of a block of k samples are then

    e = r̄ − M,   s = V + (σ_w² + σ_px²)/k + σ_floor²
    ln p₁ = ln N(e; 0, s) − (k − 1) ln 2πσ_w² − ln k − S/2σ_w²

with M, V mean and variance of the bias from a scalar Kalman filter over blocks; N has a wider second part, so that a
vehicle with a worse receiver than the others is not taken for clutter.

Where biases wander too fast for that, only their size counts, with a residual that is drawn again every τ' = 7 s:

    Δ ln ratio = Δt/τ' ln [0.9 N(r̄; 0, s) + 0.1 N(r̄; 0, 9 s)]/u,     s = 1.5² + σ_w²

with u the density of an unrelated place.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import Blocks
from assoc.geometry.ground import HEIGHT
from assoc.geometry.plane import squared_magnitude, to_complex, to_east_north

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

NEVER = -1e6
"""Score of a pair that was never compared."""
_FIRST_LEAST = -30.0
"""Least that a pair's first comparison counts, nats: one outlier must not rule a pair out for good."""
_MIN_KNOWN = 0.02
"""Share of a bias's variance that must have been learnt for anything to be known of it."""
_NO_REPORT = 2.0
"""A block without reports makes a change of owner this many nats less likely than a look would cost."""
_MAX_BORNE, _MAY_BE = 0.4, 3.0
"""Most that a pair gets in a block by bearing with a receiver that wanders, nats: it keeps a name, and makes none; and
how far behind its track's best pair it is at most for that to count."""
_WIDER = 5.0
"""The wider part of N has this many bias variances more."""
_LOG_NEAR, _LOG_WIDE = float(np.log(0.85)), float(np.log(0.15))
"""ln of the weights of the two parts of N: one vehicle in seven wanders more than the others."""
_AREA_PER_HEIGHT2, _MIN_AREA_M2, _MAX_AREA_M2 = 2.0, 50.0, 5e4
"""Ground in view for a camera at height h: 2 h², within these bounds, m²."""
_LOG_2PI = float(np.log(2.0 * np.pi))
"""ln 2π, of the normal density."""
PLACE_TAU_S = 7.0
"""Time after which a residual counts as another one where its size alone counts, not its course, seconds."""
_PLACE_VAR = 1.5**2
"""Variance of a residual by place alone, m²."""
_LOG_CLOSE, _LOG_FAR, _FARTHER = float(np.log(0.9)), float(np.log(0.1)), 9.0
"""ln shares of the residuals that are of that size and larger ones, and how much larger their variance is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Parts that the residuals are made of."""

    white_var: float
    """σ_w², m²."""
    bias_std: float
    """σ_b, metres."""
    decay: float
    """Correlation of the bias from one block to the next."""
    floor_var: float
    """σ_floor², m²."""
    pixel_var: float
    """Variance that is assumed of a box's centre, px²."""
    height: float
    """Height of the camera above the ground as reported, metres."""
    increment_max: float
    """Most that one block may count for or against a pair, nats."""
    in_view_bonus: FloatArray
    """(n,) what each block adds for a vehicle that should be in view, nats: biases wander in ways that no model has."""
    bears_each: bool = False
    """True if each pair has that for itself, as where no attitude is known: it is the camera's sway that they bear
    with."""
    place_rate: float = 0.0
    """Share of its evidence that a residual brings in a block where its size alone counts; 0: its course counts."""

    def log_area_at(self, theta: FloatArray) -> float:
        """ln of twice the ground area in view, m², under a pose correction (9,): where an unrelated report may be."""
        height = max(self.height + float(theta[HEIGHT]), 1.0)
        return float(np.log(2.0 * min(max(_AREA_PER_HEIGHT2 * height**2, _MIN_AREA_M2), _MAX_AREA_M2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PairState:
    """State of the recursion for T tracks × n vehicles."""

    score: FloatArray
    """(T, n) accumulated ln ratio."""
    mean: FloatArray
    """(T, n, 2) bias, metres."""
    var: FloatArray
    """(T, n) its variance, m²; inf: nothing known beyond the prior."""
    seen: BoolArray
    """(T, n) whether any block was compared."""
    inherited: FloatArray
    """(T, n) part of the score that the track had as another vehicle, before it became this one."""


def initial_state(n_tracks: int, n_vehicles: int) -> PairState:
    """State before any evidence."""
    shape = (n_tracks, n_vehicles)
    return PairState(
        score=np.full(shape, NEVER),
        mean=np.zeros((*shape, 2)),
        var=np.full(shape, np.inf),
        seen=np.zeros(shape, np.bool_),
        inherited=np.zeros(shape),
    )


def bound_variance(state: PairState, bias_std: float) -> PairState:
    """The state with nothing known of a bias meaning the prior: variances at most σ_b²."""
    return replace(state, var=np.minimum(state.var, bias_std**2))


def moved_state(state: PairState, shift: FloatArray, bias_std: float) -> PairState:
    """The state as it would be had all residuals always been a shift further, as under a pose that was always another.

    A bias M that is known to V stands for a mean residual x = M/g, g = 1 − V/σ_b², of which ln N(x; 0, σ_b²/g) is in
    the score. So M becomes M + g d, and the score changes by ln N(x + d) − ln N(x), N as in :func:`log_density`.

    Args:
        state: With variances of σ_b² at most.
        shift: (2,) d, metres.
        bias_std: σ_b, metres.
    """
    prior = bias_std**2
    known = np.clip(1.0 - state.var / prior, _MIN_KNOWN, 1.0)
    mean = to_complex(state.mean)
    x, d = mean / known, complex(shift[0], shift[1])
    s, V = prior / known, np.asarray(prior)
    gain = log_density(squared_magnitude(x + d), s, V) - log_density(squared_magnitude(x), s, V)
    told = state.seen & (known > _MIN_KNOWN)
    return replace(
        state,
        score=np.where(told, state.score + np.maximum(gain, _FIRST_LEAST), state.score),
        mean=to_east_north(np.where(told, mean + known * d, mean)),
    )


def block_constants(blocks: Blocks, noise: Noise) -> tuple[FloatArray, FloatArray]:
    """(B, T, n) variance of the block mean about the bias, and the part of ln p₁ that does not depend on e and V."""
    k, box = np.maximum(blocks.count, 1.0), blocks.box_var[:, :, None]
    white = noise.white_var + box
    # boxes scatter under either hypothesis
    scatter = np.maximum(blocks.scatter - 2.0 * (k - 1) * box, 0.0)
    constant = -(k - 1) * np.log(2 * np.pi * white) - np.log(k) - scatter / (2 * white)
    return white / k + noise.floor_var + blocks.extra_var, constant


def log_density(e2: FloatArray, s: FloatArray, V: FloatArray) -> FloatArray:
    """ln of (1 − w) N(e; 0, s) + w N(e; 0, s'), s' with six times the bias variance V: some wander more than others.

    Args:
        e2: |e|², m².
        s: Variance per axis, m², the bias's included.
        V: That of the bias, m².
    """
    wide = s + _WIDER * V
    near = _LOG_NEAR - np.log(s) - e2 / (2 * s)
    return np.asarray(np.logaddexp(near, _LOG_WIDE - np.log(wide) - e2 / (2 * wide)) - _LOG_2PI)


def place_ratio(e2: FloatArray, white_var: float, log_area: float) -> FloatArray:
    """ln [0.9 N(e; 0, s) + 0.1 N(e; 0, 9 s)]/u: how much likelier a place is for the vehicle than for a stranger.

    Args:
        e2: |e|², m².
        white_var: σ_w², m².
        log_area: −ln u.
    """
    s = _PLACE_VAR + white_var
    close = _LOG_CLOSE - np.log(s) - e2 / (2 * s)
    far = _LOG_FAR - np.log(_FARTHER * s) - e2 / (2 * _FARTHER * s)
    return np.asarray(np.logaddexp(close, far) - _LOG_2PI + log_area)


def _first_null(blocks: Blocks, log_area: float) -> FloatArray:
    """(B, T, n) ln p₀ of a first comparison: for one sample it is a uniform density over the ground in view."""
    return np.asarray(blocks.log_null * (1.0 - 1.0 / np.maximum(blocks.count, 1.0)) - log_area)


def run_filter(
    blocks: Blocks, theta: FloatArray, state: PairState, noise: Noise, log_switch: FloatArray, fold: int = 0
) -> tuple[PairState, PairState]:
    """Carry the evidence through all blocks.

    Args:
        blocks: Residuals linearised near ``theta``.
        theta: (9,) pose correction to evaluate at.
        state: State before the first block.
        noise: Noise levels.
        log_switch: (B, T) ln chance that the track changed its owner in that block.
        fold: Number of blocks after which a second copy of the state is wanted.

    Returns:
        State after the last block, state after ``fold`` blocks.
    """
    mean_r = to_complex(blocks.mean + (blocks.jacobian @ (theta - blocks.theta))[:, :, None, :])
    variance, constant = block_constants(blocks, noise)
    has_all = blocks.count > 0
    reported = np.asarray(has_all.any(axis=(1, 2)))
    decay, prior = noise.decay, noise.bias_std**2
    null, bonus = _first_null(blocks, noise.log_area_at(theta)), noise.in_view_bonus
    # each block as if it were the first of the pair
    log_p_first = constant + log_density(squared_magnitude(mean_r), prior + variance, np.asarray(prior))
    placed = None
    if noise.place_rate:
        placed = place_ratio(squared_magnitude(mean_r), noise.white_var, noise.log_area_at(theta))
    restart = np.clip(log_p_first - null if placed is None else placed, _FIRST_LEAST, noise.increment_max)
    restart_gain = prior / (prior + variance)
    M_first, V_first = restart_gain * mean_r, prior - restart_gain * prior
    renewed = (1.0 - decay**2) * prior + blocks.jump_var
    M, V, L, seen, inherited = to_complex(state.mean), state.var, state.score, state.seen, state.inherited
    folded = state
    for b in range(len(mean_r)):
        if b == fold:
            folded = PairState(score=L, mean=to_east_north(M), var=V, seen=seen, inherited=inherited)
        # M⁻ = λM, V⁻ = λ²V + (1 − λ²)σ_b² + a jump of the vehicle's own reports
        M, V = decay * M, decay**2 * V + renewed[b]
        # the track may have been another vehicle until now: its evidence, the chance of a change
        best = np.max(L, axis=1, initial=0.0)[:, None]
        before = best + log_switch[b][:, None]
        unheard = before - _NO_REPORT
        no_report, other = np.where(seen, np.logaddexp(L, unheard), L), seen & (unheard > L)
        if not reported[b]:
            L, inherited = no_report, np.where(other, best, inherited)
            continue
        has, e = has_all[b], mean_r[b] - M
        s = V + variance[b]
        log_p = constant[b] + log_density(squared_magnitude(e), s, V)
        gain_later = log_p - blocks.log_null[b]
        # what receivers wander costs all pairs of a track alike less, so that it tells nothing between vehicles, and
        # brings those nothing that the track may well be
        compared = np.where(has & seen, L, NEVER)
        near = compared >= np.maximum(compared.max(axis=1, keepdims=True, initial=NEVER) - _MAY_BE, NEVER / 2)
        most = np.where(near, gain_later, -np.inf).max(axis=1, keepdims=True, initial=-np.inf)
        raised = gain_later if noise.bears_each else most
        gain_later = gain_later + np.minimum(bonus, np.maximum(_MAX_BORNE - raised, 0.0))
        later = np.minimum(np.maximum(gain_later, -noise.increment_max), noise.increment_max)
        first = np.maximum(log_p - null[b], _FIRST_LEAST)
        if placed is not None:
            later, first = noise.place_rate * placed[b], np.maximum(placed[b], _FIRST_LEAST)
        stay = np.where(seen, L + later, first)
        # another vehicle begins with a first comparison
        switch = np.where(seen, before + restart[b], NEVER)
        gain = V / s
        M_stay, V_stay = M + gain * e, V - gain * V
        changed = switch > stay
        M = np.where(has, np.where(changed, M_first[b], M_stay), M)
        V = np.where(has, np.where(changed, V_first[b], V_stay), V)
        inherited = np.where(np.where(has, changed, other), best, inherited)
        L = np.where(has, np.logaddexp(stay, switch), no_report)
        seen = seen | has
    final = PairState(score=L, mean=to_east_north(M), var=V, seen=seen, inherited=inherited)
    return final, final if fold >= len(mean_r) else folded


def _arrays(state: PairState) -> dict[str, NDArray[Any]]:
    return {field.name: getattr(state, field.name) for field in fields(PairState)}


def select_tracks(state: PairState, columns: NDArray[np.int64]) -> PairState:
    """The state of some tracks."""
    return PairState(**{name: array[columns] for name, array in _arrays(state).items()})


def replace_tracks(state: PairState, columns: NDArray[np.int64], part: PairState) -> PairState:
    """The state with some tracks replaced."""
    copies = {name: array.copy() for name, array in _arrays(state).items()}
    for name, array in _arrays(part).items():
        copies[name][columns] = array
    return PairState(**copies)


def widen_tracks(state: PairState, n_tracks: int) -> PairState:
    """The state widened to more tracks."""
    extra = n_tracks - len(state.score)
    if extra <= 0:
        return state
    more = _arrays(initial_state(extra, state.score.shape[1]))
    return PairState(**{name: np.concatenate([array, more[name]]) for name, array in _arrays(state).items()})


def reset_tracks(state: PairState, columns: NDArray[np.int64], mean: FloatArray, var: FloatArray) -> PairState:
    """The state with some tracks set back to the beginning, their bias filters started from (n, 2) and (n,)."""
    fresh = initial_state(len(columns), state.score.shape[1])
    start = replace(fresh, mean=np.broadcast_to(mean, fresh.mean.shape), var=np.broadcast_to(var, fresh.var.shape))
    return replace_tracks(state, columns, start)
