"""Rough and fast fit of a fleet to a film at every offset of its clock: which offsets are worth a closer look.

On a grid of offsets δ_k = k h the fleet's places are one array, sampled every h, and seen through a window that slides.
With a = g − c the arm from the camera's foot to a track on the ground, complex, and q = p(t + δ) − c that to a vehicle,
a camera whose heading is off by ψ clockwise gives

    Σ|e^(−iψ) a − q − d|² = S_aa + S_qq − 2 Re(e^(−iψ) S_aq),    d = e^(−iψ) ā − q̄,

with S the sums about the means, so that every heading follows from one set of sums. A pair counts

    L = ln(A / 2πσ_p²) − |d|²/2σ_p² + m [ln(S₀ + σ_c²) − ln(S/n + σ_c²)],

S₀ the mean of both spreads and m = duration/τ: by place, and by a course that would not be alike by chance. What stands
still shows no course. Each track counts with its best vehicle, so that the sum is not below that of any assignment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from assoc.clock_search.inputs import CameraPath, FleetLog
from assoc.history import TrackHistory

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

GRID_S = 0.5
"""h, seconds: in half of it a vehicle moves by about its position's error."""
_STRIDE = 2
"""Grid points between two places of a track."""
_LONGEST_STRIDE = 8
_MAX_PLACES = 240
"""Most moments at which a film is looked at; longer films are looked at more seldom."""
_REPORT_GAP_S, _TRACK_GAP_S = 3.0, 0.8
"""Longest hole in a vehicle's reports, and in a track, that is bridged, seconds."""
_MIN_PLACES = 4
"""A track that is seen for a shorter time is left out."""
_PLACE_STD_M, _PLACE_STD_SHARE = 3.0, 0.06
"""σ_p: metres, and share of the arm: errors of tilt, height and heading grow with it."""
_COURSE_STD_M, _COURSE_TAU_S = 1.0, 3.0
"""σ_c and τ."""
_HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 6.0))
_HEADINGS_KNOWN = np.deg2rad(np.array([-12.0, -6.0, 0.0, 6.0, 12.0]))
"""ψ where the heading is unknown, and where it is known."""
_CHUNK = 256
"""Offsets that are worked on at once."""
_MAX_OFFSETS = 500_000
"""Offsets that are compared: of three days of reports; of more the longest stretches."""
_APART = 2
"""Grid points by which two starts differ at least, else they lead to the same offset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarseStart:
    """An offset that is worth a closer look."""

    offset_s: float
    """δ, seconds."""
    yaw: float
    """ψ, radians clockwise."""
    score: float
    """Σ L, nats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sampled:
    """A film at B even times."""

    t: FloatArray
    """(B,) seconds."""
    ray: FloatArray
    """(B, T, 3), 0 unseen."""
    seen: BoolArray
    """(B, T)."""
    stride: int
    """Grid points between two times."""


def _sampled(tracks: TrackHistory) -> _Sampled:
    """The film's rays on a regular grid of times, of tracks that are seen for long enough."""
    times, rays = tracks.t[: tracks.n], tracks.ray[: tracks.n]
    length_s = times[-1] - times[0]
    stride = int(np.clip(np.ceil(length_s / (_MAX_PLACES * GRID_S)), _STRIDE, _LONGEST_STRIDE))
    t = np.asarray(times[0] + np.arange(int(length_s / (stride * GRID_S)) + 1) * stride * GRID_S, np.float64)
    columns, found = [], []
    for column in range(rays.shape[1]):
        rows = np.flatnonzero(np.isfinite(rays[:, column, 0]))
        if len(rows) < 2:
            continue
        ray, near = _interpolated(times[rows], rays[rows, column], t, _TRACK_GAP_S)
        if np.count_nonzero(near) >= _MIN_PLACES:
            columns.append(ray)
            found.append(near)
    if not columns:
        return _Sampled(t=t, ray=np.zeros((len(t), 0, 3)), seen=np.zeros((len(t), 0), np.bool_), stride=stride)
    return _Sampled(t=t, ray=np.stack(columns, axis=1), seen=np.stack(found, axis=1), stride=stride)


def _interpolated(t: FloatArray, x: FloatArray, at: FloatArray, gap_s: float) -> tuple[FloatArray, BoolArray]:
    """Values (k, c) of samples (S, c) at times (k,), 0 beyond the ends and in holes; and where there are any (k,)."""
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    span = t[after] - t[after - 1]
    inside = (at >= t[0]) & (at <= t[-1]) & (span <= gap_s)
    w = np.where(inside, (at - t[after - 1]) / np.where(span > 0.0, span, 1.0), 0.0)[:, None]
    return np.where(inside[:, None], x[after - 1] * (1.0 - w) + x[after] * w, 0.0), inside


def _ways(log: FleetLog) -> list[tuple[FloatArray, FloatArray]]:
    """Times (k,) and places (k, 2) of each vehicle's reports, in order of time."""
    found = []
    for vehicle in range(log.n):
        rows = np.flatnonzero(log.vehicle == vehicle)
        rows = rows[np.argsort(log.t[rows], kind="stable")]
        found.append((log.t[rows], log.p_enu[rows]))
    return found


def _fleet_grid(
    ways: Sequence[tuple[FloatArray, FloatArray]], start: float, count: int
) -> tuple[ComplexArray, BoolArray]:
    """(count, n) places on the grid, east + i north, and where they are known."""
    at = np.asarray(start + np.arange(count) * GRID_S, np.float64)
    place, known = np.zeros((count, len(ways)), np.complex128), np.zeros((count, len(ways)), np.bool_)
    for vehicle, (t, p) in enumerate(ways):
        if len(t) > 1:
            east_north, known[:, vehicle] = _interpolated(t, p, at, _REPORT_GAP_S)
            place[:, vehicle] = east_north[:, 0] + 1j * east_north[:, 1]
    return place, known


def _stretches(log: FleetLog, film_s: tuple[float, float], bounds_s: tuple[float, float]) -> list[tuple[int, int]]:
    """First and last number of offsets at which film and log overlap, one stretch after the other.

    Only there can anything be judged; times of years, as a clock that was never set has them, cost nothing in between.
    """
    t = np.sort(log.t)
    apart = np.flatnonzero(np.diff(t) > film_s[1] - film_s[0] + _REPORT_GAP_S)
    begins, ends = t[np.concatenate([[0], apart + 1])], t[np.concatenate([apart, [len(t) - 1]])]
    first = np.ceil(np.maximum(begins - film_s[1], bounds_s[0]) / GRID_S)
    last = np.floor(np.minimum(ends - film_s[0], bounds_s[1]) / GRID_S)
    kept, left = [], _MAX_OFFSETS
    for k in np.argsort(first - last, kind="stable").tolist():
        size = min(int(last[k] - first[k]) + 1, left)
        if size > 0:
            kept.append((int(first[k]), int(first[k]) + size - 1))
            left -= size
    return kept


def _arms(ray: FloatArray, R: FloatArray, p: FloatArray, ground_z: float) -> tuple[ComplexArray, BoolArray]:
    """a of rays (B, T, 3) from cameras (B, 3, 3) at (B, 3), and where they meet the ground."""
    d = ray @ R.transpose(0, 2, 1)
    norm = np.linalg.norm(d, axis=2)
    falls = d[..., 2] < -0.05 * norm
    scale = np.where(falls & (norm > 0.0), (ground_z - p[:, 2])[:, None] / np.where(falls, d[..., 2], -1.0), 0.0)
    return (d[..., 0] + 1j * d[..., 1]) * scale, falls


def coarse_starts(
    tracks: TrackHistory,
    path: CameraPath,
    log: FleetLog,
    bounds_s: tuple[float, float],
    *,
    camera_too: bool,
    most: int,
) -> list[CoarseStart]:
    """The offsets at which the fleet may fit the film, best first.

    Args:
        tracks: The film.
        path: The camera's.
        log: The fleet's.
        bounds_s: Least and largest δ, seconds.
        camera_too: The camera's path is on the fleet's clock; else on the film's.
        most: How many are wanted.
    """
    film = _sampled(tracks)
    if not film.seen.shape[1] or not len(log.t):
        return []
    R, p = path.at(film.t)
    arms = (*_arms(film.ray, R, p, path.ground_z), p)
    headings = _HEADINGS_KNOWN if path.heading_known else _HEADINGS
    span, ways = (len(film.t) - 1) * film.stride + 1, _ways(log)
    found: list[CoarseStart] = []
    for first, last in _stretches(log, (film.t[0], film.t[-1]), bounds_s):
        score, yaw = np.zeros(last - first + 1), np.zeros(last - first + 1)
        for k in range(0, len(score), _CHUNK):
            size = min(_CHUNK, len(score) - k)
            place, known = _fleet_grid(ways, film.t[0] + (first + k) * GRID_S, size + span - 1)
            if not known.any():
                continue
            q = sliding_window_view(place, span, axis=0)[..., :: film.stride].transpose(0, 2, 1)
            has = sliding_window_view(known, span, axis=0)[..., :: film.stride].transpose(0, 2, 1)
            if camera_too:
                offsets_s = np.asarray((first + k + np.arange(size)) * GRID_S, np.float64)
                arms = _moved_arms(film, path, offsets_s)
            arm, falls, p = arms
            foot = p[..., 0] + 1j * p[..., 1]
            q = q - foot[..., None]
            score[k : k + size], best = pair_scores(arm, film.seen & falls, q, has, headings, film.stride * GRID_S)
            yaw[k : k + size] = headings[best]
        found += [
            CoarseStart(offset_s=(first + k) * GRID_S, yaw=float(yaw[k]), score=float(score[k]))
            for k in _peaks(score, most).tolist()
        ]
    return sorted(found, key=lambda start: -start.score)[:most]


def _moved_arms(film: _Sampled, path: CameraPath, offsets_s: FloatArray) -> tuple[ComplexArray, BoolArray, FloatArray]:
    """a (D, B, T), where it meets the ground, and camera positions (D, B, 3) of a path under offsets (D,)."""
    shape = (len(offsets_s), *film.seen.shape)
    R, p = path.at((film.t[None] + offsets_s[:, None]).ravel())
    rays = np.broadcast_to(film.ray, (len(offsets_s), *film.ray.shape)).reshape(-1, *film.ray.shape[1:])
    arm, falls = _arms(rays, R, p, path.ground_z)
    return arm.reshape(shape), falls.reshape(shape), p.reshape(*shape[:2], 3)


def pair_scores(
    arm: ComplexArray,
    seen: BoolArray,
    q: ComplexArray,
    has: BoolArray,
    headings: FloatArray,
    step_s: float,
    *,
    each_apart: bool = False,
) -> tuple[FloatArray, IntArray]:
    """Σ L of D offsets or cameras at the best heading each, nats.

    Args:
        arm: (D, B, T) or (B, T) a, east + i north, metres.
        seen: The same shape, where it is known.
        q: (D, B, V) likewise of the vehicles.
        has: (D, B, V) where it is known.
        headings: (K,) ψ to compare, radians.
        step_s: From one time to the next, seconds.
        each_apart: Each of D has a ground in view of its own.

    Returns:
        (D,) the scores, and (D,) which heading each is of.
    """
    s, h = seen.astype(np.float64), has.astype(np.float64)
    a, q = arm * s, q * h
    at, st = np.swapaxes(a, -1, -2), np.swapaxes(s, -1, -2)
    n = np.maximum(st @ h, 1e-9)
    a_sum, q_sum = at @ h, st @ q
    saa = (np.abs(at) ** 2) @ h - np.abs(a_sum) ** 2 / n
    sqq = st @ np.abs(q) ** 2 - np.abs(q_sum) ** 2 / n
    saq = at @ np.conj(q) - a_sum * np.conj(q_sum) / n
    a_mean, q_mean = a_sum / n, q_sum / n
    variance = _PLACE_STD_M**2 + (_PLACE_STD_SHARE * np.abs(a_mean)) ** 2
    # the ground in view: a disc as wide as the farthest track
    reach = np.max(np.abs(a), axis=(-2, -1), keepdims=True) if each_apart else np.max(np.abs(a))
    area = np.pi * np.maximum(reach, 10.0) ** 2
    base = np.log(area / (2.0 * np.pi * variance)) - np.log(q.shape[-1])
    weight = n * step_s / _COURSE_TAU_S
    spread = np.log((saa + sqq) / (2.0 * n) + _COURSE_STD_M**2)
    enough = n >= _MIN_PLACES
    best, which = np.full(len(q), -np.inf), np.zeros(len(q), np.int64)
    for k, heading in enumerate(headings):
        turn = np.exp(-1j * heading)
        rest = np.maximum(saa + sqq - 2.0 * (turn * saq).real, 0.0)
        course = weight * (spread - np.log(rest / n + _COURSE_STD_M**2))
        pair = base - np.abs(turn * a_mean - q_mean) ** 2 / (2.0 * variance) + course
        total = np.sum(np.max(np.where(enough, pair, 0.0), axis=2, initial=0.0), axis=1)
        which = np.where(total > best, k, which)
        best = np.maximum(best, total)
    return best, which


def _peaks(score: FloatArray, most: int) -> IntArray:
    """Rows of the largest local maxima, best first."""
    chosen: list[int] = []
    free = score > 0.0
    for k in np.argsort(-score, kind="stable"):
        if free[k]:
            chosen.append(int(k))
            free[max(k - _APART, 0) : k + _APART + 1] = False
            if len(chosen) == most:
                break
    return np.array(chosen, np.int64)
