"""ByteTrack as published, the tracker that the paper starts from: a peer for measurements, not used by the program.

Reference: Y. Zhang et al., "ByteTrack: Multi-Object Tracking by Associating Every Detection Box", ECCV 2022,
arXiv:2110.06864. Axis-aligned boxes of the oriented ones, a Kalman filter on centre, aspect and height, overlap times
score in the first round, overlap in the second, tracks kept for thirty frames. Time is counted in frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.track.matching import assign
from vision.track.tracks import Stitch, Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HIGH, LOW, NEW = 0.5, 0.1, 0.6
FIRST, SECOND, UNCONFIRMED = 0.8, 0.5, 0.7
BUFFER = 30
_PLACE, _SPEED = 1.0 / 20.0, 1.0 / 160.0
_F = np.eye(8) + np.eye(8, k=4)


@dataclass(slots=True, eq=False)
class _KalmanTrack:
    """One vehicle: x = centre u, v, aspect, height and their change per frame."""

    track_id: int
    x: FloatArray
    P: FloatArray
    confirmed: bool
    lost: int = 0
    """Frames since it was seen."""
    detection: int = -1


class ByteTrack:
    """Follows boxes from frame to frame by overlap."""

    def __init__(self) -> None:
        self._tracks: list[_KalmanTrack] = []
        self._next_id = 1
        self._frame = 0

    def update(self, detections: Detections, stitch: Stitch | None = None) -> Tracks:
        """Take in one frame.

        Args:
            detections: Its boxes.
            stitch: Asked, as Algorithm 1 does, which unmatched tracks the boxes left over continue.

        Returns:
            The tracks that were seen in it.
        """
        self._frame += 1
        boxes = _aligned(detections)
        for track in self._tracks:
            _predict(track)
        free = self._match(boxes, detections.score)
        if stitch is not None:
            self._continue(detections, boxes, free, stitch)
        self._begin(boxes, detections.score, free)
        self._tracks = [track for track in self._tracks if track.lost <= (BUFFER if track.confirmed else 0)]
        return self._seen(detections)

    def _match(self, boxes: FloatArray, score: FloatArray) -> NDArray[np.bool_]:
        """Three rounds; True for boxes that are left and sure enough to begin a track."""
        free = score >= LOW
        high = score >= HIGH
        sure = [track for track in self._tracks if track.confirmed]
        self._round(sure, boxes, free & high, FIRST, free, score)
        seen_before = [track for track in sure if track.detection < 0 and track.lost == 1]
        self._round(seen_before, boxes, free & ~high, SECOND, free, None)
        self._round([t for t in self._tracks if not t.confirmed], boxes, free & high, UNCONFIRMED, free, score)
        return free & high

    def _round(
        self,
        tracks: list[_KalmanTrack],
        boxes: FloatArray,
        chosen: NDArray[np.bool_],
        limit: float,
        free: NDArray[np.bool_],
        score: FloatArray | None,
    ) -> None:
        columns = np.flatnonzero(chosen)
        if not tracks or not len(columns):
            return
        # cost = 1 − IoU · score
        alike = _iou(np.stack([_box(track) for track in tracks]), boxes[columns])
        cost = 1.0 - (alike if score is None else alike * score[columns])
        i, j = np.nonzero(cost <= limit)
        rows, taken = assign(i, j, cost[i, j], limit)
        for row, column in zip(rows.tolist(), columns[taken].tolist(), strict=True):
            _correct(tracks[row], boxes[column], column)
            free[column] = False

    def _continue(self, detections: Detections, boxes: FloatArray, free: NDArray[np.bool_], stitch: Stitch) -> None:
        unmatched = [track for track in self._tracks if track.detection < 0 and track.confirmed]
        columns = np.flatnonzero(free)
        if not unmatched or not len(columns):
            return
        names = np.array([track.track_id for track in unmatched], np.int64)
        for row, column in stitch(names, detections.centre[columns]).tolist():
            track, k = unmatched[row], int(columns[column])
            track.x, track.P = _born(boxes[k])
            track.lost, track.detection = 0, k
            free[k] = False

    def _begin(self, boxes: FloatArray, score: FloatArray, free: NDArray[np.bool_]) -> None:
        for k in np.flatnonzero(free & (score >= NEW)).tolist():
            x, P = _born(boxes[k])
            first = self._frame == 1
            self._tracks.append(_KalmanTrack(track_id=self._next_id, x=x, P=P, confirmed=first, detection=k))
            self._next_id += 1

    def _seen(self, detections: Detections) -> Tracks:
        seen = sorted((t for t in self._tracks if t.detection >= 0 and t.confirmed), key=lambda t: t.track_id)
        rows = np.array([track.detection for track in seen], np.intp)
        none = np.zeros(len(seen))
        return Tracks(
            track_id=np.array([track.track_id for track in seen], np.int64),
            detection=rows,
            cx=detections.cx[rows],
            cy=detections.cy[rows],
            w=detections.w[rows],
            h=detections.h[rows],
            angle=detections.angle[rows],
            heading=detections.heading[rows],
            score=detections.score[rows],
            hits=np.ones(len(seen), np.int64),
            age_s=none,
            gap_s=none.copy(),
            vx=none.copy(),
            vy=none.copy(),
            expected=np.full((len(seen), 2), np.nan),
        )


def _aligned(detections: Detections) -> FloatArray:
    """(m, 4) centre u, v, aspect w / h and height of the upright box around each oriented one."""
    corners = detections.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    size = np.maximum(high - low, 1.0)
    return np.column_stack([0.5 * (low + high), size[:, 0] / size[:, 1], size[:, 1]])


def _box(track: _KalmanTrack) -> FloatArray:
    return track.x[:4]


def _born(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    h = float(z[3])
    std = [
        2 * _PLACE * h,
        2 * _PLACE * h,
        1e-2,
        2 * _PLACE * h,
        10 * _SPEED * h,
        10 * _SPEED * h,
        1e-5,
        10 * _SPEED * h,
    ]
    return np.concatenate([z, np.zeros(4)]), np.diag(np.square(std))


def _predict(track: _KalmanTrack) -> None:
    h = float(track.x[3])
    std = [_PLACE * h, _PLACE * h, 1e-2, _PLACE * h, _SPEED * h, _SPEED * h, 1e-5, _SPEED * h]
    if track.lost:
        track.x[7] = 0.0
    # x ← F x,  P ← F P Fᵀ + Q
    track.x, track.P = _F @ track.x, _F @ track.P @ _F.T + np.diag(np.square(std))
    track.lost, track.detection = track.lost + 1, -1


def _correct(track: _KalmanTrack, z: FloatArray, detection: int) -> None:
    h = float(track.x[3])
    R = np.diag(np.square([_PLACE * h, _PLACE * h, 1e-1, _PLACE * h]))
    # K = P Hᵀ (H P Hᵀ + R)⁻¹
    K = np.linalg.solve(track.P[:4, :4] + R, track.P[:4]).T
    track.x, track.P = track.x + K @ (z - track.x[:4]), track.P - K @ track.P[:4]
    track.lost, track.detection, track.confirmed = 0, detection, True


def _iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """(p, q) overlap of upright boxes given as centre, aspect, height."""
    half_a, half_b = (0.5 * np.column_stack([x[:, 2] * x[:, 3], x[:, 3]]) for x in (a, b))
    low = np.maximum((a[:, :2] - half_a)[:, None], (b[:, :2] - half_b)[None])
    high = np.minimum((a[:, :2] + half_a)[:, None], (b[:, :2] + half_b)[None])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    area_a, area_b = 4.0 * np.prod(half_a, axis=1), 4.0 * np.prod(half_b, axis=1)
    return np.asarray(common / (area_a[:, None] + area_b[None] - common))
