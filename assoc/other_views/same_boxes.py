"""Pairs of tracks of two views that are one object, by where both have them on the ground.

Each view has its places by a pose of its own, which is off by something that all its boxes share. With
d_ij = g_i − g'_j between track i of one view and j of the other at one time, and s the shift between the two poses,

    d_ij = s + noise,   s ~ N(0, σ_c² + σ_c'²),   noise ~ N(0, C_i + C'_j)

where i and j are one, and anywhere in the area A that an object has for itself where they are not. What both views
answer by themselves counts, too, by ln (n + 1) Σ p_i p'_j, −1 to 2. Every d_ij is a shift to be tried;
probabilities that i is j are the marginals of the assignment, averaged over shifts by what these are worth, and over
the last second. A shift that was sure is where the next one is looked for. A regular formation, of which both views
see another part, has several shifts that are worth much: then nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from assoc.hypotheses.marginals import marginals
from assoc.records import Sighting

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

REACH_S = 0.5
"""A track goes on straight for this long after it was seen last, seconds: from one picture into another one."""
_COURSE_S, _MIN_COURSE_S = 1.0, 0.25
"""Time over which the course of a track is measured, at most and at least, seconds."""
_AREA_M2 = 60.0
"""Ground that an object has for itself, m²."""
_GATE = 3.0
"""Shifts beyond this many σ are not tried."""
_APART_M = 1.0
"""Shifts that are closer are one."""
_MAX_TRIED = 64
"""Most shifts that are tried: of fifty vehicles there are 2500."""
_MAX_SHIFTS, _NEGLIGIBLE = 4, 7.0
"""Most shifts that are weighed, and by how many nats less one is worth that is not."""
_BY_NAME = (-1.0, 2.0)
"""Most nats that equal answers of both count: less against one object, so that a contradiction is found."""
_SURE, _WANDER_M2_S = 0.9, 0.5
"""Probability from which on a shift is remembered, and the growth of its variance then, m²/s."""
_AGAIN_S = 0.2
"""Time between two comparisons while the tracks stay, seconds."""
_MEAN_S = 1.0
"""Time over which probabilities are averaged, seconds."""
_FORGET_S = 10.0
"""Pairs that were not compared for this long are forgotten, seconds."""


@dataclass(frozen=True, slots=True)
class Shift:
    """Shift by which the places of one view are off against those of another one, metres."""

    mean: FloatArray
    """(2,)."""
    cov: FloatArray
    """(2, 2) m²."""
    t: float = 0.0
    """Time of the shift, seconds."""

    @classmethod
    def unknown(cls, var: float) -> Shift:
        """Return a shift of which only its usual size is known, m² per axis."""
        return cls(np.zeros(2), var * np.eye(2))

    def after(self, t: float) -> Shift:
        """The shift as known at a later time: it wanders."""
        return Shift(self.mean, self.cov + _WANDER_M2_S * abs(t - self.t) * np.eye(2), t)


class SameBoxes:
    """Follows which tracks of one view are which of another's."""

    def __init__(self) -> None:
        self._p: dict[tuple[int, int], tuple[float, float]] = {}
        """Time at which a pair was compared last, seconds, and the mean probability that it is one object."""
        self._shift: Shift | None = None
        self._last: tuple[float, IntArray, IntArray, FloatArray] | None = None

    def update(self, mine: Sighting, theirs: Sequence[Sighting]) -> tuple[IntArray, FloatArray]:
        """Compare with what the other view saw about the same time.

        Returns:
            (k,) tracks of the other view that are somewhere at that time; (m, k) probability of each pair to be one.
        """
        track_id, place, cov = places_at(mine.t_us, theirs)
        if not len(track_id) or not len(mine.track_id):
            return track_id, np.zeros((len(mine.track_id), len(track_id)))
        t = 1e-6 * mine.t_us
        if self._last is not None:
            last_s, own, others, known = self._last
            same = np.array_equal(own, mine.track_id) and np.array_equal(others, track_id)
            if same and 0.0 <= t - last_s < _AGAIN_S:
                return track_id, known
        d, covs = mine.place[:, None] - place[None], mine.cov_m2[:, None] + cov[None]
        agreement = log_agreement(mine.p, newest_answers(track_id, theirs))
        usual = Shift.unknown(mine.common_std_m**2 + max(each.common_std_m for each in theirs) ** 2)
        before = [usual] if self._shift is None else [self._shift.after(t), usual]
        now, found, _ = max((compared(d, covs, shift, agreement) for shift in before), key=lambda each: each[2])
        self._shift = replace(found, t=t) if found is not usual else None
        mean = self._mean(t, mine.track_id, track_id, now)
        self._last = t, mine.track_id, track_id, mean
        return track_id, mean

    def _mean(self, t: float, mine: IntArray, theirs: IntArray, now: FloatArray) -> FloatArray:
        mean = now.copy()
        for i, own in enumerate(mine.tolist()):
            for j, other in enumerate(theirs.tolist()):
                before_s, before = self._p.get((own, other), (t, now[i, j]))
                mean[i, j] += (before - now[i, j]) * np.exp(-abs(t - before_s) / _MEAN_S)
                self._p[own, other] = t, float(mean[i, j])
        self._p = {pair: known for pair, known in self._p.items() if abs(t - known[0]) < _FORGET_S}
        return mean


def newest_answers(track_id: IntArray, sightings: Sequence[Sighting]) -> FloatArray:
    """(k, n + 1) what a view answered last on each of some of its tracks."""
    newest = {key: p for each in sightings for key, p in zip(each.track_id.tolist(), each.p, strict=True)}
    return np.array([newest[key] for key in track_id.tolist()]).reshape(len(track_id), sightings[-1].p.shape[1])


def places_at(t_us: int, sightings: Sequence[Sighting]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Places of the tracks of a view at a time, by straight lines through their places of about a second.

    Args:
        t_us: Unix µs.
        sightings: Its last frames, in order.

    Returns:
        (k,) track ids, (k, 2) places, metres, and (k, 2, 2) their covariance, m²; of tracks seen within ``REACH_S``.
    """
    rows: dict[int, list[tuple[float, float, float]]] = {}
    newest: dict[int, FloatArray] = {}
    for sighting in sightings:
        t = 1e-6 * (sighting.t_us - t_us)
        if abs(t) > REACH_S + _COURSE_S:
            continue
        for track, (x, y), cov in zip(sighting.track_id.tolist(), sighting.place, sighting.cov_m2, strict=True):
            if np.isfinite(x):
                rows.setdefault(track, []).append((t, x, y))
                newest[track] = cov
    found = {track: line for track, seen in rows.items() if (line := _at_zero(np.array(seen))) is not None}
    values = np.array(list(found.values())).reshape(-1, 3)
    covs = np.array([newest[track] for track in found]).reshape(-1, 2, 2)
    return np.array(list(found), np.int64), values[:, :2], covs + values[:, 2, None, None] * np.eye(2)


def _at_zero(seen: FloatArray) -> tuple[float, float, float] | None:
    """Place (x, y) at time 0 of a track with rows (k, 3) of time and place, and its variance by how long ago it was
    seen; None: too long.
    """
    nearest = int(np.argmin(np.abs(seen[:, 0])))
    away = seen[nearest, 0]
    if abs(away) > REACH_S:
        return None
    near = seen[np.abs(seen[:, 0] - away) <= _COURSE_S]
    t = near[:, 0] - away
    velocity = np.zeros(2)
    if np.ptp(t) >= _MIN_COURSE_S:
        t = t - np.mean(t)
        velocity = t @ near[:, 1:3] / (t @ t)
    x, y = seen[nearest, 1:3] - away * velocity
    # what turns and brakes is elsewhere: 2 m/s² from the middle of the course on
    return float(x), float(y), float((abs(away) * (0.3 + abs(away))) ** 2)


def log_agreement(mine: FloatArray, theirs: FloatArray) -> FloatArray:
    """(m, k) nats by which answers (m, n + 1) and (k, n + 1) of two views speak for one object, bounded."""
    nats = np.log(np.maximum(mine.shape[1] * (mine @ theirs.T), 1e-9))
    return np.asarray(np.clip(nats, *_BY_NAME))


def compared(
    d: FloatArray, covs: FloatArray, shift: Shift, agreement: FloatArray | float = 0.0
) -> tuple[FloatArray, Shift, float]:
    """Compare the places that two views have of their tracks at one time.

    A shift is worth Σ gains − ½ sᵀΛs − ½ ln |Λ⁻¹P| by the pairs that it explains, Λ⁻¹ its covariance before them and
    P = Λ + Σ (C_i + C_j)⁻¹: less what it costs to fit it to them. That nothing is the same is worth 0.

    Args:
        d: (m, k, 2) place of a track of the one view less that of one of the other, metres, NaN unknown.
        covs: (m, k, 2, 2) covariance of that, m².
        shift: What is known of the shift between both views' poses.
        agreement: (m, k) nats by which else they are one, or are not.

    Returns:
        (m, k) probability that they are one object; the shift by that; what the best one is worth, 0 at least.
    """
    d, before = d - shift.mean, np.linalg.inv(shift.cov)
    W: FloatArray = np.asarray(np.linalg.inv(covs), np.float64)
    with np.errstate(invalid="ignore"):
        near = np.einsum("mkx,mkxy,mky->mk", d, np.linalg.inv(covs + shift.cov), d) <= _GATE**2
    shifts, P = _likeliest(d[near]), before
    log_peak = np.log(_AREA_M2 / (2.0 * np.pi)) + 0.5 * np.linalg.slogdet(W)[1] + agreement
    for _ in range(2):  # each moved to the middle of the pairs that it explains
        weight = np.where(_nearest(_gains(d, W, shifts, log_peak)), 1.0, 0.0)
        P = np.einsum("smk,mkxy->sxy", weight, W) + before
        sums = np.einsum("smk,mkxy,mky->sx", weight, W, np.nan_to_num(d))
        shifts = np.linalg.solve(P, sums[..., None])[..., 0]
    gains = _gains(d, W, shifts, log_peak)
    values = np.sum(gains, axis=(1, 2), where=_nearest(gains)) - 0.5 * np.einsum("sx,xy,sy->s", shifts, before, shifts)
    values -= 0.5 * (np.linalg.slogdet(P)[1] - np.linalg.slogdet(before)[1])
    best = list[int]()
    for row in np.argsort(-values, kind="stable").tolist():
        far = np.sum((shifts[best] - shifts[row]) ** 2, axis=1) > _APART_M**2
        if np.all(far) and values[row] > max(values[best[0]] if best else 0.0, 0.0) - _NEGLIGIBLE:
            best.append(row)
    best = best[:_MAX_SHIFTS]
    if not best:
        return np.zeros(d.shape[:2]), shift, 0.0
    most = max(float(values[best[0]]), 0.0)
    share = np.exp(values[best] - most)
    share /= np.sum(share) + np.exp(-most)
    parts = np.array([marginals(gains[row])[:, :-1] for row in best])
    found = Shift(shift.mean + shifts[best[0]], np.linalg.inv(P[best[0]])) if share[0] > _SURE else shift
    return np.asarray(np.tensordot(share, parts, axes=1)), found, most


def _likeliest(shifts: FloatArray) -> FloatArray:
    """(s, 2) those of many shifts that most others are near to."""
    if len(shifts) <= _MAX_TRIED:
        return shifts
    near = cKDTree(shifts).query_ball_point(shifts, _APART_M, return_length=True)
    return shifts[np.argsort(-near, kind="stable")[:_MAX_TRIED]]


def _gains(d: FloatArray, W: FloatArray, shifts: FloatArray, log_peak: FloatArray) -> FloatArray:
    """(s, m, k) ln of how much likelier each pair is one than two under each shift; −23 where a place is unknown."""
    off = d - shifts[:, None, None]
    gains = log_peak - 0.5 * np.einsum("smkx,mkxy,smky->smk", off, W, off)
    return np.asarray(np.nan_to_num(gains, nan=-23.0))


def _nearest(gains: FloatArray) -> BoolArray:
    """(s, m, k) pairs that are likelier one than two, and likeliest for both of them."""
    likeliest = (gains >= np.max(gains, axis=1, keepdims=True)) & (gains >= np.max(gains, axis=2, keepdims=True))
    return np.asarray(likeliest & (gains > 0.0))
