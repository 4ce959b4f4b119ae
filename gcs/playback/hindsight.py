"""Names by hindsight: what a track turns out to be counts for its boxes from the first on.

On a screen a box is named by what was seen until then. Of a recording more is known. p_k(t) is what was told of track k
in frame t, of n vehicles and of none of them; a tracker goes over to another vehicle unnoticed with probability
ε = 1 − exp(−0.01 Δt) from one frame to the next. Smoothed backwards from 15 s later (Rauch, Tung, Striebel 1965,
doi:10.2514/3.3166, for discrete states):

    s_k(t) = p_k(t) A [s_k(t + 1) / Aᵀ p_k(t)],  A = (1 − ε) I + ε 11ᵀ/(n + 1)

A name that was given early and taken back was never sure, one that came late was there from the first, a doubt that
passes is none, and where a track changed its vehicle, its name changes. 0.3 of what counts is the plain mean over
those 15 s, and "none of ours" has the lesser share of the two: a box that is cut, merged or late is no stranger's, and
a doubt at a track's end is not all there is to know. No name is surer than 0.89 where its mean is not. Frames in which
film and telemetry did not fit, though they did later, tell nothing; where they do not fit at the end, the mean alone
counts. A track that was out of sight for long may have gone on with another vehicle: it counts as another one from
there on, as for the identifier (``assoc.history``).
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assoc.history import INTERVALS, longest_gap_s
from assoc.params import IdentifierParams
from assoc.whole_flight.evidence import FlightEvidence
from gcs.fold.since import Since
from gcs.fold.snapshot_rows import standing_of
from gcs.mission.mission import Mission
from gcs.playback.whole_flight import FITS, UNSURE, KnownFrame, by_whole_flight
from gcs.snapshot import NAN, Box, Candidate, Snapshot, VehicleRow

FloatArray = NDArray[np.float64]

AHEAD_S = 15.0
"""Time after a box up to which its track is known when it is named, s."""
_CHANGES_HZ = 0.01
"""Rate at which a tracker goes over from one vehicle to another unnoticed, 1/s."""
_MEAN_SHARE = 0.3
"""Weight of the mean against the smoothed probabilities: for these a doubt that comes late is all there is to know."""
_AT_ONCE_S = 3.0
"""Time of a track that is smoothed at once, s: the last of those boxes look that much less ahead."""
_LOWER = 0.05
"""Margin of the least mean of a name below a screen's threshold: what was thought at first is in the mean."""
_GAP_MAX_S = IdentifierParams().gap_max_s
_MIN_SHOWN = 0.005
"""Least probability of a candidate that is listed."""
_MAX_CANDIDATES = 3
_UNTOLD = 0.002
"""Probability of all candidates that were not listed, each below 0.005."""
_NO_EVIDENCE: dict[str, Any] = dict.fromkeys(
    ("residual_m", "residual_px", "position_age_s", "projection", "topology", "fused"), NAN
)
"""Fields of a box without what was measured for the name that it had at the time."""
_MAX_PASSED = 1000
"""Rows of a track that are kept although all boxes of their time have been named."""


@dataclass(slots=True)
class _Course:
    """A track while it is sure to be one vehicle: a row for each frame in which it was seen."""

    times_us: list[int] = field(default_factory=list)
    rows: list[FloatArray] = field(default_factory=list)
    """(n + 1,) probabilities of each vehicle and of none of them, as they were reported."""
    fits: list[bool] = field(default_factory=list)
    """True in frames in which film and telemetry were known to fit."""
    known: dict[int, FloatArray] = field(default_factory=dict)
    """Probabilities by hindsight, by time."""

    def add(self, t_us: int, p: FloatArray, *, fits: bool) -> None:
        """Append a row."""
        self.times_us.append(t_us)
        self.rows.append(p)
        self.fits.append(fits)

    def at(self, t_us: int) -> FloatArray | None:
        """(n + 1,) what is known at a time by hindsight; None without a row in the time after it."""
        first, stop = bisect_left(self.times_us, t_us), bisect_right(self.times_us, t_us + round(AHEAD_S * 1e6))
        if first >= stop:
            return None
        at_us = self.times_us[first]
        if at_us not in self.known:
            smoothed = _smoothed(self.times_us[first:stop], np.array(self.rows[first:stop]), self.fits[first:stop])
            until = bisect_right(self.times_us, at_us + round(_AT_ONCE_S * 1e6), first, stop)
            self.known = dict(zip(self.times_us[first:until], smoothed, strict=False))
        return self.known[at_us]

    def forget(self, t_us: int) -> None:
        """Drop the rows before a time once they are many."""
        passed = bisect_left(self.times_us, t_us)
        if passed > _MAX_PASSED:
            del self.times_us[:passed], self.rows[:passed], self.fits[:passed]


def _smoothed(times_us: Sequence[int], p: FloatArray, fits: Sequence[bool]) -> FloatArray:
    """(m, n + 1) what is known in each of m frames by those after it: s above, and the mean.

    Args:
        times_us: (m,) when each was.
        p: (m, n + 1) what was known then.
        fits: (m,) whether film and telemetry were known to fit.
    """
    # frames that did not fit tell what they told where none fitted later
    tells = np.array(fits)
    tells[np.max(np.flatnonzero(tells), initial=-1) + 1 :] = True
    rows = np.flatnonzero(tells)
    mean = np.cumsum(p[rows[::-1]], axis=0)[::-1] / np.arange(len(rows), 0, -1)[:, None]
    stays = [math.exp(-1e-6 * _CHANGES_HZ * (times_us[k + 1] - times_us[k])) for k in rows[:-1].tolist()]
    changes = [(1.0 - share) / p.shape[1] for share in stays]
    s = p[rows]
    expected = np.array(stays)[:, None] * s[:-1] + np.array(changes)[:, None]
    for k in range(len(rows) - 2, -1, -1):
        ahead = s[k + 1] / expected[k]
        s[k] *= stays[k] * ahead + changes[k] * np.add.reduce(ahead)
    later = np.searchsorted(rows, np.arange(len(p)))
    s, mean = s[later], mean[later]
    share = _MEAN_SHARE if fits[-1] else 1.0
    known = (1.0 - share) * s + share * mean
    none = np.minimum(mean[:, -1:], known[:, -1:])
    vehicles = known[:, :-1] * (1.0 - none) / np.maximum(1.0 - known[:, -1:], _UNTOLD)
    vehicles = np.minimum(vehicles, np.maximum(mean[:, :-1], UNSURE))
    return np.concatenate([vehicles, 1.0 - np.sum(vehicles, axis=1, keepdims=True)], axis=1)


class _Courses:
    """The courses of all tracks, fed frame by frame."""

    def __init__(self, system_ids: Sequence[int]) -> None:
        self._row = {system_id: k for k, system_id in enumerate(system_ids)}
        self._open: dict[int, _Course] = {}
        self._t_s: deque[float] = deque(maxlen=INTERVALS + 1)

    def add(self, snapshot: Snapshot) -> dict[int, _Course]:
        """Take in a frame; returns the courses of its boxes by track."""
        longest_us = 1e6 * longest_gap_s(_GAP_MAX_S, self._t_s)
        self._t_s.append(snapshot.t_us * 1e-6)
        for box in snapshot.new_boxes:
            if not box.track_id or box.coasting or not box.none_of_ours >= 0.0:
                continue
            course = self._open.get(box.track_id)
            if course is None or not 0 <= snapshot.t_us - course.times_us[-1] <= longest_us:
                course = self._open[box.track_id] = _Course()
            course.add(snapshot.t_us, self._probabilities(box), fits=not snapshot.health.fit <= FITS)
        return {box.track_id: self._open[box.track_id] for box in snapshot.boxes if box.track_id in self._open}

    def forget(self, t_us: int) -> None:
        """Drop what was before a time."""
        for track_id, course in list(self._open.items()):
            course.forget(t_us)
            if course.times_us[-1] < t_us - 1e6 * AHEAD_S:
                del self._open[track_id]

    def _probabilities(self, box: Box) -> FloatArray:
        p = np.zeros(len(self._row) + 1)
        for candidate in box.candidates:
            p[self._row[candidate.system_id]] = candidate.confidence
        if box.system_id in self._row:
            p[self._row[box.system_id]] = box.confidence
        p[-1] = box.none_of_ours
        return (1.0 - _UNTOLD) * p / np.sum(p) + _UNTOLD / len(p)


def by_hindsight(
    snapshots: Iterable[Snapshot], mission: Mission, evidence: FlightEvidence | None = None
) -> Iterator[Snapshot]:
    """Name the boxes of a recording by what is known of their tracks 15 s later, and by the whole recording.

    What the operator stated stays, and so do events and alarms: they tell what was known at the time.

    Args:
        snapshots: of a fold, in its order.
        mission: who can be named, and how probable a name must be.
        evidence: what that fold takes in; None: the whole recording is not looked at.

    Yields:
        The same snapshots, their boxes and vehicles with the names that they turned out to have.
    """
    every, since = _by_courses(snapshots, mission), Since[int, int]()
    for known in every if evidence is None else by_whole_flight(every, mission, evidence):
        yield _renamed(known, mission, since)


def _by_courses(snapshots: Iterable[Snapshot], mission: Mission) -> Iterator[KnownFrame]:
    """The snapshots with what is known of each track by itself, 15 s later."""
    courses, waiting = _Courses(mission.ugv_ids), deque[tuple[Snapshot, dict[int, _Course]]]()
    for snapshot in snapshots:
        waiting.append((snapshot, courses.add(snapshot)))
        # a clock that was set back ends the wait, too
        while abs(snapshot.t_us - waiting[0][0].t_us) > AHEAD_S * 1e6:
            passed, taken = waiting.popleft()
            yield _known(passed, taken)
            courses.forget(passed.t_us)
    for passed, taken in waiting:
        yield _known(passed, taken)


def _known(snapshot: Snapshot, courses: Mapping[int, _Course]) -> KnownFrame:
    known = KnownFrame(snapshot, {})
    found = {track: course.at(known.at_us) for track, course in courses.items()}
    known.p.update((track, p) for track, p in found.items() if p is not None)
    return known


def _renamed(known: KnownFrame, mission: Mission, since: Since[int, int]) -> Snapshot:
    """The snapshot with the names that its tracks turned out to have."""
    snapshot, t_us = known.snapshot, known.at_us
    if not snapshot.boxes:
        return snapshot
    tracked = [box for box in snapshot.boxes if box.track_id]
    contested = frozenset(row.system_id for row in snapshot.vehicles if row.contested or snapshot.vehicles[0].contested)
    boxes = {box.track_id: _with_known_name(box, known.p.get(box.track_id), mission, contested) for box in tracked}
    # of two boxes with one name the surer has it, and one that was seen before one that is only predicted
    holder: dict[int, Box] = {}
    for box in sorted(boxes.values(), key=lambda box: (not box.coasting, box.stated, box.confidence)):
        holder[box.system_id] = box
    for track_id, box in boxes.items():
        lost = box.system_id != 0 and holder[box.system_id] is not box
        changes = _NO_EVIDENCE | {"system_id": 0, "confidence": box.none_of_ours} if lost else {}
        since_us = since.update(t_us, track_id, 0 if lost else box.system_id)
        if changes or since_us != box.since_us:
            boxes[track_id] = replace(box, **changes, since_us=since_us)
    before = {box.system_id: box.track_id for box in tracked if box.system_id}
    new = tuple(
        boxes[box.track_id] if box.track_id else _part(box, boxes.get(before.get(box.system_id, 0)))
        for box in snapshot.boxes
    )
    named = {box.system_id: box for box in reversed(new) if box.system_id}
    accused = snapshot.conflicts, snapshot.doubted
    rows = [row if row.role == "uav" else _row(row, named.get(row.system_id), *accused) for row in snapshot.vehicles]
    return replace(snapshot, boxes=new, vehicles=tuple(rows))


def _with_known_name(box: Box, known: FloatArray | None, mission: Mission, contested: frozenset[int]) -> Box:
    """The box with what is known of it; as it was where nothing is, where it is stated, and where a name was withheld.

    Args:
        box: The box.
        known: (n + 1,) probabilities of each vehicle and of none of them; None: not known.
        mission: Who can be named.
        contested: Vehicles whose names are not to be given.
    """
    if known is None or box.stated or (box.doubt and math.isnan(box.confidence)):
        return box
    system_ids, p = mission.ugv_ids, known.tolist()
    order = sorted((k for k, each in enumerate(p[:-1]) if each >= _MIN_SHOWN), key=lambda k: -p[k])
    first = order[0] if order and p[order[0]] >= mission.identity.threshold - _LOWER else None
    name = 0 if first is None else system_ids[first]
    if name in contested:
        return box
    others = [k for k in order if k != first]
    before = {candidate.system_id: candidate for candidate in box.candidates}
    renamed = name != box.system_id
    candidates = tuple(
        _candidate(system_ids[k], p[k], before.get(system_ids[k]), renamed=renamed) for k in order[:_MAX_CANDIDATES]
    )
    evidence = _NO_EVIDENCE | {"residual_m": before[name].distance_m if name in before else NAN} if renamed else {}
    return replace(
        box,
        **evidence,
        doubt="",
        system_id=name,
        confidence=p[-1 if first is None else first],
        runner_up=system_ids[others[0]] if others else 0,
        runner_up_confidence=p[others[0]] if others else 0.0,
        candidates=candidates,
        none_of_ours=p[-1],
    )


def _candidate(system_id: int, p: float, before: Candidate | None, *, renamed: bool) -> Candidate:
    """A vehicle that a box may be, with what was told of it; what spoke against it did so beside another name."""
    if before is None:
        return Candidate(system_id=system_id, confidence=p)
    against = "" if renamed else before.against
    return Candidate(
        system_id=system_id, confidence=p, distance_m=before.distance_m, against=against, missing=before.missing
    )


def _part(box: Box, whole: Box | None) -> Box:
    """Give the other part of a vehicle its name."""
    if whole is None:
        return box
    return replace(box, system_id=whole.system_id, confidence=whole.confidence, none_of_ours=whole.none_of_ours)


def _row(row: VehicleRow, box: Box | None, conflicts: frozenset[int], doubted: frozenset[int]) -> VehicleRow:
    """The vehicle's line with the box that has its name."""
    standing = standing_of(row, box, conflicts, doubted, lapsed=row.standing == "no new frame")
    return replace(
        row,
        standing=standing,
        standing_since_us=row.standing_since_us if standing == row.standing else 0,
        track_id=box.track_id if box else 0,
        confidence=box.confidence if box else NAN,
        stated=box is not None and box.stated,
    )
