"""Search for the camera and the assignment of tracks to vehicles that explain a film best, with no rival as good.

A grid of focal lengths and pitches is laid out, each with every heading at once, as the search for a clock does
(:mod:`assoc.clock_search.coarse`). From the best of them the camera is fitted together with the assignment:

    x = (ln φ, pitch, roll, yaw, E, N, H, ψ̇),     V = Σ L_ij − ½ Σ (x/σ)²

E, N and H are what UAV and fleet are off by in common, ψ̇ is how a UAV turns whose heading is not known. A pair counts
by its place and by its course, as there. What has been found is sure if no explanation with *another assignment* comes
near: cameras that name alike may differ a little.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from assoc.camera_search.inputs import FilmedFleet, MountKind
from assoc.clock_search.coarse import pair_scores
from assoc.clock_search.fine import assignment

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_FOCALS = np.linspace(np.log(0.24), np.log(2.5), 17)
"""ln φ: 23° to 129° across."""
_PITCHES = np.deg2rad(np.arange(-90.0, -17.0, 6.0))
_HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 6.0))
_STARTS, _POLISHED = 12, 4
"""Cameras of the grid that are fitted roughly, and assignments from these that are fitted to the end."""
_ROUGH, _POLISH = (2, 4), (4, 15)
"""Assignments of a fit, and most steps between two of them."""
_SAME_WAY = float(np.cos(np.deg2rad(15.0)))
_MIN_TIMES = 4
_PLACE_STD_M, _PLACE_STD_SHARE = 2.5, 0.02
"""σ_p of a pair: metres, and share of the distance from below the camera."""
_COURSE_STD_M, _COURSE_TAU_S = 0.7, 2.0
"""σ_c and τ, metres and seconds, of how a pair's difference wanders."""
_PRIOR_STD = np.array([np.inf, np.inf, np.deg2rad(2.0), np.inf, 2.0, 2.0, 0.03, 0.03])
"""1σ of x about its start: radians, metres, share of the height, rad/s; focal length, pitch and yaw are free."""
_STEP = np.array([0.05, 0.03, 0.02, 0.05, 1.0, 1.0, 0.02, 0.02])
_STILL = 1e-6
"""Bound of what is not to be fitted."""
_MIN_EVIDENCE, _MARGIN = 25.0, 12.0
"""Nats that an explanation needs, and by which it must surpass every other assignment's."""
_MIN_MOVED_M = 4.0
"""Course of a vehicle, metres, from which on it tells something about the camera."""
_MIN_EXPLAINED = 0.6
"""Share of the time of all tracks, or of all vehicles where that is less, that has to be explained."""
_R_GIMBAL_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class CameraVerdict(Enum):
    """Result of a search for a camera."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    """Another assignment explains the film nearly as well."""
    UNEXPLAINED = "unexplained"
    """No camera makes the fleet fit the film."""
    STANDING = "standing"
    """Nothing that was seen for long enough moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFit:
    """One explanation of a film."""

    focal: float
    """φ, widths of the picture."""
    focal_std: float
    """1σ of ln φ."""
    kind: MountKind
    pitch: float
    """Radians, negative down."""
    pitch_std: float
    """1σ, radians."""
    roll: float
    yaw: float
    """Radians clockwise from the nose."""
    vehicle: IntArray
    """(T,) vehicle of each track, −1 none."""
    evidence: float
    """V, nats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSearch:
    """The best explanation and what speaks against it."""

    verdict: CameraVerdict
    best: CameraFit | None
    rival: CameraFit | None
    """The best one with another assignment."""


def find_camera(film: FilmedFleet) -> CameraSearch:
    """Find focal length, mount and assignment that explain a film.

    Args:
        film: of 4 s and more, in which vehicles drive.
    """
    if not _moves(film):
        return CameraSearch(verdict=CameraVerdict.STANDING, best=None, rival=None)
    fits = _fits(film)
    if not fits:
        return CameraSearch(verdict=CameraVerdict.UNEXPLAINED, best=None, rival=None)
    best = max(fits, key=lambda fit: fit.evidence)
    others = [fit for fit in fits if _contradict(fit, best)]
    rival = max(others, key=lambda fit: fit.evidence, default=None)
    return CameraSearch(verdict=_verdict(film, best, rival), best=best, rival=rival)


def refined(film: FilmedFleet, before: CameraFit) -> CameraFit | None:
    """Refine a camera by another look, None where that does not explain the film any more."""
    fit = _fitted(film, _start_of(before), before.kind, _POLISH)
    return fit if fit is not None and _verdict(film, fit, None) is CameraVerdict.FOUND else None


def _fits(film: FilmedFleet) -> list[CameraFit]:
    """Explanations from the cameras of the grid; the likeliest of each assignment are fitted to the end."""
    kind = film.mount.kind if film.mount else "stabilized"
    rough = [fit for x in _starts(film, kind) if (fit := _fitted(film, x, kind, _ROUGH)) is not None]
    likely: list[CameraFit] = []
    for fit in sorted(rough, key=lambda fit: -fit.evidence):
        if not any(np.array_equal(fit.vehicle, other.vehicle) for other in likely):
            likely.append(fit)
    kinds: tuple[MountKind, ...] = (kind,) if film.mount or not film.heading_known else ("stabilized", "fixed")
    ends = (_fitted(film, _start_of(fit), end, _POLISH) for fit in likely[:_POLISHED] for end in kinds)
    return [fit for fit in ends if fit is not None]


def _start_of(fit: CameraFit) -> FloatArray:
    return np.array([np.log(fit.focal), fit.pitch, fit.roll, fit.yaw, 0.0, 0.0, 0.0, 0.0])


def _contradict(one: CameraFit, other: CameraFit) -> bool:
    """Tell whether a track is another vehicle, or a vehicle other tracks."""
    a, b = one.vehicle, other.vehicle
    if np.any((a >= 0) & (b >= 0) & (a != b)):
        return True
    return any(not np.any((a == v) & (b == v)) for v in np.intersect1d(a[a >= 0], b[b >= 0]).tolist())


def _moves(film: FilmedFleet) -> bool:
    """Tell whether at least two vehicles drive while something is tracked."""
    known = np.isfinite(film.vehicle_enu[..., 0])
    low = np.min(np.where(known[..., None], film.vehicle_enu, np.inf), axis=0)
    high = np.max(np.where(known[..., None], film.vehicle_enu, -np.inf), axis=0)
    far = np.max(np.where(np.isfinite(high), high - low, 0.0), axis=1)
    return int(np.count_nonzero(far > _MIN_MOVED_M)) >= 2


def _verdict(film: FilmedFleet, best: CameraFit, rival: CameraFit | None) -> CameraVerdict:
    seen = np.count_nonzero(np.isfinite(film.picture[..., 0]), axis=0)
    most = min(int(np.sum(seen)), film.vehicle_enu.shape[1] * len(film.t))
    matched = best.vehicle >= 0
    explained = int(np.sum(seen[matched])) >= _MIN_EXPLAINED * most and np.count_nonzero(matched) >= 2
    if best.evidence < _MIN_EVIDENCE or not explained:
        return CameraVerdict.UNEXPLAINED
    if rival is not None and rival.evidence > best.evidence - _MARGIN:
        return CameraVerdict.AMBIGUOUS
    return CameraVerdict.FOUND


def _turn(yaw: float, pitch: float, roll: float) -> FloatArray:
    """(3, 3) R_base_gimbal = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
    Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(Rz @ Ry @ Rx)


def _base(film: FilmedFleet, kind: MountKind) -> FloatArray:
    """(B, 3, 3) what the mount hangs on: the body, or what is level with its heading."""
    if kind != "stabilized":
        return film.R_enu_base
    nose = film.R_enu_base[:, :2, 0]
    nose = nose / np.linalg.norm(nose, axis=1, keepdims=True)
    east, north, zero = nose[:, 0], nose[:, 1], np.zeros(len(nose))
    # columns: nose, right, down
    return np.stack(
        [
            np.stack([east, north, zero], 1),
            np.stack([north, -east, zero], 1),
            np.tile([0.0, 0.0, -1.0], (len(nose), 1)),
        ],
        axis=2,
    )


def _places(film: FilmedFleet, base: FloatArray, x: FloatArray) -> FloatArray:
    """(B, T, 2) where tracks are on the ground relative to below the UAV, metres; NaN unseen or above the horizon."""
    ray = np.concatenate([film.picture, np.full((*film.picture.shape[:2], 1), np.exp(x[0]))], axis=2)
    d = ray @ np.swapaxes(base @ (_turn(x[3], x[1], x[2]) @ _R_GIMBAL_CAM), 1, 2)
    falls = d[..., 2] < -0.05 * np.linalg.norm(d, axis=2)
    height = (film.p_enu[:, 2] - film.ground_z) * (1.0 + x[6])
    reach = np.where(falls, height[:, None] / np.where(falls, -d[..., 2], 1.0), np.nan)
    place = d[..., :2] * reach[..., None]
    # a turn clockwise by ψ: (e, n) → (e cos ψ + n sin ψ, n cos ψ − e sin ψ)
    turned = x[7] * (film.t - np.mean(film.t))[:, None]
    c, s = np.cos(turned), np.sin(turned)
    return np.stack([c * place[..., 0] + s * place[..., 1], c * place[..., 1] - s * place[..., 0]], axis=2)


def _grid(film: FilmedFleet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """ln φ, pitches and headings that are compared: those that agree with what is known."""
    focals = _FOCALS if np.isnan(film.focal) else np.array([np.log(film.focal)])
    if film.mount is None:
        return focals, _PITCHES, _HEADINGS
    if film.mount.kind == "gimbal":
        return focals, np.zeros(1), np.zeros(1)
    near = np.deg2rad([-10.0, -5.0, 0.0, 5.0, 10.0])
    return focals, np.clip(film.mount.pitch + near, np.deg2rad(-90.0), _PITCHES[-1]), film.mount.yaw + near


def _starts(film: FilmedFleet, kind: MountKind) -> list[FloatArray]:
    """x of the cameras of the grid that may fit, best first."""
    focals, pitches, headings = _grid(film)
    base = _base(film, kind)
    cameras = [(focal, pitch) for focal in focals.tolist() for pitch in pitches.tolist()]
    g = np.stack([_places(film, base, np.array([f, p, *np.zeros(6)])) for f, p in cameras])
    arm, seen = g[..., 0] + 1j * g[..., 1], np.isfinite(g[..., 0])
    q = film.vehicle_enu[..., 0] + 1j * film.vehicle_enu[..., 1] - (film.p_enu[:, 0] + 1j * film.p_enu[:, 1])[:, None]
    has = np.isfinite(film.vehicle_enu[..., 0])
    shape = (len(cameras), *q.shape)
    score, heading = pair_scores(
        *(np.nan_to_num(arm), seen, np.broadcast_to(np.nan_to_num(q), shape), np.broadcast_to(has, shape)),
        headings,
        film.step_s,
        each_apart=True,
    )
    best = _peaks(score.reshape(len(focals), -1), headings[heading].reshape(len(focals), -1))
    return [
        np.array([*cameras[k], 0.0, headings[heading[k]], 0.0, 0.0, 0.0, 0.0]) for k in best.tolist() if score[k] > 0.0
    ]


def _peaks(score: FloatArray, heading: FloatArray) -> IntArray:
    """Places of the best of a grid (F, P), best first, without those beside a better one that looks the same way."""
    chosen: list[tuple[int, int]] = []
    for flat in np.argsort(-score, axis=None, kind="stable").tolist():
        f, p = divmod(flat, score.shape[1])
        beside = (
            (a, b)
            for a, b in chosen
            if abs(a - f) <= 1 and abs(b - p) <= 1 and np.cos(heading[a, b] - heading[f, p]) > _SAME_WAY
        )
        if next(beside, None) is None:
            chosen.append((f, p))
            if len(chosen) == _STARTS:
                break
    return np.array([f * score.shape[1] + p for f, p in chosen], np.int64)


def _differences(film: FilmedFleet, base: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(B, T, V, 2) track less vehicle, metres, and (B, T) distance of a track from below the UAV."""
    places = _places(film, base, x)
    q = film.vehicle_enu - film.p_enu[:, None, :2]
    return places[:, :, None] - q[:, None] - x[4:6], np.linalg.norm(places, axis=2)


def _pair_evidence(film: FilmedFleet, base: FloatArray, x: FloatArray) -> FloatArray:
    """(T, V) L: ln ratio of a pair that belongs together to one that does not."""
    r, arm = _differences(film, base, x)
    known = np.isfinite(r[..., 0])
    n = np.count_nonzero(known, axis=0)
    count = np.maximum(n, 1)
    mean = np.where(known[..., None], r, 0.0).sum(axis=0) / count[..., None]
    own = np.broadcast_to(film.vehicle_enu[:, None], r.shape)
    spread = 0.5 * (_spread(r + own, known) + _spread(own, known)) / count
    far = np.sum(np.where(known, np.nan_to_num(arm)[:, :, None], 0.0), axis=0) / count
    variance = _PLACE_STD_M**2 + np.square(_PLACE_STD_SHARE * far)
    area = np.pi * max(float(np.max(np.nan_to_num(arm))), 10.0) ** 2
    place = np.log(area / (2.0 * np.pi * variance)) - np.sum(np.square(mean), axis=-1) / (2.0 * variance)
    weight = n * film.step_s / _COURSE_TAU_S
    course = weight * (np.log(spread + _COURSE_STD_M**2) - np.log(_spread(r, known) / count + _COURSE_STD_M**2))
    score = place + course - np.log(film.vehicle_enu.shape[1])
    return np.where(n >= _MIN_TIMES, score, -np.inf)


def _spread(p: FloatArray, known: BoolArray) -> FloatArray:
    """(T, V) Σ|p − p̄|² of places (B, T, V, 2) where they are known."""
    n = np.maximum(np.count_nonzero(known, axis=0), 1)
    p0 = np.where(known[..., None], p, 0.0)
    mean = p0.sum(axis=0) / n[..., None]
    return np.asarray(np.sum(np.where(known, np.sum(np.square(p0 - mean), axis=-1), 0.0), axis=0))


def _together(film: FilmedFleet) -> BoolArray:
    """(T, T) tracks that are seen at the same time: they are not one vehicle."""
    seen = np.isfinite(film.picture[..., 0]).astype(np.int64)
    return np.asarray(seen.T @ seen > 0)


def _residuals(x: FloatArray, film: FilmedFleet, base: FloatArray, start: FloatArray, vehicle: IntArray) -> FloatArray:
    """Residuals that the fit makes small: means and wanderings of the pairs' differences, and the prior, in σ."""
    rows = np.flatnonzero(vehicle >= 0)
    places = _places(film, base, x)[:, rows]
    r = places - (film.vehicle_enu[:, vehicle[rows]] - film.p_enu[:, None, :2]) - x[4:6]
    known = np.isfinite(film.picture[:, rows, 0]) & np.isfinite(film.vehicle_enu[:, vehicle[rows], 0])
    # what rose above the horizon is as wrong as can be
    r = np.where(known[..., None], np.clip(np.nan_to_num(r, nan=1e3), -1e3, 1e3), 0.0)
    n = np.maximum(np.count_nonzero(known, axis=0), 1)
    mean = r.sum(axis=0) / n[:, None]
    wander = np.where(known[..., None], r - mean, 0.0) * np.sqrt(min(film.step_s / _COURSE_TAU_S, 1.0)) / _COURSE_STD_M
    prior = (x - start) / _PRIOR_STD
    return np.concatenate([(mean / _PLACE_STD_M).ravel(), wander.ravel(), prior])


def _bounds(film: FilmedFleet, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest x of a fit from a start."""
    reach = np.array([1.0, 0.35, 0.2, np.inf, 10.0, 10.0, 0.2, _STILL if film.heading_known else 0.15])
    low, high = start - reach, start + reach
    low[0], high[0] = (
        (_FOCALS[0] - 0.1, _FOCALS[-1] + 0.1) if np.isnan(film.focal) else (start[0] - 0.05, start[0] + 0.05)
    )
    if film.mount is not None and film.mount.kind == "gimbal":
        low[[1, 3]], high[[1, 3]] = start[[1, 3]] - 0.15, start[[1, 3]] + 0.15
    else:
        low[1], high[1] = np.deg2rad(-95.0), np.deg2rad(-12.0)
    return low, high


def _fitted(film: FilmedFleet, start: FloatArray, kind: MountKind, effort: tuple[int, int]) -> CameraFit | None:
    """The joint optimum of camera and assignment from a start; None where nothing fits there.

    Args:
        film: what is to be explained.
        start: x.
        kind: what the camera hangs on.
        effort: how often it is assigned again, and most steps of the fit in between.
    """
    base, together = _base(film, kind), _together(film)
    start = start * np.array([1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    low, high = _bounds(film, start)
    x, vehicle = start, assignment(_pair_evidence(film, base, start), together)
    std = np.full(len(start), np.inf)
    for _ in range(effort[0]):
        if np.count_nonzero(vehicle >= 0) < 2:
            return None
        found = least_squares(
            *(_residuals, x),
            bounds=(low, high),
            loss="soft_l1",
            x_scale=_STEP,
            max_nfev=effort[1],
            args=(film, base, start, vehicle),
        )
        x, before = found.x, vehicle
        std = _stds(np.asarray(found.jac))
        vehicle = assignment(_pair_evidence(film, base, x), together)
        if np.array_equal(before, vehicle):
            break
    score = _pair_evidence(film, base, x)
    rows = np.flatnonzero(vehicle >= 0)
    cost = 0.5 * float(np.sum(np.square((x - start) / _PRIOR_STD)))
    return CameraFit(
        focal=float(np.exp(x[0])),
        focal_std=float(std[0]),
        kind=kind,
        pitch=float(x[1]),
        pitch_std=float(std[1]),
        roll=float(x[2]),
        yaw=float(np.mod(x[3], 2.0 * np.pi)),
        vehicle=vehicle,
        evidence=float(np.sum(score[rows, vehicle[rows]])) - cost,
    )


def _stds(jac: FloatArray) -> FloatArray:
    """1σ of x by the fit's Jacobian, residuals in σ: √diag (JᵀJ)⁻¹."""
    information = jac.T @ jac + np.diag(np.full(len(_STEP), 1e-9))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))
