"""The identities of one frame: vehicle ids, their probabilities and the evidence for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.motion import ReportLog
from assoc.hypotheses.labels import most_probable_names
from assoc.identification.doubts import AnswerDoubt, lowered
from assoc.identification.estimate import Estimator
from assoc.identification.frame_masses import frame_masses
from assoc.records import CameraState, Candidates, Identities, Observation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MAX_REMEMBERED = 200
"""Tracks whose last marginals are kept."""
_CLAIMED = 0.5
"""Probability above which a detected track takes a vehicle's name from tracks that are only predicted."""
_MASSES_EVERY_S = 0.5
"""Time between two computations of the masses, seconds."""
_CANDIDATES_EVERY_S = 0.25
"""Time between two comparisons of each track with all vehicles, seconds: faster than they can be read."""
_MAX_CANDIDATES = 3
"""Vehicles that are given for each track: more are not compared by eye."""
_NEW_TRACK_UNKNOWN = 0.5
"""Probability of "none of ours" of a track that has been in no update yet."""


@dataclass(frozen=True, slots=True)
class Beliefs:
    """Marginals of the last update."""

    track_id: IntArray
    """(m,)."""
    p: FloatArray
    """(m, n + 1), the last column "none of ours"."""
    doubt: IntArray
    """(m,) :class:`AnswerDoubt` of each answer."""
    conflict: tuple[int, ...]
    """Indices of vehicles whose reports contradict the video or one another."""

    def for_tracks(self, track_id: IntArray) -> Beliefs:
        """Beliefs on the given tracks, in their order; even odds for those not in any update yet."""
        n = self.p.shape[1] - 1
        p = np.full((len(track_id), n + 1), (1.0 - _NEW_TRACK_UNKNOWN) / max(n, 1))
        p[:, n] = _NEW_TRACK_UNKNOWN if n else 1.0
        doubt = np.full(len(track_id), AnswerDoubt.NONE, np.int64)
        known = {key: row for row, key in enumerate(self.track_id.tolist())}
        for row, key in enumerate(track_id.tolist()):
            if key in known:
                p[row], doubt[row] = self.p[known[key]], self.doubt[known[key]]
        return Beliefs(track_id, p, doubt, self.conflict)

    def updated(self, track_id: IntArray, p: FloatArray, doubt: IntArray, conflict: tuple[int, ...]) -> Beliefs:
        """Replace the beliefs on some tracks; of the others the newest are kept for when they are seen again."""
        other = ~np.isin(self.track_id, track_id)
        pairs = ((track_id, self.track_id), (p, self.p), (doubt, self.doubt))
        ids, p, doubt = (np.concatenate([new, old[other]])[:_MAX_REMEMBERED] for new, old in pairs)
        return Beliefs(ids, p, doubt, conflict)


def empty_beliefs(n: int) -> Beliefs:
    """Beliefs before the first update, on no track."""
    return Beliefs(np.empty(0, np.int64), np.empty((0, n + 1)), np.empty(0, np.int64), ())


class MassCache:
    """The last masses of the named tracks: they change slowly, and computing them costs more than a name."""

    def __init__(self) -> None:
        self._t = -np.inf
        self._rows: dict[tuple[int, int], FloatArray] = {}

    def stale(self, t: float, track_id: IntArray, choice: IntArray) -> bool:
        """Tell whether they must be computed again: after a while, or for a pair of track and vehicle that is new."""
        named = zip(track_id.tolist(), choice.tolist(), strict=True)
        return t - self._t >= _MASSES_EVERY_S or any(k >= 0 and (track, k) not in self._rows for track, k in named)

    def store(self, t: float, track_id: IntArray, choice: IntArray, masses: FloatArray) -> None:
        """Keep (3, m) masses of the tracks with their vehicles."""
        self._t = t
        self._rows = dict(zip(zip(track_id.tolist(), choice.tolist(), strict=True), masses.T, strict=True))

    def masses_of(self, track_id: IntArray, choice: IntArray) -> FloatArray:
        """(3, m) projection, topology and fused mass of each track's vehicle, NaN unnamed."""
        unnamed = np.full(3, np.nan)
        named = zip(track_id.tolist(), choice.tolist(), strict=True)
        rows = [self._rows[track, k] if k >= 0 else unnamed for track, k in named]
        return np.array(rows).reshape(len(rows), 3).T


class CandidateCache:
    """The last candidates: between two updates the probabilities stay, and distances change little."""

    def __init__(self) -> None:
        self._t = -np.inf
        self._track_id = np.empty(0, np.int64)
        self._p = np.empty((0, 0))
        self.found = Candidates.empty(0)

    def stale(self, t: float, track_id: IntArray, p: FloatArray) -> bool:
        """Tell whether they must be found again: after a while, or with other tracks or probabilities."""
        same = np.array_equal(self._track_id, track_id) and np.array_equal(self._p, p)
        return not same or t - self._t >= _CANDIDATES_EVERY_S

    def store(self, t: float, track_id: IntArray, p: FloatArray, found: Candidates) -> None:
        """Keep the candidates of tracks with probabilities p (m, n + 1)."""
        self._t, self._track_id, self._p, self.found = t, track_id.copy(), p, found


def compose_identities(
    system_ids: IntArray,
    beliefs: Beliefs,
    observation: Observation,
    camera: CameraState,
    log: ReportLog,
    estimator: Estimator,
    t: float,
    threshold: float,
    cache: MassCache,
    candidates: CandidateCache,
) -> Identities:
    """Assemble names, runners-up and evidence of one frame.

    Args:
        system_ids: (n,).
        beliefs: In the order of the observation.
        observation: The frame.
        camera: Its camera.
        log: Newest reports.
        estimator: Pose correction.
        t: Time of the frame, seconds.
        threshold: Least probability for a name.
        cache: Last masses; written here.
        candidates: Last candidates; written here.

    Returns:
        The identities.
    """
    m, n = len(observation.track_id), len(system_ids)
    rows = np.arange(m)
    p = _without_coasting_names(beliefs.p, observation.gap_s)
    doubt = lowered(AnswerDoubt.COASTING, beliefs.p, p, beliefs.doubt)
    choice = most_probable_names(p)
    choice = np.where((choice >= 0) & (p[rows, choice] >= threshold), choice, -1)
    others = p[:, :n].copy()
    others[rows[choice >= 0], choice[choice >= 0]] = -1.0
    second = np.argmax(others, axis=1) if n else np.zeros(m, np.int64)
    second_p = others[rows, second] if n else np.zeros(m)
    ids = np.append(system_ids, 0)
    if cache.stale(t, observation.track_id, choice):
        cache.store(t, observation.track_id, choice, np.stack(_masses(t, observation, camera, log, estimator, choice)))
    projection, topology, fused = cache.masses_of(observation.track_id, choice)
    places, (reported, age_s) = estimator.places(observation, camera), estimator.reported(t)
    named = np.flatnonzero(choice >= 0)
    residual, age = np.full((2, m), np.nan)
    off = places[named] - reported[choice[named]]
    residual[named], age[named] = np.sqrt(np.sum(off * off, axis=1)), age_s[choice[named]]
    if candidates.stale(t, observation.track_id, p):
        away = np.linalg.norm(places[:, None] - reported[None], axis=2)
        far = away, estimator.deviations(t, places), age_s
        candidates.store(t, observation.track_id, p, _candidates(system_ids, observation.track_id, p, *far))
    return Identities(
        track_id=observation.track_id.copy(),
        system_id=ids[choice],
        confidence=p[rows, choice],
        runner_up=np.where(second_p > 0.0, ids[second], 0),
        runner_up_confidence=np.maximum(second_p, 0.0),
        residual_m=residual,
        position_age_s=age,
        projection=projection,
        topology=topology,
        fused=fused,
        conflict=tuple(int(ids[k]) for k in beliefs.conflict),
        candidates=candidates.found,
        doubt=doubt,
    )


def _candidates(
    system_ids: IntArray,
    track_id: IntArray,
    p: FloatArray,
    away_m: FloatArray,
    deviation: FloatArray,
    age_s: FloatArray,
) -> Candidates:
    """The likeliest vehicles of each track; of equally likely ones the nearest.

    Args:
        system_ids: (n,).
        track_id: (m,).
        p: (m, n + 1) marginals.
        away_m: (m, n) metres from each track to each vehicle's report.
        deviation: (m, n) the same in standard deviations.
        age_s: (n,) age of the reports, seconds.
    """
    m, n = len(track_id), len(system_ids)
    if not m or not n:
        return replace(Candidates.empty(m), none_of_ours=p[:, -1])
    row, best = np.arange(m)[:, None], np.lexsort((away_m, -p[:, :n]), axis=1)[:, :_MAX_CANDIDATES]
    owner = np.argmax(p[:, :n], axis=0)[best]
    better = p[owner, best] > p[row, best]
    return Candidates(
        system_id=system_ids[best],
        confidence=p[row, best],
        distance_m=away_m[row, best],
        deviation=deviation[row, best],
        report_age_s=np.where(np.isfinite(age_s[best]), age_s[best], np.inf),
        better_track=np.where(better, track_id[owner], 0),
        better_confidence=np.where(better, p[owner, best], np.nan),
        none_of_ours=p[:, -1],
    )


def _without_coasting_names(p: FloatArray, gap_s: FloatArray) -> FloatArray:
    """Marginals in which a track that is only predicted loses its name to one that is detected."""
    seen = gap_s <= 0.0
    claimed = np.max(p[seen, :-1], axis=0, initial=0.0)
    p = p.copy()
    p[~seen, :-1] *= np.where(claimed > _CLAIMED, 1.0 - claimed, 1.0)
    p[:, -1] = np.maximum(1.0 - np.sum(p[:, :-1], axis=1), 0.0)
    return p


def _masses(
    t: float, observation: Observation, camera: CameraState, log: ReportLog, estimator: Estimator, choice: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m,) three masses of the named vehicles, NaN unnamed."""
    named = np.flatnonzero(choice >= 0)
    result = np.full((3, len(choice)), np.nan)
    if len(named):
        p, _ = log.extrapolated(t - estimator.time_offset_s)
        for row, mass in zip(
            result, frame_masses(observation, camera, p, log.last_heading, estimator.theta), strict=True
        ):
            row[named] = mass[named, choice[named]]
    return result[0], result[1], result[2]
