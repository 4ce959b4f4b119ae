"""Tracks of oriented boxes: ByteTrack's two rounds on a Kalman filter with gates, real time steps and camera motion.

Pixels, seconds, radians; ids start at 1 in each tracker and are never used twice.

Reference:
    Y. Zhang et al., "ByteTrack: Multi-Object Tracking by Associating Every Detection Box", ECCV 2022,
    arXiv:2110.06864, section 3. Here the cost is the log-likelihood of the centre with an overlap term instead of
    overlap alone, since small fast boxes may not overlap from one frame to the next.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import prob_iou, prob_iou_pairs, wrap
from vision.detect.detections import Detections
from vision.track import kalman
from vision.track.alignment import Alignment, BoxShapes, Lens, align
from vision.track.evidence import TrackEvidence
from vision.track.matching import Pairs, assign, one_to_one
from vision.track.merged_detections import find_merged, find_shared
from vision.track.track_state import ENOUGH, TrackState
from vision.track.tracks import Stitch, TrackerParams, Tracks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]

INTERVALS, MISSED_FRAMES = 5, 2.2
"""Number of frame intervals whose median is the usual one, and how many usual ones a track may go without a box: one
frame in which its vehicle is missed must not end it."""
MIN_SHIFT = 0.1
"""Displacement of most tracks, in box sizes, below which it is left to the filter."""
REACH = 4.0
"""Greatest displacement of a track by an unknown motion of the camera, sizes."""
UNREST_S = 1.0
"""Time over which displacements are averaged."""
FIRST_UNREST_PX2 = 400.0
"""Mean square of displacements that is assumed at first."""
VELOCITY_SHARE = 0.2
"""Share of a displacement that is taken for velocity: a camera that turns on is followed, one that shakes hardly."""
REST = 0.25
"""Displacement in sizes that is never unusual."""
REACH_SHARE = 0.05
"""Least reach as a share of the frame's width, for small boxes: they jump as far as large ones."""
FIRST_NOISE_MATCHES, NOISE_MATCHES = 10.0, 60.0
"""Matches that the usual noise of detected centres counts for, and over which it is averaged: some seconds of a few
vehicles."""
MARGIN, MAX_NOISE = 1.5, 4.0
"""Noise of detected centres up to which the usual one holds, and the greatest, in units of that: vehicles whose boxes
merge look a little noisier than they are."""
LIKE = 0.2
"""Greatest difference, in its logarithm, between the size of a box that tells about the noise and that of its track."""
UNUSUAL = 4.0
"""Distance² of a match, in units of what is expected, beyond which it tells no more about the noise."""
SURE_SHARE = 0.7
"""Share of all that could be explained from which on the warp is not doubted."""
BETTER_START = 6.0
"""Advantage, in units of the squared distance, with which leaving the warp out has to explain the boxes."""


class Tracker:
    """Follows boxes from frame to frame.

    Example:
        >>> box = Detections(cx=[10.0], cy=[20.0], w=[8.0], h=[4.0], angle=[0.0], score=[0.9], heading=[np.nan])
        >>> tracker = Tracker()
        >>> tracker.update(box, 0).track_id.tolist(), tracker.update(box, 100_000).hits.tolist()
        ([1], [2])
    """

    def __init__(self, params: TrackerParams | None = None) -> None:
        self.params = params or TrackerParams()
        self._state = TrackState.none()
        self._next_id = 1
        self._t_us: int | None = None
        self._paced = self.params
        """Parameters with patience for as long as a missed frame takes."""
        self._recent_s = self.params.known_s
        self._intervals_s: deque[float] = deque(maxlen=INTERVALS)
        self._unwarped: TrackState | None = None
        """The tracks of this frame without its warp, which may be wrong."""
        self._inside = np.zeros(0, dtype=bool)
        """(k,) the tracks that are inside a box around several in this frame."""
        self._evidence = TrackEvidence(self.params.new_score)
        self._noise2, self._noise_matches = 1.0, FIRST_NOISE_MATCHES
        """Variance of detected centres, in units of what is usual, and how many matches it rests on."""
        self._unrest = FIRST_UNREST_PX2
        """Mean square of the recent displacements that were common to all tracks, px²."""

    def update(
        self,
        detections: Detections,
        t_us: int,
        *,
        warp: Floats | None = None,
        stitch: Stitch | None = None,
        known: Collection[int] = (),
        focal_px: float | None = None,
        reported_px: Floats | None = None,
    ) -> Tracks:
        """Continue, begin and end tracks by the boxes of one frame.

        Args:
            detections: its boxes, in any order.
            t_us: when it was taken. Frames may be missing; a time that does not advance counts as no time passed.
            warp: (3, 3) homography from the previous frame given here to this one, from the camera's motion.
            stitch: called once for lost tracks and left-over boxes; returns which boxes continue which tracks.
            known: ids of tracks whose vehicle is known. Once they have been out of sight for a while, ``stitch`` alone
                continues them: the vehicle's report is better evidence than the track's course.
            focal_px: of the camera; None unknown.
            reported_px: (n, 2) where vehicles report to be: what looks like one there most probably is one.
        """
        dt = 0.0 if self._t_us is None else max(t_us - self._t_us, 0) / 1e6
        self._t_us = t_us
        self._pace(dt)
        self._advance(dt, warp)
        if detections.looked is not None:
            self._state.skip(self._unlooked(detections), dt)
        order, n = self._strong_first(detections.score)
        boxes = detections if order is None else detections.select(order)
        strong = boxes if n == len(boxes) else boxes.select(np.arange(n))
        free, owners = np.ones(n, dtype=bool), known if stitch is not None else ()
        if len(self._state) and len(boxes):
            self._inside = np.zeros(len(self._state), dtype=bool)
            if n:
                high = strong.score >= self.params.high_score
                self._align(strong, high, dt, focal_px)
                free = self._match(strong, free, high, dt, owners)
            if n < len(boxes):
                self._extend(boxes, n, owners)
            if stitch is not None:
                free = self._stitch(strong, free, stitch)
        self._drop()
        if self._unwarped is not None:
            # the camera's motion is known
            self._state.drive(dt)
        self._begin(boxes, free)
        self._evidence.gather(self._state, dt, reported_px, REACH_SHARE * (self.params.frame_size or (0, 0))[0])
        return self._tracks(order)

    @property
    def living(self) -> frozenset[int]:
        """Ids of all tracks, with those of too little evidence to be among the results just now."""
        return frozenset(self._state.track_id.tolist())

    def _strong_first(self, score: Floats) -> tuple[Indices | None, int]:
        """The boxes (m,) that count, strong ones first, None where all are strong; and how many are."""
        strong = score >= self.params.new_score
        n = int(np.count_nonzero(strong))
        if n == len(score):
            return None, n
        weak = ~strong & (score >= self.params.low_score)
        return np.concatenate([np.flatnonzero(strong), np.flatnonzero(weak)]), n

    def _pace(self, dt: float) -> None:
        """Take a box that is missed in one frame for no reason to give a track up, however far apart frames are."""
        params, missed_s = self.params, 0.0
        if len(self._intervals_s) > INTERVALS // 2:
            missed_s = min(MISSED_FRAMES * median(self._intervals_s), params.coast_s)
        if dt > 0.0:
            self._intervals_s.append(dt)
        # nor is a track out of sight while no frame comes
        self._recent_s = max(params.known_s, missed_s, dt)
        tentative_s, short_s = max(params.tentative_s, missed_s), max(params.short_s, missed_s)
        if (tentative_s, short_s) != (self._paced.tentative_s, self._paced.short_s):
            self._paced = replace(params, tentative_s=tentative_s, short_s=short_s)

    def _advance(self, dt: float, warp: Floats | None) -> None:
        state = self._state
        state.predict(dt, self.params.wander)
        self._unwarped = None
        if warp is not None and np.isfinite(warp).all():
            self._unwarped = state.copy()
            state.warp(np.asarray(warp, dtype=np.float64))
        state.note_expected()

    def _unlooked(self, detections: Detections) -> Flags:
        """(k,) tracks in the picture that nobody looked for."""
        centre = self._state.x[:, :2]
        inside = ((centre >= 0.0) & (centre <= (self.params.frame_size or np.inf))).all(axis=1)
        return np.asarray(inside & ~detections.looked_at(centre))

    def _match(self, boxes: Detections, free: Flags, high: Flags, dt: float, known: Collection[int]) -> Flags:
        """Both rounds on the boxes (m,) that are free; which are free afterwards; those around several never are."""
        params, state = self.params, self._state
        apart = state.apart(boxes)
        merged = find_merged(state, self._paced, boxes, apart)
        if merged is not None:
            free, high = free & ~merged.box, high & ~merged.box
            state.move(merged.rows, merged.place, merged.gap_s)
            self._inside[merged.rows] = True
            apart = state.apart(boxes)
        shared = find_shared(state, self._paced, boxes, free, apart, self._noise_of(state.length))
        if shared is not None:
            free, high = free & ~shared.box, high & ~shared.box
            state.move(shared.rows, shared.place, shared.gap_s)
            state.share(shared.rows, dt)
            self._inside[shared.rows] = True
        pairs = self._candidates(boxes, apart, params.gate)
        if len(known):
            pairs = pairs.where(~self._owned(known)[pairs.row])
        rows, columns = self._rounds(boxes, pairs, high, free)
        if len(rows):
            self._learn_noise(rows, boxes, columns)
            state.correct(rows, boxes, columns, self._noise_of(state.length[rows]))
        return _without(free, columns)

    def _learn_noise(self, rows: Indices, boxes: Detections, columns: Indices) -> None:
        """Learn the noise of detected centres from how far boxes are from where their tracks are expected.

        With y the offset of a box, P the variance of where its track is expected and r² the usual noise, per axis, the
        noise has the variance E[y² − P] / r² in units of the usual one, averaged with the weights R²/(R + P)².
        """
        state = self._state
        size = np.sqrt(boxes.w[columns] * boxes.h[columns])
        steady = state.confirmed[rows] & (state.gap_s[rows] <= self._recent_s)
        # a box round two, or round a part, is elsewhere than its vehicle
        steady &= np.abs(np.log(size / state.length[rows])) < LIKE
        tracks, offset = state.select(rows[steady]), boxes.centre[columns[steady]] - state.x[rows[steady], :2]
        if not len(tracks):
            return
        usual2, expected2 = self._usual_noise(tracks.length) ** 2, 0.5 * (tracks.P[:, 0, 0] + tracks.P[:, 1, 1])
        noise2 = self._noise_of(tracks.length) ** 2
        # where a track is expected within wide limits a box tells little
        weight = (noise2 / (noise2 + expected2)) ** 2
        squared = np.minimum(0.5 * (offset * offset).sum(axis=1), UNUSUAL * (expected2 + noise2))
        self._noise_matches = min(self._noise_matches + weight.sum(), NOISE_MATCHES)
        found = weight * ((squared - expected2) / usual2 - self._noise2)
        self._noise2 += float(found.sum()) / max(self._noise_matches, weight.sum())

    def _extend(self, boxes: Detections, n: int, known: Collection[int]) -> None:
        """ByteTrack's second round: boxes (m,) from the n-th on are weak, and only continue confirmed tracks."""
        state, params = self._state, self.params
        lost = state.confirmed & state.unseen & (state.missed_s <= self._paced.short_s) & ~self._inside
        if len(known):
            lost &= ~self._owned(known)
        if not np.count_nonzero(lost):
            return
        weak = boxes.select(np.arange(n, len(boxes)))
        pairs = self._candidates(weak, state.apart(weak), params.gate)
        i, j = self._settle(weak, pairs.where(lost[pairs.row]), params.weak_limit)
        if len(i):
            state.correct(i, boxes, n + j, self._noise_of(state.length[i]))

    def _owned(self, known: Collection[int]) -> Flags:
        """Tracks (k,) out of sight that are continued by their vehicles' reports only."""
        owned = self._state.missed_s > self._recent_s
        if np.count_nonzero(owned):
            owned &= np.isin(self._state.track_id, list(known))
        return owned

    def _align(self, boxes: Detections, chosen: Flags, dt: float, focal_px: float | None) -> None:
        """Move the tracks by what they all are displaced: the camera moved in a way that the warp does not contain.

        Args:
            chosen: (m,) those that count.
            dt: s since the frame before.
            focal_px: of the camera, None unknown.
        """
        state = self._state
        voters = np.flatnonzero(state.gap_s <= self._recent_s)
        count = int(np.count_nonzero(chosen))
        if not len(voters) or not count:
            return
        keep = np.exp(-dt / UNREST_S)
        self._unrest *= keep
        nearest = state.apart(boxes)[voters][:, chosen].min(axis=1)
        near = nearest < (MIN_SHIFT * state.length[voters]) ** 2
        # boxes of nothing come once, but at the start nothing has come twice
        settled = state.confirmed[voters]
        if not np.count_nonzero(settled):
            settled[:] = True
        if np.count_nonzero(near & settled) > min(int(np.count_nonzero(settled)), count) // 2:
            return
        seen = BoxShapes.of(boxes.boxes[chosen])
        found = self._aligned(state, voters, seen, focal_px)
        if self._unwarped is not None and found.share < SURE_SHARE:
            other = self._aligned(self._unwarped, voters, seen, focal_px)
            if other.score > found.score + BETTER_START:
                state.take_motion(self._unwarped)
                found = other
        self._unrest += (1 - keep) * found.moved_px**2
        before = state.x[:, :2].copy()
        state.warp(found.H)
        if dt > 0:
            state.x[:, 2:] += VELOCITY_SHARE * (state.x[:, :2] - before) / dt

    def _aligned(self, state: TrackState, voters: Indices, seen: BoxShapes, focal_px: float | None) -> Alignment:
        params = self.params
        voting = state.select(voters)
        noise = self._noise_of(voting.length)
        P, floor = voting.P, noise * noise
        variance = 0.5 * (P[:, 0, 0] + P[:, 1, 1]) + floor
        size = voting.length
        middle = voting.x[:, :2].mean(axis=0) if params.frame_size is None else 0.5 * np.array(params.frame_size)
        return align(
            BoxShapes.of(voting.boxes),
            variance,
            seen,
            worth=params.limit - params.overlap_weight - 2.0 * np.log(variance / floor),
            reach=np.maximum(REACH * size, REACH_SHARE * (self.params.frame_size or (0, 0))[0]),
            usual_px=float(np.sqrt(self._unrest + (REST * np.median(size)) ** 2)),
            lens=Lens(middle=middle, focal_px=focal_px or np.inf),
        )

    def _candidates(self, boxes: Detections, apart: Floats, gate: float) -> Pairs:
        """Pairs within the gate and their cost without the overlap term: −2 ln p, p the likelihood of the centre."""
        params, state = self.params, self._state
        row, column = np.nonzero(apart < self._reach(state)[:, None] ** 2)
        near = state.select(row)
        noise, close = self._noise_of(near.length), params.near * near.length
        offset = boxes.table[:2].take(column, axis=1).T - near.x[:, :2]
        squared, det = kalman.mahalanobis(offset, near.P, noise)
        # −2 ln p = d² + ln det S up to a constant; relative to R, so that a certain track costs nothing here
        variance = noise * noise
        pairs = Pairs(row, column, np.minimum(squared, gate) + np.log(det / (variance * variance)))
        inside = (squared < gate) | (apart[row, column] < close * close)
        return pairs if np.count_nonzero(inside) == len(inside) else pairs.where(inside)

    def _reach(self, state: TrackState) -> Floats:
        """(k,) how far from where it is expected a vehicle can be, px."""
        return np.asarray(state.length * (1.0 + self.params.top_speed * state.gap_s))

    def _rounds(self, boxes: Detections, pairs: Pairs, high: Flags, free: Flags) -> tuple[Indices, Indices]:
        """Rows and columns that belong together: boxes of high score choose first, the others among the tracks left."""
        limit = self.params.limit
        first = high[pairs.column]
        if np.count_nonzero(first) == len(first):
            return self._settle(boxes, pairs, limit)
        # boxes of low score only continue tracks that were seen a moment ago
        then = ~first & free[pairs.column] & (self._state.missed_s <= self._paced.short_s)[pairs.row]
        both = pairs.where(first | then)
        if both.undisputed(limit - self.params.overlap_weight):
            return both.row, both.column
        rows, columns = self._settle(boxes, pairs.where(first), limit)
        left = np.ones(len(self._state), dtype=bool)
        left[rows] = False
        more_rows, more_columns = self._settle(boxes, pairs.where(then & left[pairs.row]), limit)
        return np.concatenate([rows, more_rows]), np.concatenate([columns, more_columns])

    def _settle(self, boxes: Detections, pairs: Pairs, limit: float) -> tuple[Indices, Indices]:
        """The pairs that are taken, with the overlap term in their cost where it can change the answer."""
        weight = self.params.overlap_weight
        if pairs.undisputed(limit - weight):
            return pairs.row, pairs.column
        disputed = pairs.disputed(limit - weight)
        row, column, cost = pairs.where(disputed)
        overlap = prob_iou_pairs(self._state.boxes[row], boxes.boxes[column])
        i, j = assign(row, column, cost + weight * (1 - overlap), limit)
        return np.concatenate([pairs.row[~disputed], i]), np.concatenate([pairs.column[~disputed], j])

    def _stitch(self, boxes: Detections, free: Flags, stitch: Stitch) -> Flags:
        """Continue lost tracks with boxes (m,) that are free, as ``stitch`` has it; which boxes are still free."""
        state = self._state
        columns = np.flatnonzero(free)
        if not len(columns):
            return free
        rows = np.flatnonzero(state.unseen & state.confirmed)
        if not len(rows):
            return free
        pairs = np.asarray(stitch(state.track_id[rows], boxes.centre[columns]), dtype=np.intp).reshape(-1, 2)
        pairs = one_to_one(pairs, len(rows), len(columns))
        i, j = rows[pairs[:, 0]], columns[pairs[:, 1]]
        # a report that errs is no reason to leap to a false box
        within = state.apart(boxes)[i, j] < self._reach(state)[i] ** 2
        i, j = i[within], j[within]
        size = np.maximum(np.sqrt(boxes.w[j] * boxes.h[j]), 1.0)
        state.restart(i, boxes, j, self._noise_of(size), self.params.first_speed * size)
        return _without(free, j)

    def _drop(self) -> None:
        """End tracks that were not seen for too long."""
        params, state = self._paced, self._state
        gap = state.missed_s
        if not len(gap) or gap.max() <= min(params.tentative_s, params.short_s, params.coast_s):
            return
        patience = np.minimum(np.maximum(state.age_s - gap, params.short_s), params.coast_s)
        brief = ~state.confirmed
        if params.frame_size is not None:
            centre = state.x[:, :2]
            brief |= ((centre < 0) | (centre > params.frame_size)).any(axis=1)
        alive = gap <= np.where(brief, params.tentative_s, patience)
        if np.count_nonzero(alive) < len(alive):
            self._state = state.select(np.flatnonzero(alive))

    def _begin(self, boxes: Detections, free: Flags) -> None:
        """Begin a track on each box that is left, unless it repeats a box that has a track."""
        if not np.count_nonzero(free):
            return
        params, state = self.params, self._state
        index = np.flatnonzero(free)
        used = state.detection[~state.unseen]
        if len(index) and len(used):
            doubled = prob_iou(boxes.boxes[index], boxes.boxes[used]).max(axis=1) > params.double
            index = index[~doubled]
        if not len(index):
            return
        # ids do not depend on the order in which the boxes come
        index = index[np.lexsort((boxes.cy[index], boxes.cx[index], -boxes.score[index]))]
        size = np.maximum(np.sqrt(boxes.w[index] * boxes.h[index]), 1.0)
        born = TrackState.start(boxes, index, self._next_id, self._noise_of(size), params.first_speed * size)
        self._next_id += len(index)
        self._state = state.join(born)

    def _usual_noise(self, size: Floats) -> Floats:
        """Usual standard deviation of detected centres, px."""
        return np.maximum(self.params.centre_noise * size, 1.0)

    def _noise_of(self, size: Floats) -> Floats:
        """Standard deviation of detected centres in this film, px."""
        learned = math.sqrt(max(self._noise2, 0.0))
        factor = min(max(1.0 + 2.0 * (learned - MARGIN), 1.0), max(learned, 1.0), MAX_NOISE)
        return np.asarray(factor * self._usual_noise(size))

    def _tracks(self, order: Indices | None) -> Tracks:
        state = self._state
        known = state.evidence >= ENOUGH
        if np.count_nonzero(known) < len(known):
            state = state.select(np.flatnonzero(known))
        front = state.front
        angle = wrap(state.axis + np.pi * (front < 0.0))
        heading = (angle + 0.5 * np.pi) % (2 * np.pi)
        (cx, cy, vx, vy, w, h, _, _, _, score, age_s, gap_s), (track_id, detection, hits) = state.columns()
        if order is not None:
            # the last entry answers for -1, unseen
            detection = np.append(order, -1)[detection]
        if np.count_nonzero(front) < len(front):
            heading[front == 0] = np.nan
        return Tracks(
            track_id=track_id,
            detection=detection,
            cx=cx,
            cy=cy,
            w=w,
            h=h,
            angle=angle,
            heading=heading,
            score=score,
            hits=hits,
            age_s=age_s,
            gap_s=gap_s,
            missed_s=state.missed_s,
            vx=vx,
            vy=vy,
            expected=state.expected,
        )


def _without(free: Flags, used: Indices) -> Flags:
    """The boxes (m,) that are free less those that are used."""
    left = free.copy()
    left[used] = False
    return left
