"""Lag of telemetry's attitude behind the film, found where it is far from what is assumed, whoever is named.

A camera that sways or turns moves all boxes together. Under the attitude of the right moment their places on the ground
are those of vehicles, which drive evenly; under that of another moment the sway is left in all of them. For a lag δ

    c(δ) = median over the tracks of mean |g(t; R(t + δ)) − quadratic in t|²

over the last seconds. Its least value is taken where it is clearly less than at the lag in use and at every one that is
not beside it, in two searches in a row.
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
IntArray = NDArray[np.int64]
LAGS_S = np.arange(-5.0, 1.01, 0.1)
"""Lags that are tried: a film is late by seconds where a server buffers it, telemetry by its radio."""
WINDOW_S = 4.0
"""Part of the film that is compared; a vehicle's way over it is a quadratic."""
MIN_WINDOW = 0.75
"""Share of the window that is enough for the first search."""
HISTORY_S = 0.5 - LAGS_S[0]
"""Time before the first frame from which on telemetry is of use."""
APART_S = 0.08
"""Frames nearer to the last one add little."""
MIN_LOOKS, MIN_TRACKS, MIN_SAMPLES = 15, 2, 3
"""Frames in which a track needs a box to be compared, and least numbers of such tracks and of samples of attitude."""
MAX_TRACKS = 12
"""Tracks that are compared, the longest ones: more hardly tell more."""
OFTEN_S, SELDOM, LONGEST_S = 2.0, 0.2, 10.0
"""Time between two searches: at least, as a share of that since the film began, since what did not show early seldom
does, and at most."""
PAUSE_S = 2.0
"""Longest pause between two frames; after a longer one the search starts again: a connection may have another delay."""
CLEARER, ALONE = 3.0, 1.4
"""Ratio by which c has to be larger at the lag in use, and at the best one more than ``BESIDE_S`` away."""
BESIDE_S, FAR_S, SAME_S = 0.35, 0.12, 0.15
"""Distances of lags, s: within the first two belong to one minimum; nearer than the second the filter finds it; within
the third two searches agree."""
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

    frame: IntArray
    """(n,) in which of the frames it was seen."""
    ray: FloatArray
    """(n, 3), camera frame."""


class LagSearch:
    """Search of the lag, fed with one frame after the other."""

    def __init__(self) -> None:
        self._frames: deque[_Looked] = deque()
        self._samples: deque[tuple[int, FloatArray]] = deque()
        self._begin()

    def _begin(self) -> None:
        self._frames.clear()
        self._first_us = self._next_us = 0
        self._before_s = np.nan

    def forget(self) -> None:
        """Begin again: places are given in another frame from now on, or the attitude was away."""
        self._begin()
        self._samples.clear()

    def samples_wanted(self, t_us: int) -> tuple[int, int]:
        """The Unix times, µs, after which and until which samples of the attitude are wanted at a frame."""
        since_us = self._samples[-1][0] if self._samples else t_us - round(HISTORY_S * 1e6)
        return since_us, t_us + round(LAGS_S[-1] * 1e6)

    def add_sample(self, t_us: int, R_enu_cam: FloatArray) -> None:
        """Add the camera's rotation (3, 3) by telemetry, at its own Unix time, µs."""
        if not self._samples or t_us > self._samples[-1][0]:
            self._samples.append((t_us, R_enu_cam))

    def add_frame(self, t_us: int, p_enu: FloatArray, ground_z: float, seen: SeenTracks) -> None:
        """Add a frame: the camera's place (3,), the height of the ground, m, and its boxes."""
        if self._frames and not 0 <= t_us - self._frames[-1].t_us <= PAUSE_S * 1e6:
            self._begin()
        if not self._frames:
            self._first_us, self._next_us = t_us, t_us + round((MIN_WINDOW * WINDOW_S + LAGS_S[-1]) * 1e6)
        if not self._frames or t_us - self._frames[-1].t_us >= APART_S * 1e6:
            self._frames.append(_Looked(t_us, p_enu, ground_z, seen))
        while t_us - self._frames[0].t_us > (WINDOW_S + LAGS_S[-1]) * 1e6:
            self._frames.popleft()
        while self._samples and self._samples[0][0] < self._frames[0].t_us - HISTORY_S * 1e6:
            self._samples.popleft()

    def found(self, t_us: int, lag_s: float) -> float | None:
        """The lag, if it is time to search for it and it is found to be another than the one in use, seconds.

        Args:
            t_us: The last frame's time, Unix µs.
            lag_s: The lag in use, positive where telemetry's attitude is of a later time than the film's.
        """
        if t_us < self._next_us:
            return None
        wait_s = min(max(OFTEN_S, SELDOM * 1e-6 * (t_us - self._first_us)), LONGEST_S)
        self._next_us = t_us + round(wait_s * 1e6)
        best = self._best(lag_s)
        before, self._before_s = self._before_s, np.nan if best is None else best
        return best if best is not None and abs(best - before) < SAME_S else None

    def _best(self, lag_s: float) -> float | None:
        """The lag of the least residual, if it is clearly better than ``lag_s``."""
        # at later frames telemetry is not there yet for every lag
        frames = [frame for frame in self._frames if frame.t_us <= self._frames[-1].t_us - LAGS_S[-1] * 1e6]
        tracks = _followed(frames)
        if len(tracks) < MIN_TRACKS or len(self._samples) < MIN_SAMPLES:
            return None
        since_us, until_us = self._samples[0][0], self._samples[-1][0]
        known = (since_us - frames[0].t_us <= 1e6 * LAGS_S) & (until_us - frames[-1].t_us >= 1e6 * LAGS_S)
        lags = LAGS_S[known]
        if not len(lags) or not lags[0] <= lag_s <= lags[-1]:
            return None
        sample_us, R = zip(*self._samples, strict=True)
        cost = _residuals(Slerp(np.array(sample_us, float), Rotation.from_matrix(np.array(R))), frames, tracks, lags)
        k = int(np.argmin(cost))
        away = cost[np.abs(lags - lags[k]) > BESIDE_S]
        if k in (0, len(lags) - 1) or not len(away) or away.min() < ALONE * cost[k]:
            return None
        # the vertex of the parabola through three values at even distances
        a, b, c = cost[k - 1 : k + 2]
        found_s = float(lags[k] + 0.5 * (lags[1] - lags[0]) * (a - c) / (a - 2.0 * b + c))
        if abs(found_s - lag_s) < FAR_S or np.interp(lag_s, lags, cost) < CLEARER * cost[k]:
            return None
        return found_s


def _followed(frames: Sequence[_Looked]) -> list[_Followed]:
    """The tracks that were seen in most frames."""
    seen: dict[int, list[tuple[int, FloatArray]]] = {}
    for k, frame in enumerate(frames):
        for track, ray in zip(frame.seen.track_id.tolist(), frame.seen.ray, strict=True):
            seen.setdefault(track, []).append((k, ray))
    lasting = [
        rows
        for rows in seen.values()
        if len(rows) >= MIN_LOOKS and frames[rows[-1][0]].t_us - frames[rows[0][0]].t_us > 0.5 * WINDOW_S * 1e6
    ]
    longest = sorted(lasting, key=len, reverse=True)[:MAX_TRACKS]
    return [_Followed(np.array([k for k, _ in rows]), np.array([ray for _, ray in rows])) for rows in longest]


def _residuals(path: Slerp, frames: Sequence[_Looked], tracks: Sequence[_Followed], lags: FloatArray) -> FloatArray:
    """(k,) c(δ) for lags (k,), m²."""
    t_us = np.array([frame.t_us for frame in frames], float)
    R = path((t_us + 1e6 * lags[:, None]).ravel()).as_matrix().reshape(len(lags), len(frames), 3, 3)
    p_enu = np.array([frame.p_enu for frame in frames])
    height = p_enu[:, 2] - np.array([frame.ground_z for frame in frames])
    each = []
    for track in tracks:
        d = np.einsum("kfij,fj->kfi", R[:, track.frame], track.ray)
        down = np.maximum(-d[..., 2], LEVEL * np.linalg.norm(d, axis=-1))
        g = p_enu[track.frame, :2] + (height[track.frame] / down)[..., None] * d[..., :2]
        at = t_us[track.frame]
        A = np.vander((at - at.mean()) * 1e-6 / WINDOW_S, 3)
        off = g - (A @ np.linalg.pinv(A)) @ g
        each.append(np.square(off).sum(axis=-1).mean(axis=-1))
    return np.asarray(np.median(each, axis=0))
