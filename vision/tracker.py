"""Tracks of oriented boxes: ByteTrack's two rounds on a Kalman filter with gates, real time steps and camera motion.

Pixels, seconds, radians; ids start at 1 in each tracker and are never used twice.

Reference:
    Y. Zhang et al., "ByteTrack: Multi-Object Tracking by Associating Every Detection Box", ECCV 2022,
    arXiv:2110.06864, section 3. Here the cost is the log-likelihood of the centre with an overlap term instead of
    overlap alone, since small fast boxes may not overlap from one picture to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from vision import kalman
from vision.boxes import prob_iou, prob_iou_pairs, wrap
from vision.detections import Detections
from vision.matching import assign, mahalanobis
from vision.track_state import TrackState

__all__ = ["Stitch", "Tracker", "TrackerParams", "Tracks"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]

Stitch = Callable[[Ints, Floats], Indices]
"""(track ids (a,), centres (b, 2) px) → pairs (p, 2) of rows: lost tracks that left-over detections continue."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerParams:
    """What a tracker may be told. A box's size is √(w h)."""

    high_score: float = 0.5
    """Boxes matched in the first round. Raise → doubtful boxes give way to sure ones; lower → fewer gaps."""
    low_score: float = 0.1
    """Boxes below are ignored. Raise → fewer wrong continuations; lower → tracks live through blur and shade."""
    new_score: float = 0.3
    """Boxes that may begin a track. Raise → fewer false tracks; lower → weak vehicles are tracked at all."""
    confirm_hits: int = 2
    """Sightings that confirm a track. Raise → false boxes stay tentative longer; lower → tracks count sooner."""
    gate: float = 16.0
    """Largest squared Mahalanobis distance (2 degrees of freedom; 16 keeps 99.97 %). Raise → jerks are followed;
    lower → fewer swaps between neighbours."""
    near: float = 0.6
    """Sizes within which a box matches whatever the filter thinks. Raise → sudden camera motion is survived."""
    overlap_weight: float = 16.0
    """Cost of not overlapping at all, in units of the squared distance. Raise → shape and angle count more."""
    limit: float = 40.0
    """Cost of leaving a track and a box apart. Raise → doubtful matches are made; lower → tracks break instead."""
    centre_noise: float = 0.04
    """Standard deviation of a detected centre, sizes (and at least 1 px). Raise → smoother, slower boxes."""
    wander: float = 2.5
    """Change of a velocity in one second, sizes/s. Raise → hard turns are followed; lower → coasts straighter."""
    first_speed: float = 3.0
    """Standard deviation of the velocity of something just seen, sizes/s. Raise → faster vehicles are caught."""
    top_speed: float = 12.0
    """No vehicle moves faster, sizes/s. Raise → lost tracks reach further; lower → fewer foreign boxes are taken."""
    tentative_s: float = 0.35
    """A track seen less than ``confirm_hits`` times ends after this long unseen."""
    short_s: float = 1.0
    """A confirmed track coasts as long as it was seen, but at least this long ..."""
    coast_s: float = 2.5
    """... and at most this long. Raise → longer occlusions are bridged; lower → fewer ghosts."""
    known_s: float = 0.45
    """A track whose owner is known and that was out of sight for longer is continued by the owner's report only."""
    picture: tuple[int, int] | None = None
    """Width and height, px, when known: a track that has coasted out of the picture ends after ``tentative_s``, so that
    the next vehicle to come in there does not inherit its id."""
    double: float = 0.5
    """Overlap with a matched box above which another box begins no track. Raise → dense parking; lower → no doubles."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks:
    """The k tracks at one picture, in order of their ids, those that coast unseen included. Arrays (k,), read-only."""

    track_id: Ints
    """From 1."""
    detection: Indices
    """Index into this picture's detections, -1 while coasting."""
    cx: Floats
    """Filtered centre, px."""
    cy: Floats
    w: Floats
    """Smoothed sides, px."""
    h: Floats
    angle: Floats
    """Image +x to width axis, clockwise on screen, rad in [-π, π); points to the front where that is known."""
    heading: Floats
    """Clockwise from image up, rad in [0, 2π), NaN unknown; a single turned-around sighting does not flip it."""
    score: Floats
    """Of the last detection."""
    hits: Ints
    """Pictures in which it was seen."""
    age_s: Floats
    """Since first seen."""
    gap_s: Floats
    """Since last seen, 0 when seen now."""
    vx: Floats
    """px/s, camera motion removed as far as the warps said it."""
    vy: Floats

    def __post_init__(self) -> None:
        for f in fields(self):
            getattr(self, f.name).flags.writeable = False

    def __len__(self) -> int:
        return len(self.track_id)

    @property
    def boxes(self) -> Floats:
        """Rows cx cy w h angle, (k, 5)."""
        return np.stack([self.cx, self.cy, self.w, self.h, self.angle], axis=-1)


# A common shift is believed by this share when this many tracks with this many hits bear witness to it.
SHIFT_SHARE = 0.7
SHIFT_WORTH = 0.1
"""Less than this, in sizes, is left to the filter."""
LEAST_WITNESSES = 3
SETTLED_HITS = 4


class Tracker:
    """Follows boxes from picture to picture.

    Example:
        >>> box = Detections(cx=[10.0], cy=[20.0], w=[8.0], h=[4.0], angle=[0.0], score=[0.9], heading=[np.nan])
        >>> tracker = Tracker()
        >>> tracker.update(box, 0).track_id.tolist(), tracker.update(box, 100_000).hits.tolist()
        ([1], [2])
    """

    def __init__(self, params: TrackerParams = TrackerParams()) -> None:
        self.params = params
        self._state = TrackState.none()
        self._next_id = 1
        self._t_us: int | None = None

    def update(
        self,
        detections: Detections,
        t_us: int,
        *,
        warp: Floats | None = None,
        stitch: Stitch | None = None,
        known: Collection[int] = (),
    ) -> Tracks:
        """Take in one picture.

        Args:
            detections: its boxes, in any order.
            t_us: when it was taken. Pictures may be missing; a time that does not advance counts as no time passed.
            warp: (3, 3) homography from the previous picture given here to this one, from the camera's motion.
            stitch: asked once which lost tracks the boxes continue that nothing else explains.
            known: ids of tracks whose owner is known. Once they have been out of sight for a while, ``stitch`` alone
                continues them: where the owner says it is tells more than where the track was heading.
        """
        dt = 0.0 if self._t_us is None else max(t_us - self._t_us, 0) / 1e6
        self._t_us = t_us
        self._advance(dt, warp)
        free = self._match(detections, known if stitch is not None else ())
        if stitch is not None:
            free = self._stitch(detections, free, stitch)
        self._drop()
        self._begin(detections, free)
        return self._tracks()

    def _advance(self, dt: float, warp: Floats | None) -> None:
        state = self._state
        state.predict(dt, self.params.wander * state.length)
        if warp is not None and np.isfinite(warp).all():
            state.warp(np.asarray(warp, dtype=np.float64))

    def _match(self, boxes: Detections, known: Collection[int]) -> NDArray[np.bool_]:
        """Both rounds; boxes (m,) that are left and good enough to matter."""
        params = self.params
        free = boxes.score >= params.low_score
        high = boxes.score >= params.high_score
        self._shift(boxes, free & high)
        out_of_sight = self._state.gap_s > params.known_s
        everyone = ~(out_of_sight & np.isin(self._state.track_id, list(known)))
        self._round(boxes, everyone, free & high, params.gate, free)
        # doubtful boxes only continue tracks that are sure of themselves and were seen a moment ago
        sure = everyone & (self._state.detection < 0) & (self._state.gap_s <= params.short_s)
        self._round(boxes, sure, free & ~high, params.gate, free)
        return free

    def _shift(self, boxes: Detections, chosen: NDArray[np.bool_]) -> None:
        """Take out what all tracks are off by alike: the camera turned in a way that the warp did not know."""
        params, state = self.params, self._state
        rows = np.nonzero((state.hits >= SETTLED_HITS) & (state.gap_s <= params.known_s))[0]
        columns = np.nonzero(chosen)[0]
        if len(rows) < LEAST_WITNESSES or not len(columns):
            return
        apart = boxes.centre[columns] - state.x[rows, None, :2]
        nearest = np.sqrt((apart * apart).sum(axis=2).min(axis=1)) / state.length[rows]
        if np.sort(nearest)[len(nearest) // 2] < SHIFT_WORTH:
            return
        i, j, cost = self._candidates(boxes, rows, columns, 4.0 * params.gate)
        i, j = assign(i, j, cost, 4.0 * params.gate + params.overlap_weight)
        if len(i) >= max(LEAST_WITNESSES, len(rows) // 2):
            off = boxes.centre[columns[j]] - state.x[rows[i], :2]
            # the median in the plane: the one that is nearest to all others
            middle = np.argmin(np.hypot(*np.moveaxis(off[:, None] - off[None], 2, 0)).sum(axis=1))
            state.x[:, :2] += SHIFT_SHARE * off[middle]

    def _round(
        self,
        boxes: Detections,
        tracks: NDArray[np.bool_],
        chosen: NDArray[np.bool_],
        gate: float,
        free: NDArray[np.bool_],
    ) -> None:
        """Assign chosen boxes (m,) to tracks (k,), correct these, and strike what was used from ``free``."""
        rows, columns = np.nonzero(tracks)[0], np.nonzero(chosen)[0]
        if not len(rows) or not len(columns):
            return
        i, j, cost = self._candidates(boxes, rows, columns, gate)
        i, j = assign(i, j, cost, self.params.limit)
        if len(i):
            self._state.correct(rows[i], boxes, columns[j], self._noise(rows[i]))
            free[columns[j]] = False

    def _candidates(
        self, boxes: Detections, rows: Indices, columns: Indices, gate: float
    ) -> tuple[Indices, Indices, Floats]:
        """Pairs within the gate and their cost −2 ln p + overlap term, p the likelihood of the centre."""
        params, state = self.params, self._state
        size = state.length[rows]
        noise = self._noise_of(size)
        seen, known = boxes.boxes[columns], state.boxes[rows]
        offset = seen[:, :2] - known[:, None, :2]
        squared, det = mahalanobis(offset, kalman.innovation(state.P[rows], noise))
        distance2 = (offset**2).sum(axis=-1)
        close = distance2 < ((params.near * size) ** 2)[:, None]
        reach = size * (1.0 + params.top_speed * state.gap_s[rows])
        i, j = np.nonzero(((squared < gate) | close) & (distance2 < (reach**2)[:, None]))
        overlap = prob_iou_pairs(known[i], seen[j])
        # −2 ln p = d² + ln det S up to a constant; relative to R, so that a certain track costs nothing here
        spread = np.log(det / noise**4)
        cost = np.minimum(squared[i, j], gate) + spread[i] + params.overlap_weight * (1 - overlap)
        return i, j, cost

    def _stitch(self, boxes: Detections, free: NDArray[np.bool_], stitch: Stitch) -> NDArray[np.bool_]:
        """Let somebody who knows more continue lost tracks."""
        state = self._state
        rows = np.nonzero((state.detection < 0) & (state.hits >= self.params.confirm_hits))[0]
        columns = np.nonzero(free & (boxes.score >= self.params.new_score))[0]
        if not len(rows) or not len(columns):
            return free
        pairs = np.asarray(stitch(state.track_id[rows].copy(), boxes.centre[columns]), dtype=np.intp).reshape(-1, 2)
        pairs = _one_to_one(pairs, len(rows), len(columns))
        i, j = rows[pairs[:, 0]], columns[pairs[:, 1]]
        size = np.maximum(np.sqrt(boxes.w[j] * boxes.h[j]), 1.0)
        state.restart(i, boxes, j, self._noise_of(size), self.params.first_speed * size)
        left = free.copy()
        left[j] = False
        return left

    def _drop(self) -> None:
        """End tracks that were not seen for too long."""
        params, state = self.params, self._state
        patience = np.clip(state.age_s - state.gap_s, params.short_s, params.coast_s)
        brief = state.hits < params.confirm_hits
        if params.picture is not None:
            brief |= ((state.x[:, :2] < 0) | (state.x[:, :2] > params.picture)).any(axis=1)
        patience = np.where(brief, params.tentative_s, patience)
        alive = state.gap_s <= patience
        if not alive.all():
            self._state = state.keep(alive)

    def _begin(self, boxes: Detections, free: NDArray[np.bool_]) -> None:
        """Begin a track on each box that is left, unless it repeats a box that has a track."""
        params, state = self.params, self._state
        index = np.nonzero(free & (boxes.score >= params.new_score))[0]
        used = state.detection[state.detection >= 0]
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

    def _noise(self, rows: Indices) -> Floats:
        return self._noise_of(self._state.length[rows])

    def _noise_of(self, size: Floats) -> Floats:
        """Standard deviation of detected centres, px."""
        return np.maximum(self.params.centre_noise * size, 1.0)

    def _tracks(self) -> Tracks:
        state = self._state
        heading = state.heading
        return Tracks(
            track_id=state.track_id.copy(),
            detection=state.detection.copy(),
            cx=state.x[:, 0].copy(),
            cy=state.x[:, 1].copy(),
            w=state.sides[:, 0].copy(),
            h=state.sides[:, 1].copy(),
            angle=wrap(np.where(np.isnan(heading), state.axis, heading - np.pi / 2)),
            heading=heading,
            score=state.score.copy(),
            hits=state.hits.copy(),
            age_s=state.age_s.copy(),
            gap_s=state.gap_s.copy(),
            vx=state.x[:, 2].copy(),
            vy=state.x[:, 3].copy(),
        )


def _one_to_one(pairs: Indices, rows: int, columns: int) -> Indices:
    """Pairs (p, 2) within range whose row and column no earlier pair has."""
    pairs = pairs[(pairs >= 0).all(axis=1) & (pairs[:, 0] < rows) & (pairs[:, 1] < columns)]
    for column in (0, 1):
        pairs = pairs[np.sort(np.unique(pairs[:, column], return_index=True)[1])]
    return pairs
