"""Do film and telemetry belong together: does the fleet as a whole explain the boxes better than chance?

Names are meaningless where the film is of another place or minute, or the camera looks elsewhere than the mission says;
single vehicles may still fit single boxes. Against "the film is of something else" stands the evidence of all matched
pairs together: with L_ij the ln ratios of the pairs in the window alone, o_j the prior odds of each vehicle to have a box,
and the pose integrated out,

    V = Σ (L_ij + o_j) − ½ θᵀΛθ + ½ ln|Λ| − ½ ln|Λ + JᵀJ| − ln Z,    Z = Σ_k m!/(m − k)! e_k(exp o).

Z sums the prior weights of all assignments of m tracks (e_k: elementary symmetric polynomial), so that V is the ln ratio
of two normalised densities, up to one assignment standing for all. A vehicle that should be in view and matches no
box counts against the fit, a vehicle that need not be in view does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import bound_variance, initial_state, run_filter
from assoc.hypotheses.search import Hypothesis, UpdateContext

__all__ = ["FleetFit", "log_assignments", "log_evidence"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_PRIOR_LOG_ODDS = 0.0
"""ln odds, before any evidence, that film and telemetry belong together. They usually do, but two vehicles near two
boxes must not be enough."""
_FITS = 0.5
"""Probability from which what is learnt from names may be trusted."""
_MOST, _LEAST = 30.0, -30.0
"""Bounds of the remembered evidence, nats: so that what no longer fits is noticed within seconds."""
_FORGET_S, _DOUBT_S = 20.0, 4.0
"""Time constants τ₁ and τ₂, seconds: tracks break and vehicles are hidden for moments."""
_LONGEST_STEP_S = 1.0
"""Time that counts between two updates, seconds: what was not seen speaks neither for nor against a fit."""


def log_assignments(log_odds: FloatArray, tracks: int) -> float:
    """ln Σ_k m!/(m − k)! e_k(exp o): the prior weights of all one-to-one assignments of m tracks, summed.

    Args:
        log_odds: (n,) o, ln odds of each vehicle to be any given track.
        tracks: m.
    """
    log_e = np.full(len(log_odds) + 1, -np.inf)
    log_e[0] = 0.0
    for odds in log_odds:
        # e_k with one more: e_k + e_{k−1} exp o
        log_e[1:] = np.logaddexp(log_e[1:], log_e[:-1] + odds)
    k = np.arange(min(tracks, len(log_odds)) + 1)
    return float(np.logaddexp.reduce(log_e[k] + gammaln(tracks + 1) - gammaln(tracks - k + 1)))


def _paired(blocks: Blocks, theta: FloatArray, rows: IntArray, vehicles: IntArray) -> Blocks:
    """Blocks of K pairs alone, as K tracks × 1 vehicle, with the residuals at θ."""
    moved = blocks.jacobian[:, rows] @ (theta - blocks.theta)
    return replace(
        blocks,
        count=blocks.count[:, rows, vehicles, None],
        mean=(blocks.mean[:, rows, vehicles] + moved)[:, :, None],
        scatter=blocks.scatter[:, rows, vehicles, None],
        log_null=blocks.log_null[:, rows, vehicles, None],
        extra_var=blocks.extra_var[:, rows, vehicles, None],
        jump_var=blocks.jump_var[:, vehicles, None],
        pixel_var=blocks.pixel_var[:, rows],
        jacobian=blocks.jacobian[:, rows],
        heading=blocks.heading[rows, vehicles, None],
        theta=theta,
    )


def log_evidence(context: UpdateContext, best: Hypothesis) -> float:
    """V, from the window alone: what was remembered of the tracks, and bonuses that fit any film, are left out.

    Args:
        context: What the update worked on.
        best: Its best hypothesis.
    """
    rows = np.flatnonzero(best.vehicle >= 0)
    vehicles = best.vehicle[rows]
    log_odds = context.log_odds + context.in_view
    reporting = np.any(best.blocks.count > 0.0, axis=(0, 1))
    blocks = _paired(best.blocks, best.theta, rows, vehicles)
    noise = replace(context.noise, in_view_bonus=np.zeros(1))
    start = bound_variance(initial_state(len(rows), 1), noise.bias_std)
    switch = context.log_switch[:, rows]
    final = run_filter(blocks, best.theta, start, noise, switch)[0]
    score = (final.score + blocks.heading)[:, 0] + log_odds[vehicles]
    pose = best.value - float(np.sum(best.score[rows, vehicles]))
    # a pair that is compared nowhere in the window, or contradicts itself there, may as well be apart
    pairs = np.sum(np.maximum(score, 0.0), where=final.seen[:, 0])
    return float(pairs) + pose - log_assignments(log_odds[reporting], context.live)


class FleetFit:
    """The probability that film and telemetry belong together, over time."""

    def __init__(self) -> None:
        self._log_ratio = 0.0
        self._t = -np.inf

    @property
    def probability(self) -> float:
        """That they belong together."""
        return float(expit(self._log_ratio + _PRIOR_LOG_ODDS))

    @property
    def fits(self) -> bool:
        """Whether they rather do than not."""
        return self.probability >= _FITS

    def update(self, t: float, evidence: float) -> None:
        """Take in the evidence of one update.

        Better evidence than S, the remembered one, counts at once. While V is worse but speaks for a fit,
        S ← V + (S − V) exp(−Δt/τ₁); while it speaks against one, S ← S + V Δt/τ₂; where it says nothing, V = 0, S stays.

        Args:
            t: Time, seconds.
            evidence: V.
        """
        now = float(np.clip(evidence, _LEAST, _MOST))
        dt = min(t - self._t, _LONGEST_STEP_S)
        self._t = t
        if now > 0.0:
            kept = now + (self._log_ratio - now) * float(np.exp(-dt / _FORGET_S))
        else:
            kept = max(self._log_ratio + now * dt / _DOUBT_S, _LEAST)
        self._log_ratio = max(now, kept)

    def limited(self, p: FloatArray, stated: BoolArray) -> FloatArray:
        """Marginals (m, n + 1) in which names count only as far as film and telemetry belong together, or are stated."""
        named = p[:, :-1] * np.where(stated, 1.0, self.probability)[:, None]
        return np.concatenate([named, 1.0 - np.sum(named, axis=1, keepdims=True)], axis=1)
