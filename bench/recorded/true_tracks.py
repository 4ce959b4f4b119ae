"""A bound: the product with tracks that never break and never mix two targets, as the truth has them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gcs.session.frame_tables import read_times, read_truth
from gcs.session.tables import Table
from vision.detect.detections import Detections
from vision.track.tracks import TrackerParams, Tracks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OTHERS_FROM = 1000
"""Track ids of what is none of ours begin here; below, they are system ids."""
FORGOTTEN_S = 1.0
"""What is none of ours and was unseen for so long is another one when it comes back."""
SETTLING_S = 0.5
"""Time constant of the speed's smoothing."""


@contextmanager
def tracked_by_truth(session: Path, *, asked: bool = True) -> Iterator[None]:
    """Within it pipelines track the boxes of this session by its truth, if asked."""
    if not asked:
        yield
        return
    times_us, truth = read_times(session / "frames.csv").times_us, read_truth(session / "truth.csv")
    with patch("gcs.fold.pipeline.Tracker", partial(TrueTracker, times_us, truth)):
        yield


class TrueTracker:
    """Stands in for :class:`vision.track.tracker.Tracker`; boxes of our vehicles are the track of their system id.

    Boxes over something else continue the nearest such track within their own size, or begin one.

    Args:
        times_us: (n,) time of each frame.
        truth: the true boxes.
        params: as the tracker has them; not used.
    """

    def __init__(self, times_us: IntArray, truth: Table, params: TrackerParams | None = None) -> None:
        self._times_us = times_us
        order = np.argsort(truth["frame"], kind="stable")
        self._frame = truth["frame"][order]
        self._centre = np.stack([truth["cx"], truth["cy"]], axis=-1)[order]
        self._system_id = truth["system_id"][order].astype(np.int64)
        self._seen: dict[int, _Seen] = {}
        self._next_other = OTHERS_FROM

    @property
    def living(self) -> frozenset[int]:
        """Ids of all tracks: a true one may be seen again."""
        return frozenset(self._seen)

    def update(self, detections: Detections, t_us: int, *, warp: FloatArray | None = None, **_: object) -> Tracks:
        """The tracks of one frame: those that are seen in it."""
        centre = np.stack([detections.cx, detections.cy], axis=-1)
        ids = self._ids(centre, np.hypot(detections.w, detections.h), t_us, warp)
        order = np.argsort(ids, kind="stable")
        before = [self._seen.get(int(ids[k])) for k in order]
        now = [_follow(seen, centre[k], t_us, warp) for seen, k in zip(before, order, strict=True)]
        self._seen |= {int(ids[k]): seen for k, seen in zip(order, now, strict=True)}
        d, v = detections, np.array([seen.velocity for seen in now]).reshape(-1, 2)
        return Tracks(
            track_id=ids[order],
            detection=order.astype(np.intp),
            **{name: np.array(getattr(d, name)[order]) for name in ("cx", "cy", "w", "h", "angle", "heading", "score")},
            hits=np.array([seen.hits for seen in now], np.int64),
            age_s=np.array([(t_us - seen.since_us) * 1e-6 for seen in now]),
            gap_s=np.zeros(len(now)),
            vx=v[:, 0].copy(),
            vy=v[:, 1].copy(),
            expected=np.array([seen.expected for seen in now]).reshape(-1, 2),
        )

    def _ids(self, centre: FloatArray, size: FloatArray, t_us: int, warp: FloatArray | None) -> IntArray:
        """(m,) track of each box."""
        frame = int(np.argmin(np.abs(self._times_us - t_us)))
        rows = slice(*np.searchsorted(self._frame, (frame, frame + 1)))
        ids = np.zeros(len(centre), np.int64)
        away = np.linalg.norm(centre[:, None] - self._centre[None, rows], axis=-1)
        boxes, true = linear_sum_assignment(away)
        near = away[boxes, true] < 0.5 * size[boxes]
        ids[boxes[near]] = self._system_id[rows][true[near]]
        others = {
            i: _warped(seen.centre, warp)
            for i, seen in self._seen.items()
            if i >= OTHERS_FROM and t_us - seen.t_us < FORGOTTEN_S * 1e6
        }
        for box in np.flatnonzero(ids == 0):
            gaps = {i: float(np.linalg.norm(centre[box] - place)) for i, place in others.items()}
            nearest = min(gaps, key=gaps.__getitem__, default=None)
            if nearest is not None and gaps[nearest] < size[box]:
                ids[box] = nearest
                del others[nearest]
            else:
                ids[box] = self._next_other
                self._next_other += 1
        return ids


class _Seen:
    """A track when it was seen last."""

    def __init__(self, centre: FloatArray, t_us: int) -> None:
        self.centre, self.t_us, self.since_us, self.hits = centre, t_us, t_us, 1
        self.velocity, self.expected = np.zeros(2), np.full(2, np.nan)


def _follow(seen: _Seen | None, centre: FloatArray, t_us: int, warp: FloatArray | None) -> _Seen:
    if seen is None:
        return _Seen(centre, t_us)
    dt = max((t_us - seen.t_us) * 1e-6, 1e-3)
    still = _warped(seen.centre, warp)
    now = _Seen(centre, t_us)
    now.since_us, now.hits, now.expected = seen.since_us, seen.hits + 1, still + seen.velocity * dt
    # v ← v + (1 − e^(−Δt/τ)) (Δx/Δt − v)
    now.velocity = seen.velocity + (1.0 - np.exp(-dt / SETTLING_S)) * ((centre - still) / dt - seen.velocity)
    return now


def _warped(place: FloatArray, warp: FloatArray | None) -> FloatArray:
    if warp is None or not np.isfinite(warp).all():
        return place
    x, y, w = np.asarray(warp) @ (place[0], place[1], 1.0)
    return np.array([x / w, y / w])
