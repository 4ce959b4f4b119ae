"""Names by the whole of a recording, stretch by stretch: what each box is by all frames and reports about it.

``assoc.whole_flight`` finds the names, the camera's pose and the errors of the vehicles' positions together. What it
gives counts 0.8, and 0.2 what is known of each track by itself (``gcs.playback.hindsight``): an answer is sure where
both are. Where the whole flight is sure of the name that is the track's likeliest, it counts 0.95, and where it has
nobody for a track that is known by itself, 0.15. A stretch in which it expects fewer right names than are known already
keeps those: there the errors are of another kind than it knows, as where a camera shakes. One that film and telemetry
do not fit in is left as it is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from assoc.identification.common_boxes import LONGER, RIGHT
from assoc.whole_flight.doubles import limited
from assoc.whole_flight.evidence import FlightEvidence, Segments
from assoc.whole_flight.naming import SegmentNames, segment_names
from gcs.mission.mission import Mission
from gcs.snapshot import Snapshot

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FITS = 0.5
"""Probability from which on film and telemetry count as belonging together."""
_STRETCH_S, _MARGIN_S = 60.0, 30.0
"""Boxes of this long are named at once, by what was seen from this long before the first to this long after the last,
s."""
_WHOLE_SHARE, _AGREED_SHARE = 0.8, 0.95
"""Weight of the whole flight against what is known of the track by itself, and where it is sure of the name that is the
track's likeliest, too.
"""
_MISSED_SHARE = 0.15
"""Weight of the whole flight where it has nobody for a track that is known by itself: 86 % of such names are right."""
_AGREED, _LIKELIEST, _KNOWN = 0.99, 0.5, 0.98
"""Probability from which on the whole flight is sure, that of what is more likely than not, and of a known track."""
_MIN_GAIN = 0.97
"""Share of the names that are known without it, by their probabilities, which a stretch has to give to count."""
_USUAL = 0.2
"""Share of the boxes of a vehicle that are no longer than it is: one round two vehicles is longer, none is shorter."""
UNSURE = 0.89
"""Highest probability of an answer of which not both, the whole flight and the track by itself, are surer."""


@dataclass(frozen=True, slots=True)
class KnownFrame:
    """A snapshot with what is known of its boxes."""

    snapshot: Snapshot
    p: dict[int, FloatArray]
    """(n + 1,) probabilities of each vehicle and of none of them, by track."""

    @property
    def at_us(self) -> int:
        """Time at which its boxes were seen, Unix µs."""
        return self.snapshot.seen_us or self.snapshot.t_us


def by_whole_flight(every: Iterable[KnownFrame], mission: Mission, evidence: FlightEvidence) -> Iterator[KnownFrame]:
    """Name boxes by the whole of a recording.

    Yields:
        The same, with what is known then.
    """
    given, waiting = deque[KnownFrame](), deque[KnownFrame]()
    for known in every:
        # a clock that was set back ends a stretch, too
        set_back = bool(waiting) and known.at_us < waiting[-1].at_us
        if waiting and (set_back or known.at_us - waiting[0].at_us > 1e6 * (_STRETCH_S + _MARGIN_S)):
            stop_us = waiting[-1].at_us if set_back else waiting[0].at_us + round(1e6 * _STRETCH_S)
            named = _stretch(given, waiting, stop_us, mission, evidence)
            yield from named
            given.extend(waiting.popleft() for _ in named)
            while given and abs(given[-1].at_us - given[0].at_us) > 1e6 * _MARGIN_S:
                given.popleft()
            if set_back:
                given.clear()
            elif given:
                evidence.forget(given[0].at_us)
        waiting.append(known)
    if waiting:
        yield from _stretch(given, waiting, waiting[-1].at_us, mission, evidence)


def _stretch(
    before: Iterable[KnownFrame],
    waiting: Iterable[KnownFrame],
    stop_us: int,
    mission: Mission,
    evidence: FlightEvidence,
) -> list[KnownFrame]:
    """The waiting ones up to a time, Unix µs, by all that is there."""
    every = [*before, *waiting]
    named = [known for known in waiting if known.at_us <= stop_us]
    if tuple(mission.ugv_ids) != evidence.system_ids or not every[-1].snapshot.health.fit > FITS:
        return named
    # a name that was given then and lost since tells that the track was exchanged
    row = {system_id: k for k, system_id in enumerate(mission.ugv_ids)}
    names = {
        (known.at_us, box.track_id): row[box.system_id]
        for known in every
        for box in known.snapshot.boxes
        if box.track_id in known.p and box.system_id in row
    }
    names |= {
        (known.at_us, track): int(np.argmax(p[:-1]))
        for known in every
        for track, p in known.p.items()
        if np.max(p[:-1], initial=0.0) >= mission.identity.threshold
    }
    segments = evidence.segments(every[0].at_us, every[-1].at_us, lambda at_us, track: names.get((at_us, track), -1))
    if segments is None:
        return named
    try:
        found = segment_names(segments, evidence.params, _owners(segments, names, every))
    except np.linalg.LinAlgError:
        # as with places so far apart that no arithmetic holds them: the names of the tracks by themselves stay
        return named
    return named if found is None else _chosen(named, found, mission.identity.threshold)


def _owners(segments: Segments, names: dict[tuple[int, int], int], every: list[KnownFrame]) -> IntArray:
    """(S,) vehicle that most boxes of each segment are known to be, −1 none."""
    n = segments.log.n_vehicles
    votes = np.zeros((segments.seen.shape[1], n + 1))
    for known in every:
        for track in known.p:
            segment = segments.of.get((known.at_us, track))
            if segment is not None:
                votes[segment, names.get((known.at_us, track), n)] += 1.0
    first = np.argmax(votes, axis=1)
    return np.where((first < n) & (np.max(votes, axis=1) > 0.0), first, -1)


def _chosen(named: list[KnownFrame], found: SegmentNames, threshold: float) -> list[KnownFrame]:
    """The snapshots by the whole flight, or by each track where that expects more right names.

    Either way a name counts half where another vehicle, or a stranger, may be in its box.
    """
    whole, alone = list[KnownFrame](), list[KnownFrame]()
    gained, had = 0.0, 0.0
    for known in named:
        own = {track: found.with_another(p, known.at_us, track) for track, p in known.p.items()}
        pooled = dict(own)
        for track, before in known.p.items():
            p = found.at(known.at_us, track)
            if p is not None:
                pooled[track] = found.with_another(_pooled(p, before), known.at_us, track)
                gained += _named_share(pooled[track], threshold)
                had += _named_share(own[track], threshold)
        whole.append(replace(known, p=pooled))
        alone.append(replace(known, p=own))
    return _with_long_doubted(whole if gained > _MIN_GAIN * had else alone, found.segments.length_m)


def _with_long_doubted(named: list[KnownFrame], length_m: Mapping[tuple[int, int], float]) -> list[KnownFrame]:
    """The snapshots with less certainty where a box is so long that it may be round two vehicles.

    Args:
        named: by the whole flight, or by each track.
        length_m: lengths of boxes, metres, by the frame's time, Unix µs, and track.
    """
    of_each = dict[int, list[float]]()
    vehicle_of = {
        (frame.at_us, track): int(np.argmax(p))
        for frame in named
        for track, p in frame.p.items()
        if np.argmax(p) < len(p) - 1 and (frame.at_us, track) in length_m
    }
    for box, vehicle in vehicle_of.items():
        of_each.setdefault(vehicle, []).append(length_m[box])
    usual_m = {vehicle: float(np.quantile(lengths, _USUAL)) for vehicle, lengths in of_each.items()}
    long = {box for box, vehicle in vehicle_of.items() if length_m[box] > LONGER * usual_m[vehicle]}

    def doubted(box: tuple[int, int], p: FloatArray) -> FloatArray:
        return limited(p, vehicle_of[box], len(p) - 1, RIGHT) if box in long else p

    return [
        replace(frame, p={track: doubted((frame.at_us, track), p) for track, p in frame.p.items()}) for frame in named
    ]


def _named_share(p: FloatArray, threshold: float) -> float:
    """Probability of the name that is given, 0 for none."""
    best = float(np.max(p[:-1], initial=0.0))
    return best if best >= threshold else 0.0


def _pooled(whole: FloatArray, before: FloatArray) -> FloatArray:
    """(n + 1,) what the whole flight says, pooled with what is known of the track alone; sure where both agree."""
    first = int(np.argmax(whole))
    agreed = first < len(whole) - 1 and whole[first] >= _AGREED and before[first] > _LIKELIEST
    missed = first == len(whole) - 1 and np.max(before[:-1], initial=0.0) > _KNOWN
    share = _AGREED_SHARE if agreed else _MISSED_SHARE if missed else _WHOLE_SHARE
    p = share * whole + (1.0 - share) * before
    first = int(np.argmax(p))
    over = p[first] - UNSURE
    if over > 0.0 and not agreed and min(whole[first], before[first]) < UNSURE:
        p[first] = UNSURE
        if first < len(p) - 1:
            p[-1] += over
        else:  # it is one of those that its track may be
            p[:-1] += over * (before[:-1] + 1e-6) / np.sum(before[:-1] + 1e-6)
    return np.asarray(p)
