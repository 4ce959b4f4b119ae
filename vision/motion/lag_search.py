"""Lag of telemetry's attitude behind the film, found where it is far from what is assumed, before anything has a name.

A camera that sways or turns moves all boxes together. Under the attitude of the right moment their places on the ground
are those of vehicles, which drive evenly; under that of another moment the sway is left in all of them. For a lag δ

    c(δ) = median over the tracks of mean |g(t; R(t + δ)) − quadratic in t|²

over the last seconds. Its least value is taken where it is clearly less than at the lag in use and at every one that is
not beside it, twice in a row.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from vision.motion.fused_evidence import SeenTracks

FloatArray = NDArray[np.float64]
LAGS_S = np.arange(-5.0, 1.01, 0.1)
"""Lags that are tried: a film is late by seconds where a server buffers it, telemetry by its radio."""
WINDOW_S = 4.0
"""Part of the film that is compared; a vehicle's way over it is a quadratic."""
LEAST_WINDOW = 0.75
"""Share of the window that is enough for the first search."""
HISTORY_S = 0.5 - LAGS_S[0]
"""Time before the first frame from which on telemetry is of use."""
APART_S = 0.08
"""Frames nearer to the last one add little."""
LEAST_LOOKS, LEAST_TRACKS = 15, 2
"""Frames in which a track needs a box to be compared, and least number of such tracks."""
OFTEN_S, SELDOM = 1.0, 0.2
"""Time between two searches, and that share of the time since the first: what did not show early seldom does."""
CLEARER, ALONE = 3.0, 1.4
"""Ratio by which c has to be larger at the lag in use, and at the best one more than ``BESIDE_S`` away."""
BESIDE_S, FAR_S, SAME_S = 0.35, 0.12, 0.15
"""A lag nearer to the one in use is the filter's to find; two searches that agree."""
LEVEL = 0.05
"""Sine of the least angle below the horizon at which a box tells a place."""


@dataclass(frozen=True, slots=True)
class _Looked:
    t_us: int
    p_enu: FloatArray
    ground_z: float
    seen: SeenTracks


@dataclass(frozen=True, slots=True)
class _Followed:
    """A track over the window."""

    t_us: FloatArray
    """(n,)."""
    ray: FloatArray
    """(n, 3), camera frame."""
    p_enu: FloatArray
    """(n, 3) the camera."""
    ground_z: FloatArray
    """(n,)."""


class LagSearch:
    """Search of the lag, fed with one frame after the other."""

    def __init__(self) -> None:
        self._frames: deque[_Looked] = deque()
        self._sample_us: deque[int] = deque()
        self._samples: deque[FloatArray] = deque()
        self._first_us = self._next_us = 0
        self._before_s = np.nan

    def forget(self) -> None:
        """Begin anew: places are given in another frame from now on, or the attitude was away."""
        self._frames.clear()
        self._sample_us.clear()
        self._samples.clear()
        self._before_s = np.nan

    def add_samples(self, sample_us: Sequence[int], R_enu_cam: Sequence[FloatArray]) -> None:
        """Add the camera's rotations (3, 3) by telemetry, at their own times, Unix µs."""
        for t_us, R in zip(sample_us, R_enu_cam, strict=True):
            if not self._sample_us or t_us > self._sample_us[-1]:
                self._sample_us.append(t_us)
                self._samples.append(R)

    def add_frame(self, t_us: int, p_enu: FloatArray, ground_z: float, seen: SeenTracks) -> None:
        """Add a frame: the camera's place (3,), the height of the ground, m, and its boxes."""
        self._first_us = self._first_us or t_us
        if not self._frames or t_us - self._frames[-1].t_us >= APART_S * 1e6:
            self._frames.append(_Looked(t_us, p_enu, ground_z, seen))
        while t_us - self._frames[0].t_us > (WINDOW_S + LAGS_S[-1]) * 1e6:
            self._frames.popleft()
        while self._sample_us and self._sample_us[0] < self._frames[0].t_us - HISTORY_S * 1e6:
            self._sample_us.popleft()
            self._samples.popleft()

    def found(self, t_us: int, lag_s: float) -> float | None:
        """The lag, if it is time to search for it and it is found to be another than the one in use, seconds.

        Args:
            t_us: The last frame's time, Unix µs.
            lag_s: The lag in use, positive where telemetry's attitude is of a later time than the film's.
        """
        if t_us < self._next_us:
            return None
        self._next_us = t_us + max(round(OFTEN_S * 1e6), round(SELDOM * (t_us - self._first_us)))
        best = self._best(lag_s)
        before, self._before_s = self._before_s, np.nan if best is None else best
        return best if best is not None and abs(best - before) < SAME_S else None

    def _best(self, lag_s: float) -> float | None:
        """The lag of the least residual, if it is clearly better than ``lag_s``."""
        tracks = self._tracks()
        if len(tracks) < LEAST_TRACKS:
            return None
        begin_us, end_us = self._frames[0].t_us, max(track.t_us[-1] for track in tracks)
        least, most = (self._sample_us[0] - begin_us) * 1e-6, (self._sample_us[-1] - end_us) * 1e-6
        lags = LAGS_S[(least <= LAGS_S) & (most >= LAGS_S)]
        if len(lags) < 3 or not lags[0] <= lag_s <= lags[-1]:
            return None
        path = Slerp(np.array(self._sample_us, dtype=float), Rotation.from_matrix(np.array(self._samples)))
        cost = _residuals(path, tracks, lags)
        k = int(np.argmin(cost))
        beside = np.abs(lags - lags[k]) > BESIDE_S
        if k in (0, len(lags) - 1) or cost[beside].min(initial=np.inf) < ALONE * cost[k]:
            return None
        # the vertex of the parabola through three values at even distances
        a, b, c = cost[k - 1 : k + 2]
        found_s = float(lags[k] + 0.5 * (lags[1] - lags[0]) * (a - c) / (a - 2.0 * b + c))
        if abs(found_s - lag_s) < FAR_S or np.interp(lag_s, lags, cost) < CLEARER * cost[k]:
            return None
        return found_s

    def _tracks(self) -> list[_Followed]:
        """Tracks that were seen for long enough."""
        if len(self._sample_us) < 3:
            return []
        last_us = self._frames[-1].t_us - LAGS_S[-1] * 1e6
        frames = [frame for frame in self._frames if frame.t_us <= last_us]
        if not frames or last_us - frames[0].t_us < LEAST_WINDOW * WINDOW_S * 1e6:
            return []
        seen: dict[int, list[tuple[float, FloatArray, FloatArray, float]]] = {}
        for frame in frames:
            for track, ray in zip(frame.seen.track_id.tolist(), frame.seen.ray, strict=True):
                seen.setdefault(track, []).append((frame.t_us, ray, frame.p_enu, frame.ground_z))
        lasting = (rows for rows in seen.values() if len(rows) >= LEAST_LOOKS)
        return [
            _Followed(*(np.array(column) for column in zip(*rows, strict=True)))
            for rows in lasting
            if rows[-1][0] - rows[0][0] > 0.5 * WINDOW_S * 1e6
        ]


def _residuals(path: Slerp, tracks: Sequence[_Followed], lags: FloatArray) -> FloatArray:
    """(k,) c(δ) for lags (k,), m²."""
    each = []
    for track in tracks:
        R = path((track.t_us + 1e6 * lags[:, None]).ravel())
        d = R.apply(np.tile(track.ray, (len(lags), 1))).reshape(len(lags), -1, 3)
        down = np.maximum(-d[..., 2], LEVEL * np.linalg.norm(d, axis=-1))
        height = track.p_enu[:, 2] - track.ground_z
        g = track.p_enu[:, :2] + (height / down)[..., None] * d[..., :2]
        A = np.vander((track.t_us - track.t_us.mean()) * 1e-6 / WINDOW_S, 3)
        off = g - (A @ np.linalg.pinv(A)) @ g
        each.append(np.square(off).sum(axis=-1).mean(axis=-1))
    return np.asarray(np.median(each, axis=0))
