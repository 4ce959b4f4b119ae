"""Projection between image rays and the ground plane under a correction of the camera's pose.

The correction θ = (yaw, yaw rate, pitch, roll, E, N, H, δ, λ): radians, rad/s, radians, radians, metres ×3, seconds ×2.
Yaw is clockwise, about the vertical; its rate counts from the newest frame; pitch turns about the image's horizontal
right axis, roll about its horizontal forward axis; δ is video time minus telemetry time; λ is how old the camera's
positions are beyond their time stamps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from assoc.history import TrackHistory
from assoc.records import CameraState

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Number = TypeVar("Number", float, FloatArray)

THETA = 9
"""Length of θ."""
YAW, YAW_RATE, PITCH, ROLL, EAST, NORTH, HEIGHT, OFFSET, LAG = range(THETA)
_PLACE = slice(EAST, HEIGHT + 1)

_DEPRESSION_SIN_MIN = 0.05
"""Rays flatter than this (sine of the angle below the horizon) are not projected: they hit the ground too far away."""
_DELTA_S = 0.02
"""Step of the numerical derivative by δ, seconds: about half a frame."""
_SAME_TIME_S = 0.6
"""Offset of the clocks up to which a rotation found by the image holds, seconds: a UAV that speeds up meanwhile is
decimetres elsewhere."""
_AHEAD_S, _AHEAD_M = 0.25, 1.5
"""Longest time, seconds, and way, metres, by which a camera's position is extrapolated beyond its reports: a UAV that
brakes hard is half a metre elsewhere by then."""
_BOX_STD_M, _BOX_STD_RAD = 0.4, 0.004
"""1σ of a box's place on the ground, metres, and of its angle, radians: boxes are not round quite the same points."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTracks:
    """Tracks on the ground plane. F frames, T tracks."""

    t: FloatArray
    """(F,) video time, seconds."""
    p: FloatArray
    """(F, T, 2) east and north, metres, NaN unseen."""
    jacobian: FloatArray
    """(F, T, 2, 9) derivative of ``p`` by θ, without the motion of the track itself under δ."""
    heading: FloatArray
    """(F, T) clockwise from north, NaN unknown."""
    pixel_m: FloatArray
    """(F, T) ground length of one pixel, metres."""
    theta: FloatArray
    """(9,) the correction that was applied."""


def _interpolation(times: FloatArray, query: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Index of the row before each query and the weight of the row after; extrapolates one step at the ends."""
    if len(times) < 2:
        return np.zeros(len(query), np.int64), np.zeros(len(query))
    k = np.clip(np.searchsorted(times, query, side="right") - 1, 0, len(times) - 2)
    return k, np.clip((query - times[k]) / (times[k + 1] - times[k]), -1.0, 2.0)


def _rotations_at(history: TrackHistory, rows: slice, delta_s: float) -> FloatArray:
    """Camera rotation (F, 3, 3) of the rows, interpolated at telemetry time t − δ.

    Rotations are blended linearly: between neighbouring rows they differ by a few degrees at most. Those that were
    found by the image are of its time already; but where the clocks differ by more than a moment they were found with
    the camera elsewhere than it was, and the reported ones count.
    """
    if _is_of_image_time(history, delta_s):
        return history.R[rows]
    return _interpolated_rotations(history, history.t[rows] - delta_s)


def _is_of_image_time(history: TrackHistory, delta_s: float) -> bool:
    """Tell whether the rotations are those of their frames' own moments, though the clocks differ by δ."""
    return delta_s == 0.0 or (history.of_image_time and abs(delta_s) < _SAME_TIME_S)


def _interpolated_rotations(history: TrackHistory, t: FloatArray) -> FloatArray:
    """(F, 3, 3) camera rotations by the reports at times (F,)."""
    R = history.R_reported if history.of_image_time else history.R
    k, w = _interpolation(history.t[: history.n], t)
    after = np.minimum(k + 1, history.n - 1)
    return np.asarray(R[k] * (1.0 - w)[:, None, None] + R[after] * w[:, None, None])


def _positions_at(history: TrackHistory, rows: slice, late_s: float) -> FloatArray:
    """Camera position (F, 3) of the rows as it is reported for their times and ``late_s`` = λ − δ more.

    Interpolated; beyond what is known the camera is taken to have flown straight on, as far as that tells: where one
    that flies fast was before the first frame, or is by then, nothing shows, NaN.
    """
    if late_s == 0.0:
        return history.p[rows]
    p, on, beyond_s = _flown_to(history, history.t[rows] + late_s)
    far = np.where(beyond_s > 0.0, np.hypot(on[:, 0], on[:, 1]), -beyond_s * history.speed_mps)
    unknown = ((beyond_s > _AHEAD_S) | (beyond_s < -_SAME_TIME_S)) & (far > _AHEAD_M)
    return np.where(unknown[:, None], np.nan, p + on)


def _flown_to(history: TrackHistory, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Camera positions (F, 3) by the reports at times (F,), how far it flies on from there (F, 3), metres, and for how
    long, (F,) seconds: before the first report, < 0, and beyond the last."""
    times = history.t[: history.n]
    k, w = _interpolation(times, np.clip(t, times[0], times[-1]))
    after = np.minimum(k + 1, history.n - 1)
    p = history.p[k] * (1.0 - w)[:, None] + history.p[after] * w[:, None]
    beyond_s = np.minimum(t - times[0], 0.0) + np.maximum(t - times[-1], 0.0)
    return p, beyond_s[:, None] * history.v[np.where(beyond_s > 0.0, history.n - 1, k)], beyond_s


def camera_at_frame(history: TrackHistory, t: float, camera: CameraState, delta_s: float) -> CameraState:
    """The camera of a frame as it is reported for the moment at which that was taken.

    Args:
        history: Frames up to it.
        t: Its time by the declared offset of the clocks, seconds.
        camera: As reported for that time.
        delta_s: δ.
    """
    if delta_s == 0.0 or not history.n or not np.isfinite(camera.p_enu).all():
        return camera
    then = np.array([t - delta_s])
    p, on, _ = _flown_to(history, then)
    held = _is_of_image_time(history, delta_s)
    R = camera.R_enu_cam if held else _interpolated_rotations(history, then)[0]
    return replace(camera, p_enu=(p + on)[0], R_enu_cam=R)


def _level_right(R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """East and north of the image's horizontal right axis, (F,) each; its forward axis is (−north, east)."""
    east, north = R[:, 0, 0], R[:, 1, 0]
    norm = np.maximum(np.sqrt(east * east + north * north), 1e-9)
    return east / norm, north / norm


def _rotations(R: FloatArray, yaw: FloatArray, pitch: FloatArray | float, roll: FloatArray | float) -> FloatArray:
    """(F, 3, 3) rotation of the correction, Rz(−yaw) (I + [pitch·right + roll·forward]×): first order in the tilts."""
    east, north = _level_right(R)
    turn = np.empty((len(R), 3, 3))
    rows = _turned(np.cos(yaw), np.sin(yaw), pitch * east - roll * north, pitch * north + roll * east)
    for i, row in enumerate(rows):
        turn[:, i, 0], turn[:, i, 1], turn[:, i, 2] = row
    return turn


def _turned(c: Number, s: Number, x: Number, y: Number) -> list[list[Number | float]]:
    """Rows of Rz(−yaw) (I + [(x, y, 0)]×), from cosine and sine of the yaw: numbers, or arrays for several."""
    # clockwise by yaw: east' = c·e + s·n, north' = −s·e + c·n; the axis (x, y, 0) is level
    return [[c, s, c * y - s * x], [-s, c, -s * y - c * x], [-y, x, 1.0]]


def _tilt(R_enu_cam: FloatArray, theta: FloatArray) -> tuple[float, float]:
    """East and north of the level axis about which one frame's camera is tilted under a correction, radians."""
    east, north = float(R_enu_cam[0, 0]), float(R_enu_cam[1, 0])
    norm = max(math.sqrt(east * east + north * north), 1e-9)
    pitch, roll, east, north = float(theta[PITCH]), float(theta[ROLL]), east / norm, north / norm
    return pitch * east - roll * north, pitch * north + roll * east


def _intersect_ground(d: FloatArray, p: FloatArray, z: FloatArray) -> FloatArray:
    """Ground points p_xy + d_xy (z − p_z)/d_z of rays d (F, K, 3) from p (F, 3).

    NaN where a ray does not descend, or from a camera that is not above the ground.
    """
    norm = np.sqrt(np.einsum("...i,...i->...", d, d))
    falls = (d[..., 2] < -_DEPRESSION_SIN_MIN * norm) & (p[:, 2] > z)[:, None]
    scale = np.where(falls, (z - p[:, 2])[:, None] / np.where(falls, d[..., 2], -1.0), np.nan)
    return np.asarray(p[:, None, :2] + d[..., :2] * scale[..., None])


def _points(
    history: TrackHistory, rows: slice, theta: FloatArray, rays: FloatArray, delta_s: float, sway: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ground points (F, K, 2) of rays (F, K, 3), camera rotations (F, 3, 3) and corrected camera positions (F, 3)."""
    R, p = _rotations_at(history, rows, delta_s), _positions_at(history, rows, float(theta[LAG]) - delta_s)
    yaw, pitch, roll = _yaw(history, rows, theta), theta[PITCH], theta[ROLL]
    if sway is not None:
        yaw, pitch, roll = yaw + sway[:, YAW], pitch + sway[:, PITCH], roll + sway[:, ROLL]
        p = p + sway[:, _PLACE]
    turned = np.matmul(_rotations(R, yaw, pitch, roll), R)
    p = p + theta[_PLACE]
    return _intersect_ground(np.matmul(rays, turned.transpose(0, 2, 1)), p, history.z[rows]), R, p


def _yaw(history: TrackHistory, rows: slice, theta: FloatArray) -> FloatArray:
    """(F,) correction of the heading at each frame."""
    return np.asarray(theta[YAW] + theta[YAW_RATE] * (history.t[rows] - history.t[history.n - 1]))


def bearing_and_depression(d: FloatArray) -> FloatArray:
    """(k, 2) clockwise from north and below the horizon, radians, of directions (k, 3) east, north, up."""
    return np.column_stack([np.arctan2(d[:, 0], d[:, 1]), np.arctan2(-d[:, 2], np.hypot(d[:, 0], d[:, 1]))])


def ground_tracks(
    history: TrackHistory, start: int, theta: FloatArray, columns: IntArray, sway: FloatArray | None = None
) -> GroundTracks:
    """Project the history, from row ``start`` to the newest, to the ground under a correction.

    Args:
        history: Frames and rays.
        start: First row.
        theta: (9,) pose correction.
        columns: (T,) tracks wanted.
        sway: (F, 9) what each frame's pose has beyond θ; None: nothing.

    Returns:
        Points, headings and derivatives by θ.
    """
    rows, n = slice(start, history.n), len(columns)
    delta = float(theta[OFFSET])
    rays = history.ray[rows][:, columns]
    both = np.concatenate([rays, history.front[rows][:, columns]], axis=1)
    points, R, p = _points(history, rows, theta, both, delta, sway)
    g, front = points[:, :n], points[:, n:] - points[:, :n]
    fall = (history.z[rows] - p[:, 2])[:, None]
    # u = d_xy / d_z of each ray d, so that g = p + fall·u
    arm = g - p[:, None, :2]
    u = arm / np.where(fall < 0.0, fall, np.nan)[..., None]
    jacobian = np.zeros((*g.shape, THETA))
    # ∂g/∂yaw (clockwise) = (arm_n, −arm_e)
    jacobian[..., 0, YAW], jacobian[..., 1, YAW] = arm[..., 1], -arm[..., 0]
    jacobian[..., YAW_RATE] = jacobian[..., YAW] * (history.t[rows] - history.t[history.n - 1])[:, None, None]
    yaw = _yaw(history, rows, theta)[:, None]
    c, s = np.cos(yaw), np.sin(yaw)
    east, north = (part[:, None] for part in _level_right(R))
    # the level axes turned clockwise by yaw
    right = c * east + s * north, c * north - s * east
    for k, (x, y) in ((PITCH, right), (ROLL, (-right[1], right[0]))):
        # the ray turns by a × d, a = (x, y, 0): ∂g = fall ((y, −x) − u (x u_n − y u_e))
        spin = x * u[..., 1] - y * u[..., 0]
        jacobian[..., 0, k], jacobian[..., 1, k] = fall * (y - u[..., 0] * spin), fall * (-x - u[..., 1] * spin)
    jacobian[..., 0, EAST] = 1.0
    jacobian[..., 1, NORTH] = 1.0
    # H lifts the camera: ∂fall/∂H = −1
    jacobian[..., HEIGHT] = -u
    # λ moves the camera along its flight
    then, _ = _interpolation(history.t[: history.n], history.t[rows] + float(theta[LAG]) - delta)
    velocity = history.v[then][:, None]
    jacobian[..., LAG] = velocity[..., :2] - u * velocity[..., 2:]
    # a moment earlier nothing may be known of the camera
    jacobian[..., OFFSET] = np.nan_to_num(
        (_points(history, rows, theta, rays, delta + _DELTA_S, sway)[0] - g) / _DELTA_S
    )
    # a pixel covers range · px_rad across, and 1/sin(depression) times as much along the ray
    pixel = history.px_rad[rows][:, None] * np.abs(fall) * (1.0 + u[..., 0] ** 2 + u[..., 1] ** 2)
    return GroundTracks(
        t=history.t[rows],
        p=g,
        jacobian=jacobian,
        heading=np.arctan2(front[..., 0], front[..., 1]),
        pixel_m=pixel,
        theta=theta,
    )


def _corrected(R_enu_cam: FloatArray, theta: FloatArray) -> FloatArray:
    """(3, 3) rotation of one frame's camera under a correction."""
    yaw = float(theta[YAW])
    return np.asarray(np.array(_turned(math.cos(yaw), math.sin(yaw), *_tilt(R_enu_cam, theta))) @ R_enu_cam)


def _sight_lines(p: FloatArray, p_enu: FloatArray, ground_z: float, theta: FloatArray) -> FloatArray:
    """(n, 3) ENU from the corrected camera to places (n, 2) on the ground, metres."""
    to = np.empty((len(p), 3))
    to[:, :2], to[:, 2] = p, ground_z
    return np.asarray(to - (p_enu + theta[_PLACE]))


def angles_to_places(
    rays: FloatArray, p: FloatArray, R_enu_cam: FloatArray, p_enu: FloatArray, ground_z: float, theta: FloatArray
) -> FloatArray:
    """Angles between rays and the lines of sight to places on the ground, under a correction.

    Args:
        rays: (m, 3) camera frame.
        p: (n, 2) east and north, metres.
        R_enu_cam: (3, 3).
        p_enu: (3,) camera position, metres.
        ground_z: Height of the ground, metres.
        theta: (9,) correction; its δ and λ are left out.

    Returns:
        (m, n) radians.
    """
    d = rays @ _corrected(R_enu_cam, theta).T
    to = _sight_lines(p, p_enu, ground_z, theta)
    a, b = d / np.linalg.norm(d, axis=1)[:, None], to / np.linalg.norm(to, axis=1)[:, None]
    # ∠ = 2 arcsin(|â − b̂| / 2)
    gap = a[:, None, :] - b[None, :, :]
    return np.asarray(2.0 * np.arcsin(np.minimum(np.sqrt(np.sum(gap * gap, axis=2)) / 2.0, 1.0)))


def rays_to_ground(
    rays: FloatArray, R_enu_cam: FloatArray, p_enu: FloatArray, ground_z: float, theta: FloatArray
) -> FloatArray:
    """Project the rays of one frame to the ground under a correction.

    Args:
        rays: (m, 3) camera frame.
        R_enu_cam: (3, 3).
        p_enu: (3,) camera position, metres.
        ground_z: Height of the ground, metres.
        theta: (9,) correction; its δ and λ are left out.

    Returns:
        (m, 2) east and north, metres, NaN where a ray does not descend.
    """
    d = rays @ _corrected(R_enu_cam, theta).T
    return np.asarray(_intersect_ground(d[None], (p_enu + theta[_PLACE])[None], np.array([ground_z]))[0])


def ground_to_rays(
    p: FloatArray, R_enu_cam: FloatArray, p_enu: FloatArray, ground_z: float, theta: FloatArray
) -> FloatArray:
    """Rays from the corrected camera to places on the ground: the inverse of :func:`rays_to_ground`.

    Args:
        p: (n, 2) east and north, metres.
        R_enu_cam: (3, 3).
        p_enu: (3,) camera position, metres.
        ground_z: Height of the ground, metres.
        theta: (9,) correction; its δ and λ are left out.

    Returns:
        (n, 3) camera frame, metres, to first order in pitch and roll.
    """
    d = _sight_lines(p, p_enu, ground_z, theta)
    (x, y), yaw = _tilt(R_enu_cam, theta), float(theta[YAW])
    back = np.array(_turned(1.0, 0.0, -x, -y)) @ np.array(_turned(math.cos(yaw), -math.sin(yaw), 0.0, 0.0))
    return np.asarray(d @ back.T @ R_enu_cam)


def place_covariance(level_m: FloatArray, height_m: float) -> FloatArray:
    """(m, 2, 2) covariance of boxes' places on the ground, m²: near the horizon how far away is known badly.

    With r the distance and h the height of the camera, 1σ is 0.4 m + 0.004 r across the line of sight and
    0.4 m + 0.004 r²/h along it.

    Args:
        level_m: (m, 2) places from below the camera, metres, NaN unknown.
        height_m: Of the camera above the ground.
    """
    along_m = np.linalg.norm(level_m, axis=1)
    unit = np.nan_to_num(level_m / np.maximum(along_m, 1e-6)[:, None])
    away = np.nan_to_num(np.hypot(along_m, height_m))
    across_std = _BOX_STD_M + _BOX_STD_RAD * away
    along_std = _BOX_STD_M + _BOX_STD_RAD * away**2 / max(height_m, 1.0)
    outer = unit[:, :, None] * unit[:, None]
    return np.asarray(across_std[:, None, None] ** 2 * (np.eye(2) - outer) + along_std[:, None, None] ** 2 * outer)
