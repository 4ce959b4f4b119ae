"""SORT and OC-SORT, written from their papers: peers for measurements, not used by the program.

References:
    A. Bewley et al., "Simple Online and Realtime Tracking", ICIP 2016, arXiv:1602.00763.
    J. Cao et al., "Observation-Centric SORT: Rethinking SORT for Robust Multi-Object Tracking", CVPR 2023,
    arXiv:2203.14360, section 4: re-update over a virtual trajectory (ORU), the direction of motion in the cost (OCM),
    recovery by the last observation (OCR).

Both keep lost tracks for thirty frames, count time in frames and name a track from its third sighting on. SORT's
release forgets a track after one; that would only count gaps of the detector. Neither looks at doubtful boxes, so that
each of these is a fragment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.tracker.upright import born, box, correct, iou, measured, predict, upright
from vision.detect.detections import Detections

__all__ = ["OcSort", "Sort"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SCORE, OVERLAP, BUFFER, HITS = 0.5, 0.3, 30, 3
DIRECTION, SPAN = 0.2, 3
"""Weight λ of the direction in OC-SORT's cost, and the frames Δt over which it is taken."""


class Sort:
    """Follows upright boxes by overlap with where a filter predicts them."""

    def __init__(self) -> None:
        self._x, self._P = np.empty((0, 7)), np.empty((0, 7, 7))
        self._id, self._hits, self._lost = (np.empty(0, np.int64) for _ in range(3))
        self._next = 1

    def update(self, detections: Detections) -> IntArray:
        """Take in one frame; the track of each box (m,), -1 none."""
        index = np.flatnonzero(detections.score >= SCORE)
        edges = upright(detections)[index]
        self._x, self._P = predict(self._x, self._P)
        self._lost = self._lost + 1
        rows, columns = self._match(edges)
        self._correct(rows, edges[columns])
        self._hits[rows] += 1
        self._lost[rows] = 0
        tracks = np.full(len(detections), -1)
        sure = self._hits[rows] >= HITS
        tracks[index[columns[sure]]] = self._id[rows[sure]]
        self._keep(self._lost <= np.where(self._hits >= HITS, BUFFER, 1))
        self._begin(np.delete(edges, columns, axis=0))
        return tracks

    def _match(self, edges: FloatArray) -> tuple[IntArray, IntArray]:
        return best(iou(box(self._x), edges))

    def _correct(self, rows: IntArray, edges: FloatArray) -> None:
        self._x[rows], self._P[rows] = correct(self._x[rows], self._P[rows], measured(edges))

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        self._x, self._P, self._id = self._x[mask], self._P[mask], self._id[mask]
        self._hits, self._lost = self._hits[mask], self._lost[mask]

    def _begin(self, edges: FloatArray) -> None:
        n = len(edges)
        x, P = born(measured(edges))
        self._x, self._P = np.concatenate([self._x, x]), np.concatenate([self._P, P])
        self._id = np.concatenate([self._id, np.arange(self._next, self._next + n)])
        self._hits = np.concatenate([self._hits, np.ones(n, np.int64)])
        self._lost = np.concatenate([self._lost, np.zeros(n, np.int64)])
        self._next += n


class OcSort(Sort):
    """SORT that trusts what was seen more than what was predicted."""

    def __init__(self) -> None:
        super().__init__()
        self._past = np.empty((0, SPAN + 1, 4))
        """(k, Δt + 1, 4) edges when last seen, newest first, and at the frames before."""
        self._then = (self._x, self._P)
        """Filter after the last sighting."""

    def _match(self, edges: FloatArray) -> tuple[IntArray, IntArray]:
        overlap = iou(box(self._x), edges)
        rows, columns = best(overlap, DIRECTION * self._direction(edges))
        # what is left: overlap with the last observation itself
        i = np.setdiff1d(np.arange(len(self._x)), rows)
        j = np.setdiff1d(np.arange(len(edges)), columns)
        more_i, more_j = best(iou(self._past[i, 0], edges[j]))
        return np.concatenate([rows, i[more_i]]), np.concatenate([columns, j[more_j]])

    def _direction(self, edges: FloatArray) -> FloatArray:
        """(k, m) in [-½, ½]: how well each box lies ahead of where its track has been going."""
        past = 0.5 * (self._past[:, :, :2] + self._past[:, :, 2:])
        going = past[:, 0] - past[:, SPAN]
        ahead = 0.5 * (edges[:, :2] + edges[:, 2:]) - past[:, SPAN, None]
        length = np.hypot(*going.T)[:, None] * np.hypot(ahead[..., 0], ahead[..., 1])
        cosine = np.einsum("kc,kmc->km", going, ahead) / np.maximum(length, 1e-9)
        # (π/2 − Δθ) / π, nothing for what has not moved
        return np.where(length > 0, 0.5 - np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi, 0.0)

    def _correct(self, rows: IntArray, edges: FloatArray) -> None:
        for row, seen in zip(rows.tolist(), edges, strict=True):
            if self._lost[row] > 1:
                self._relive(row, seen)
        super()._correct(rows, edges)
        self._past[rows] = np.concatenate([edges[:, None], self._past[rows, :-1]], axis=1)
        then_x, then_P = self._then
        then_x[rows], then_P[rows] = self._x[rows], self._P[rows]

    def _relive(self, row: int, seen: FloatArray) -> None:
        """Filter the gap again along the straight line from the last observation to this one."""
        gap = int(self._lost[row])
        x, P = self._then[0][row, None], self._then[1][row, None]
        z0, z1 = measured(np.stack([self._past[row, 0], seen]))
        for k in range(1, gap):
            # ẑ = z₀ + k / gap · (z₁ − z₀)
            x, P = correct(*predict(x, P), (z0 + k / gap * (z1 - z0))[None])
        x, P = predict(x, P)
        self._x[row], self._P[row] = x[0], P[0]

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        super()._keep(mask)
        self._past, self._then = self._past[mask], (self._then[0][mask], self._then[1][mask])

    def _begin(self, edges: FloatArray) -> None:
        n = len(self._x)
        super()._begin(edges)
        self._past = np.concatenate([self._past, np.repeat(edges[:, None], SPAN + 1, axis=1)])
        x, P = self._then
        self._then = np.concatenate([x, self._x[n:]]), np.concatenate([P, self._P[n:]])


def best(overlap: FloatArray, bonus: FloatArray | float = 0.0) -> tuple[IntArray, IntArray]:
    """Rows and columns of the best assignment whose overlap is enough."""
    i, j = linear_sum_assignment(overlap + bonus, maximize=True)
    enough = overlap[i, j] >= OVERLAP
    return i[enough].astype(np.int64), j[enough].astype(np.int64)
