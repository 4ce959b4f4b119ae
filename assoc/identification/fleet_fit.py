"""Fit of film and telemetry: does the fleet as a whole explain the boxes better than chance?

Names are meaningless where the film is of another place or minute, or the camera looks elsewhere than the mission says;
single vehicles may still fit single boxes. Against "the film is of something else" stands the evidence of all matched
pairs together: with L_ij the ln ratios of the pairs in the window alone, o_j the prior odds of each vehicle to have a
box, and the pose integrated out,

    V = Σ (L_ij + o_j) − ½ θᵀΛθ + ½ ln|Λ| − ½ ln|Λ + JᵀJ| − ln Z,    Z = Σ_k m!/(m − k)! e_k(exp o).

Z sums the prior weights of all assignments of m tracks (e_k: elementary symmetric polynomial), so that V is the ln
ratio of two normalised densities, up to one assignment standing for all. A vehicle that should be in view and matches
no box counts against the fit, a vehicle that need not be in view does not. Each second of a pair brings 0.3 nats less,
which any two that drive alike bring.

Receivers whose errors wander faster than any model of them make every pair lose by its motion although all boxes stay
where the vehicles report to be. So V is also taken from place alone, with a residual that is drawn again every few
seconds (:func:`assoc.evidence.likelihood.place_ratio`). What chance reaches among these very boxes is measured with
decoys, for each of the two: the same reports, turned vehicle by vehicle.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import PLACE_TAU_S, Noise, bound_variance, initial_state, place_ratio, run_filter
from assoc.geometry.ground import OFFSET, THETA
from assoc.hypotheses.pose import is_gross
from assoc.hypotheses.search import Hypothesis, UpdateContext, aimed, refine
from assoc.hypotheses.sway_fit import fit_sway

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_PRIOR_LOG_ODDS = -3.0
"""ln odds, before any evidence, that film and telemetry belong together. They usually do; but chance is measured by a
few decoys alone, and the luckiest of many moments must not be enough for a name."""
_FITS = 0.5
"""Probability from which what is learnt from names may be trusted."""
_MAX_EVIDENCE, _MIN_EVIDENCE = 15.0, -30.0
"""Bounds of the remembered evidence, nats: so that what no longer fits is noticed within seconds."""
_FORGET_S, _DOUBT_S, _BLIND_S = 8.0, 2.0, 8.0
"""Time constants τ₁, τ₂, and τ₂ of a camera that shakes, seconds: tracks break and vehicles are hidden for moments."""
_CLEAR = 40.0
"""Evidence, nats, that no decoy reaches among a handful of vehicles: it is not compared with any."""
_TOLL = 0.7
"""Evidence that a second of a matched pair must bring, nats, before film and telemetry fit; the right brings 1 to 3."""
_TOLL_MOST = 30.0
"""Most that all pairs together must bring, nats: what chance brings does not grow with time, and vehicles on straight
lanes tell little more after a while."""
_ALIKE = 0.3
"""Evidence that a second brings to any pair that drives alike, nats: vehicles on two roads do so for a while."""
_BETTER = 15.0
"""Evidence by which a fleet that is there explains the boxes better than chance, nats, however wrong the pose is."""
_RARE = 3.0
"""Factor on the share of a gross error before film and telemetry fit: it is tried again and again."""
_SURE = 10.0
"""Evidence beyond all that by which another camera must explain the boxes before it replaces the mission's, nats."""
_DECOYS, _DECOYS_FIRST = 6, 3
"""Number of decoys that are remembered, one an update, and of those that are tried at once at the beginning."""
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
"""Angle whose multiples never come near one another, radians."""
_LIKELY_IN_VIEW = 0.3
"""Chance of being in view from which a vehicle counts for the fleet's centre."""
_ONE, _SEVERAL = 1.0, 3.0
"""Vehicles expected in view from which what was remembered gives way to what is seen, and from which it does wholly:
one or two at the edge of the picture tell little, either way."""
_NEWS_BLOCKS = 4
"""Blocks of the window in which a report must have been compared lately: reports come each second or seldomer."""
_PLACE_SHARE = 10.0
"""Evidence by place alone on top, nats: receivers seldom err like that, and films of the same formation show
vehicles near the right places too."""
_PLACED_S, _GROWN_S, _GROWTH = 1.0, 4.0, 6.0
"""A fit rests on places alone for this long, seconds; on how vehicles drive once it explains this much more, nats, or
for this long, seconds, as where few are in view."""
_UNPROVEN = 0.89
"""Most that a name can have until then: less than what counts as sure."""
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
        box_var=blocks.box_var[:, rows],
        jacobian=blocks.jacobian[:, rows],
        heading=blocks.heading[rows, vehicles, None],
        theta=theta,
    )


@dataclass(frozen=True, slots=True)
class FitEvidence:
    """Evidence that film and telemetry belong together, nats."""

    course: float
    """V, from the window alone: what was remembered of the tracks, and bonuses that fit any film, are left out."""
    place: float
    """V from place alone."""
    strangers: float = 0.0
    """Amount by which Z is larger than with as many tracks as vehicles: what V has paid for chance among the others."""


def evidence_of(context: UpdateContext, best: Hypothesis) -> FitEvidence:
    """V by course and by place of the best hypothesis.

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
    compared = np.sum(blocks.count[:, :, 0] > 0.0, axis=0)
    course = (final.score + blocks.heading)[:, 0] - _ALIKE * compared + log_odds[vehicles]
    place = _log_place(blocks, noise, best.theta, context.block_s) + log_odds[vehicles]
    pose = best.value - best.unseen - float(np.sum(best.score[rows, vehicles]))
    swaying = 0.0 if context.sway is None else context.sway.cost
    # a pair that is compared nowhere in the window, or contradicts itself there, may as well be apart
    pairs, places = (float(np.sum(np.maximum(score, 0.0), where=final.seen[:, 0])) for score in (course, place))
    odds = log_odds[reporting]
    assignments = log_assignments(odds, context.live)
    strangers = assignments - log_assignments(odds, min(context.live, len(odds)))
    rest = pose - swaying - assignments
    return FitEvidence(pairs + rest, places + rest, strangers)


def _log_place(blocks: Blocks, noise: Noise, theta: FloatArray, block_s: float) -> FloatArray:
    """(K,) L of K pairs from place alone."""
    e2 = np.sum(blocks.mean[:, :, 0] ** 2, axis=-1)
    ratio = place_ratio(e2, noise.white_var, noise.log_area_at(theta))
    return np.asarray(np.sum(ratio, axis=0, where=blocks.count[:, :, 0] > 0.0) * block_s / PLACE_TAU_S)


def weighed(p: FloatArray, share: FloatArray | float) -> FloatArray:
    """Marginals (m, n + 1) whose names count by a share, one number or (m, 1); the rest is "none of ours"."""
    named = p[:, :-1] * share
    return np.concatenate([named, 1.0 - np.sum(named, axis=1, keepdims=True)], axis=1)


def unproven(p: FloatArray) -> FloatArray:
    """Marginals (m, n + 1) in which no name is sure: 0.89 at most."""
    top = np.max(p[:, :-1], axis=1, keepdims=True, initial=0.0)
    return weighed(p, np.minimum(1.0, _UNPROVEN / np.maximum(top, _UNPROVEN)))


def decoy_evidence(context: UpdateContext, number: int) -> FitEvidence:
    """V of a fleet that is not there: each vehicle's reports are turned about the centre by an angle of their own.

    It has the real one's speeds, distances from the centre and moments of turning, but not its formation, which no
    correction of the pose gives back. What it reaches is what chance reaches among these boxes.

    Args:
        context: What the update works on.
        number: Of the decoy; each has other angles.
    """
    log = context.log
    place, _ = log.extrapolated(float(context.history.t[context.history.n - 1]))
    counted = np.isfinite(place[:, 0]) & (context.view > _LIKELY_IN_VIEW)
    if not counted.any():
        return FitEvidence(0.0, 0.0)
    centre = np.mean(place[counted], axis=0)
    # by rank of the distance, so that the order of the vehicles does not matter
    rank = np.argsort(np.argsort(np.hypot(*(place - centre).T), kind="stable"), kind="stable")
    angle = _GOLDEN_ANGLE * (1.0 + rank + log.n_vehicles * number)
    decoy = context.without_memory().with_reports(log.turned(centre, angle))
    starts = [np.zeros(THETA), *aimed(decoy, 0.0)]
    found = max((refine(decoy, start) for start in starts), key=lambda hypothesis: hypothesis.value)
    fitted = None if context.sway is None else fit_sway(decoy, found, context.sway.prior)
    if fitted is None:
        return evidence_of(decoy, found)
    decoy = replace(decoy, sway=fitted[1])
    return evidence_of(decoy, refine(decoy, fitted[0]))


def _toll(best: Hypothesis) -> float:
    """Evidence that the pairs must bring, nats: by the seconds, summed over pairs, in which a report was compared."""
    rows = np.flatnonzero(best.vehicle >= 0)
    return min(_TOLL * int(np.sum(best.blocks.count[:, rows, best.vehicle[rows]] > 0.0)), _TOLL_MOST)


class FleetFit:
    """The probability that film and telemetry belong together, over time.

    Args:
        proves: Names may become sure; not so where vehicles are compared by place alone, as formations repeat.
    """

    def __init__(self, *, proves: bool = True) -> None:
        self._proves = proves
        self._log_ratio = 0.0
        self._t = -np.inf
        self._evidence = 0.0
        self._decoys: deque[FitEvidence] = deque(maxlen=_DECOYS)
        self._tried = 0
        self._mean = np.zeros(THETA)
        self._told = 0.0
        self._fits_since_s, self._by_place, self._grown = np.inf, 0.0, False
        """Time since which they fit, what was explained within the first moments of it, and whether more is by now."""

    @property
    def probability(self) -> float:
        """Probability that they belong together, NaN before the first update."""
        return float("nan") if self._t == -np.inf else float(expit(self._log_ratio + _PRIOR_LOG_ODDS))

    @property
    def clear(self) -> bool:
        """True if they fit so well that nothing else needs to be tried."""
        return self._evidence > _CLEAR

    @property
    def fits(self) -> bool:
        """True if they rather do than not."""
        return self.probability >= _FITS

    @property
    def _lucky(self) -> float:
        """V by course of the luckiest decoy, 0 at least, nats."""
        return max([decoy.course for decoy in self._decoys] + [0.0])

    @property
    def usual(self) -> bool:
        """True if they have been proved to fit without a gross error."""
        return self._grown and not is_gross(self._mean)

    def explains(self, context: UpdateContext, best: Hypothesis) -> bool:
        """Tell whether a hypothesis explains the boxes better than chance.

        Args:
            context: What the update works on.
            best: The hypothesis.
        """
        return evidence_of(context, best).course > self._lucky + _toll(best)

    def update(self, t: float, context: UpdateContext, best: Hypothesis, *, steady: bool) -> None:
        """Take in the results of one update.

        Args:
            t: Time, seconds.
            context: What it worked on.
            best: Its best hypothesis.
            steady: Whether the camera's attitude is known and a gimbal holds it.
        """
        found = evidence_of(context, best)
        self._evidence = found.course
        for _ in range(0 if self.clear else 1 if self._decoys else _DECOYS_FIRST):
            self._decoys.append(decoy_evidence(context, self._tried))
            self._tried += 1
        decoys = np.array([decoy.course for decoy in self._decoys] or [self._evidence])
        lucky = 0.0 if self.clear else self._lucky
        lucky_place = max([decoy.place for decoy in self._decoys] + [0.0])
        # many starts find what fits by chance, the more the longer they look: the fleet itself gains far more
        part = context.prior.part_at(best.theta)
        rare = -_RARE * part.log_share
        # errors of seconds or right angles do not come in flight: what fitted without must not be saved by one
        same = self.fits and (not rare or np.array_equal(part.mean, self._mean))
        # what V has paid for chance among strangers need not be paid again, as far as chance does fall short by it
        paid = min(max(-float(np.median(decoys)), 0.0), found.strangers)
        toll = 0.0 if same else max(_toll(best) - paid, 0.0) + rare
        better = self._evidence - lucky - toll
        if better > 0.0:
            self._mean = part.mean
        by_place = found.place - lucky_place - _PLACE_SHARE
        # place alone keeps what its course has shown but shows nothing: formations come to the same places again
        if by_place > 0.0 and not rare and self.fits:
            better = max(better, by_place)
        # a free sway follows the fleet over many updates, a decoy's is fitted once: no measure of what chance reaches
        free = context.sway is not None and context.sway.prior.free
        usual = self._evidence if free else float(np.median(decoys))
        chance = None if steady else usual - lucky - toll
        # late video shows nothing yet of the newest reports
        late = int(np.ceil(max(best.theta[OFFSET], 0.0) / context.block_s))
        news = bool(np.any(best.blocks.count[-_NEWS_BLOCKS - late :] > 0.0))
        told = float(np.clip((np.sum(context.view) - _ONE) / (_SEVERAL - _ONE), 0.0, 1.0))
        # nor may one end the doubt because with it the fleet would be out of view
        self._told = max(told, self._told) if rare and not same else told
        self.add_evidence(t, better if news else 0.0, chance, self._told)
        self._follow_growth(t)

    def _follow_growth(self, t: float) -> None:
        """Note whether the vehicles have driven like the tracks for some time, or have only been at their places."""
        if not self.fits:
            self._fits_since_s, self._by_place, self._grown = np.inf, 0.0, False
            return
        self._fits_since_s = min(self._fits_since_s, t)
        if t - self._fits_since_s <= _PLACED_S:
            self._by_place = max(self._by_place, self._evidence)
        elif self._proves and not self._grown:
            self._grown = self._evidence > self._by_place + _GROWTH or t - self._fits_since_s > _GROWN_S

    def is_surpassed(self, context: UpdateContext, best: Hypothesis, evidence: float, log_share: float) -> bool:
        """Tell whether another camera than the mission's explains the boxes, clearly and far better.

        Args:
            context: What the update worked on, with the other camera.
            best: Its best hypothesis.
            evidence: V of it.
            log_share: ln of the other camera's share in the prior.
        """
        lucky = max(self._lucky, self._evidence)
        rare = -_RARE * (log_share + context.prior.part_at(best.theta).log_share)
        return evidence - lucky - _toll(best) - rare > _SURE

    def add_evidence(self, t: float, evidence: float, chance: float | None, told: float = 1.0) -> None:
        """Take in the evidence of one update.

        Better evidence than S, the remembered one, counts at once, S ← V. While V is worse but speaks for a fit,
        S ← V + (S − V) exp(−Δt/τ₁), and while it speaks against one with τ₂; with V = 0, no news, S stays. Where the
        camera shakes or its attitude is unknown it speaks against a fit only as far as chance does as well, with τ₂/w
        of a longer τ₂, w = 1 − (V − D)/15 within 0 and 1: a pose that is not found does not make a fleet that is there
        fit as badly as one that is not.

        Args:
            t: Time, seconds.
            evidence: V, less what the luckiest decoy reached.
            chance: D, what decoys usually reach; None: the camera is steady.
            told: Factor on both rates, 0 to 1: how many vehicles there are to tell anything.
        """
        now = float(np.clip(evidence, _MIN_EVIDENCE, _MAX_EVIDENCE))
        dt = min(t - self._t, _LONGEST_STEP_S)
        self._t = t
        if now != 0.0:
            rate = told / (_FORGET_S if now > 0.0 else _DOUBT_S)
            if now < 0.0 and chance is not None:
                rate = told * float(np.clip(1.0 - (evidence - chance) / _BETTER, 0.0, 1.0)) / _BLIND_S
            self._log_ratio = max(now, now + (self._log_ratio - now) * float(np.exp(-dt * rate)))

    def shown(self, p: FloatArray, stated: BoolArray) -> FloatArray:
        """Marginals as they are reported: until the evidence has grown no name is sure, unless the operator stated it.

        Fleets in the same formation are at the same places for a moment, or as long as both drive straight on.

        Args:
            p: (m, n + 1), the last column "none of ours".
            stated: (m,) tracks of which the operator stated anything.
        """
        if self._grown:
            return p
        return np.where(stated[:, None], p, unproven(p))

    def limited(self, p: FloatArray, stated: BoolArray) -> FloatArray:
        """Marginals in which names count as far as film and telemetry belong together, or the operator stated them.

        Args:
            p: (m, n + 1), the last column "none of ours".
            stated: (m,) tracks of which the operator stated anything.
        """
        return weighed(p, np.where(stated, 1.0, self.probability)[:, None])
