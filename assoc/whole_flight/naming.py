"""The names of a stretch of a recording by all of its frames and reports at once.

A screen names a box by what was seen until then. Afterwards the whole course of each track is known, before and after:
which segments are which vehicle (``owners``), the camera's pose, what the vehicles' errors have in common and how each
wanders (``chains``) are found together, each given the others in turn, until the naming stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.special import expit

from assoc.geometry.ground import THETA, ground_tracks
from assoc.hypotheses.place_alone import limit_by_place
from assoc.hypotheses.pose import PosePrior
from assoc.hypotheses.priors import prior_of
from assoc.params import IdentifierParams
from assoc.whole_flight.chains import (
    CommonPose,
    fit_pose,
    learn_errors,
    outlying,
    pair_scores,
    with_whole_chains,
    without_outliers,
)
from assoc.whole_flight.changes import Change, changes, exchanges
from assoc.whole_flight.doubles import boxes_of_two, limited, without_doubles
from assoc.whole_flight.evidence import Segments
from assoc.whole_flight.owners import Namings
from assoc.whole_flight.residuals import Errors, Residuals, residuals_at

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ROUNDS = 8
"""Most rounds of pose, errors and naming: three or four usually suffice."""
_MOVED = np.array([0.01, np.inf, 0.01, 0.01, np.inf, np.inf, 1.0, 0.05, 0.1])
"""Residuals are linearised again when θ moved further than this (as θ)."""
_MAX_PAIRS = 6000
"""Pairs of segment and vehicle beyond which a stretch is not looked at as a whole: it would take minutes."""
_ANEW_NATS = 10.0
"""Advantage in nats that a naming found from no name at all needs: known names are evidence, too."""
_TRIES = 6
"""Most times that segments are cut where they go on as another object, and named anew."""
_MOMENTS = 2
"""Most moments at which all changes of an exchange are tried at once."""
_CUT_NATS = 4.0
"""Cost of each cut, nats: what is behind it is one coincidence more."""
_MISSED_PER_S, _PIECE = 0.5, 2.0
"""Cost of a second without a box, and of each segment, nats: a vehicle is missed for some seconds, not for
many, and is not one object after another.
"""
_ALONE_S = 3.0
"""A name holds for this long before and after its vehicle's reports were compared with the segment, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentNames:
    """Names of segments by the whole, and for how long they hold."""

    segments: Segments
    """The pieces of tracks, cut where another object follows."""
    p: FloatArray
    """(S, n + 1) probabilities of each vehicle, the last column "none of ours"; NaN where nothing was compared."""
    since_s: FloatArray
    until_s: FloatArray
    """(S,) from when to when each is the likeliest one, seconds from the first frame."""
    owner: IntArray
    """(S,) vehicle of each by the whole, −1 none."""
    also: IntArray
    """(B, S) vehicle that is in a segment's box, too, or alone, n a stranger, −1 nobody."""
    first_s: float
    """Time at which the first block begins, seconds from the first frame."""
    block_s: float
    """Length of a block, seconds."""

    def at(self, t_us: int, track: int) -> FloatArray | None:
        """(n + 1,) probabilities of a box; None where they are not known.

        A track that nothing was compared with for long may have gone on with another vehicle; one that was aside did.

        Args:
            t_us: Time of its frame, Unix µs.
            track: Its track.
        """
        segment = self.segments.of.get((t_us, track))
        if segment is None:
            return None
        t = 1e-6 * (t_us - self.segments.origin_us)
        known = np.isfinite(self.p[segment, 0]) and self.since_s[segment] <= t <= self.until_s[segment]
        return self.p[segment] if known else None

    def with_another(self, p: FloatArray, t_us: int, track: int) -> FloatArray:
        """(n + 1,) probabilities of a box where another object is in it, too, or alone; else the same.

        Args:
            p: (n + 1,) of it otherwise.
            t_us: Time of its frame, Unix µs.
            track: Its track.
        """
        segment, own = self.segments.of.get((t_us, track)), int(np.argmax(p))
        if segment is None or own == len(p) - 1:
            return p
        block = int((1e-6 * (t_us - self.segments.origin_us) - self.first_s) // self.block_s)
        other = int(self.also[min(max(block, 0), len(self.also) - 1), segment])
        other = int(self.owner[segment]) if other == own else other
        return p if other < 0 else limited(p, own, other)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    owner: IntArray
    score: FloatArray
    """(S, n) of each segment by itself."""
    together: FloatArray
    """(S, n) the same, or more where its whole chain may be another vehicle."""
    reported: BoolArray
    """(B, S, n) blocks in which the vehicle reported while the segment was seen."""
    compared: BoolArray
    """(B, S, n) those of them in which the segment was not aside."""
    residuals: Residuals
    pose: CommonPose
    errors: Errors
    first_s: float
    """Time at which the first block begins, seconds from the first frame."""
    worth: float


def segment_names(segments: Segments, q: IdentifierParams, owner: IntArray) -> SegmentNames | None:
    """Find who each segment is.

    Args:
        segments: The pieces of tracks.
        q: Parameters of the identifier.
        owner: (S,) vehicle of each by what is known so far, −1 none: where the search starts.

    Returns:
        None where there are too many pairs.
    """
    if segments.seen.shape[1] * segments.log.n_vehicles > _MAX_PAIRS:
        return None
    best = _named(segments, q, owner, segments.theta)
    anew = _named(segments, q, np.full_like(owner, -1), np.zeros(THETA))
    best = anew if anew.worth > best.worth + _ANEW_NATS else best
    segments, best = _cut_at_changes(segments, q, best)
    rival = _against_others(best.together, segments)
    p = Namings(rival, segments.apart).probabilities()
    # beside "none of ours" only what the score itself says counts
    p[:, :-1] *= expit(best.together) / expit(rival)
    p[:, -1] = 1.0 - np.sum(p[:, :-1], axis=1)
    p = without_doubles(p, best.score, best.owner, segments)
    p = limit_by_place(p, best.together, _distances(segments, best.pose.theta), best.errors.bias_std)
    p[~np.any(best.reported, axis=(0, 2))] = np.nan
    # for none of ours any report counts
    anybody = np.any(best.reported, axis=2, keepdims=True)
    likeliest = np.arange(len(p)), np.argmax(p, axis=1)
    compared, reported = (
        _span(np.concatenate([pairs, anybody], axis=2)[:, *likeliest]) for pairs in (best.compared, best.reported)
    )
    # beyond where it was compared a name holds for a while, unless the segment is aside there
    beyond = np.where(compared == reported, _ALONE_S, 0.0)
    since_s, until_s = best.first_s + q.block_s * compared + [[-1.0], [1.0]] * beyond
    also = boxes_of_two(segments, best.residuals, best.pose, best.errors, best.owner, q.block_s)
    far = outlying(best.residuals, _prior(segments, q, best.pose.theta), best.pose, best.errors, best.owner)
    also[:, np.isin(best.owner, far)] = segments.log.n_vehicles
    return SegmentNames(
        segments=segments,
        p=p,
        since_s=since_s,
        until_s=until_s,
        owner=best.owner,
        also=also,
        first_s=best.first_s,
        block_s=q.block_s,
    )


def _cut_at_changes(segments: Segments, q: IdentifierParams, best: _Named) -> tuple[Segments, _Named]:
    """The segments cut where they go on as another object, if all of it is worth more so, and who they are then."""
    every = changes(segments, best.residuals, best.pose, best.errors, best.owner, q.block_s)
    apart = exchanges(every)
    # all at once, or else those of each exchange by themselves: one that is wrong may cost more than the others gain
    tried = [every, *apart] if len(apart) > 1 else apart
    for found in tried[:_TRIES]:
        cuts = [_as_cut(segments, q, best, each) for each in [found, *_at_once(found, segments, best.owner)]]
        gains = [named.worth - best.worth - _CUT_NATS * (len(named.owner) - len(best.owner)) for _, named in cuts]
        if max(gains) > 0.0:
            segments, best = cuts[int(np.argmax(gains))]
            if found is every:
                break
    return segments, best


def _as_cut(segments: Segments, q: IdentifierParams, best: _Named, found: Sequence[Change]) -> tuple[Segments, _Named]:
    """The segments cut where they change, and who they are then."""
    parts = segments.cut([(change.segment, change.at_s) for change in found])
    owner = np.concatenate([best.owner, [change.after for change in found]])
    owner[[change.segment for change in found]] = [change.before for change in found]
    return parts, _named(parts, q, owner, best.pose.theta)


def _at_once(found: Sequence[Change], segments: Segments, owner: IntArray) -> list[list[Change]]:
    """The same changes at one moment, each one's in turn, with those of the tracks whose vehicles they go on as.

    Two tracks are exchanged at once, while how well each fits may change sooner or later, or in one alone.
    """
    tried = list[list[Change]]()
    for at_s in sorted({change.at_s for change in found})[:_MOMENTS]:
        both = [replace(change, at_s=at_s) for change in found]
        own = {change.segment for change in found}
        both += [other for change in both for other in _returned(change, segments, owner) if other.segment not in own]
        if both != list(found) and len({change.segment for change in both}) == len(both):
            tried.append(both)
    return tried


def _returned(change: Change, segments: Segments, owner: IntArray) -> list[Change]:
    """Changes by which tracks that are the vehicle it goes on as would go on as the one that it was."""
    if min(change.before, change.after) < 0:
        return []
    t = segments.history.t[: segments.history.n]
    others = np.flatnonzero((owner == change.after) & segments.apart[change.segment])
    passed = segments.seen[:, others] & (t < change.at_s)[:, None]
    follows = segments.seen[:, others] & (t >= change.at_s)[:, None]
    returned = replace(change, before=change.after, after=change.before)
    return [replace(returned, segment=other) for other in others[passed.any(axis=0) & follows.any(axis=0)].tolist()]


def _span(blocks: BoolArray) -> IntArray:
    """(2, S) first of each segment's blocks (B, S), and the one after the last."""
    return np.stack([np.argmax(blocks, axis=0), len(blocks) - np.argmax(blocks[::-1], axis=0)])


def _named(segments: Segments, q: IdentifierParams, owner: IntArray, theta: FloatArray) -> _Named:
    """Names, pose and errors found together from a starting pose (9,)."""
    prior = _prior(segments, q, theta)
    errors = Errors(q.bias_m, q.bias_tau_s)
    residuals = residuals_at(segments, q, theta, errors)
    tried = {owner.tobytes()}
    for k in range(_ROUNDS):
        pose = fit_pose(residuals, prior, errors, owner)
        if np.any(np.abs(pose.theta - residuals.blocks.theta) > _MOVED):
            residuals = residuals_at(segments, q, pose.theta, errors)
        if k:
            errors = learn_errors(residuals, pose, owner)
        weighed = without_outliers(residuals, pose, errors)
        score = pair_scores(segments, weighed, pose, errors, owner)
        against = _against_others(score, segments)
        before, owner = owner, Namings(against, segments.apart).best()
        if k and owner.tobytes() in tried:
            # two halves of an exchange, each of which follows the other, would take turns for ever
            owner = _best_change(before, owner, against, segments.apart)
        if k and owner.tobytes() in tried:
            break
        tried.add(owner.tobytes())
    reported = residuals.blocks.count > 0
    return _Named(
        owner=owner,
        score=score,
        together=with_whole_chains(score, weighed, pose, errors, owner),
        reported=reported,
        compared=weighed.blocks.count > 0,
        residuals=residuals,
        pose=pose,
        errors=errors,
        first_s=residuals.blocks.first * q.block_s,
        worth=float(np.sum(_worth(score, owner))) - pose.cost,
    )


def _prior(segments: Segments, q: IdentifierParams, theta: FloatArray) -> PosePrior:
    """Part of the prior of a pose (9,) that it is in."""
    return prior_of(q, segments.camera, q.time_offset_std_s, segments.history.speed_mps).part_at(theta)


def _best_change(before: IntArray, after: IntArray, score: FloatArray, apart: BoolArray) -> IntArray:
    """(S,) the naming before with the one change towards the other that gains most.

    A change is of segments that have to change together, since one takes the vehicle of another that is apart.
    """
    changed = np.flatnonzero(before != after)
    if not len(changed):
        return before
    takes = (before[changed][:, None] == after[changed]) & (before[changed] >= 0)[:, None]
    _, change = connected_components(csr_matrix(takes & apart[np.ix_(changed, changed)]), directed=False)
    gain = _worth(score, after) - _worth(score, before)
    best = changed[change == np.argmax(np.bincount(change, gain[changed]))]
    owner = before.copy()
    owner[best] = after[best]
    return owner


def _worth(score: FloatArray, owner: IntArray) -> FloatArray:
    """(S,) scores of segments as their owners, 0 for none of ours."""
    return np.where(owner >= 0, score[np.arange(len(owner)), owner], 0.0)


def _against_others(score: FloatArray, segments: Segments) -> FloatArray:
    """(S, n) scores for the comparison with segments that cannot be the same vehicle: one that lasts beats many."""
    lasts = (_MISSED_PER_S * segments.seen_s - _PIECE)[:, None]
    return np.asarray(np.where(score > 0.0, score + lasts, score))


def _distances(segments: Segments, theta: FloatArray) -> FloatArray:
    """(S, S) mean distance of segments that were seen together, metres, NaN of others."""
    places = ground_tracks(segments.history, 0, theta, np.arange(segments.seen.shape[1])).p
    away = np.full(segments.apart.shape, np.nan)
    for a, b in np.argwhere(segments.apart).tolist():
        apart_m = np.linalg.norm(places[:, a] - places[:, b], axis=1)
        away[a, b] = np.mean(apart_m, where=np.isfinite(apart_m)) if np.isfinite(apart_m).any() else np.nan
    return away
