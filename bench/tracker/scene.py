"""Traffic seen by a camera that drifts and yaws: what a detector reports of it, and what vehicles and camera report.

Vehicles drive on a plane, turn now and then and turn back at its edges; they do not mind each other, so that paths
cross and boxes overlap. The camera looks straight down on 1920 × 1080 pixels, 30 frames a second; more than fifty
vehicles are seen from higher up, so that all lengths below shrink and the crowd is as dense as fifty. The detector's
centres are off by 1.5 px; 4 % of the boxes are missed, each vehicle is hidden for 3 to 20 frames about every four
seconds, whatever is under a passing shade for 15 to 40, and of two that meet one is often lost. A tenth of the boxes
have a low score, and 1 % are of nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections

__all__ = ["SIZE", "STEP_US", "SimulatedFrame", "film"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SIZE = np.array([1920.0, 1080.0])
STEP_US = 33_333
EDGE = np.array([780.0, 400.0])
"""Half the sides of the ground on which vehicles stay, px."""
TURN, TURN_BACK = 0.02, 0.05
"""Curves and the turn at an edge, rad a frame."""
YAW, YAW_FRAMES = np.radians(10.0), 180.0
DRIFT, DRIFT_FRAMES = np.array([80.0, 50.0]), np.array([240.0, 200.0])
WARP_SHIFT, WARP_TURN = 0.5, 0.0005
"""Errors of the camera's motion as telemetry has it, px and rad a frame."""
REPORT, REPORT_BIAS, BIAS_FRAMES = 3.0, 8.0, 900.0
"""Errors of a vehicle's reported place: white, and constant for about half a minute, px."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedFrame:
    """One frame and what is known of it."""

    t_us: int
    boxes: Detections
    vehicle: IntArray
    """(m,) the truth, -1 for a box of nothing."""
    scale: float
    """Lengths in this frame, 1 for up to fifty vehicles."""
    warp: FloatArray
    """(3, 3) homography from the frame before, a little wrong."""
    reported: FloatArray
    """(n, 2) px where each vehicle reports to be."""


def film(n: int, seed: int, frames: int) -> list[SimulatedFrame]:
    """The same frames for the same seed."""
    rng = np.random.default_rng([seed, n])
    scale = min(1.0, float(np.sqrt(50 / n)))
    side = scale * np.stack([rng.uniform(52, 68, n), rng.uniform(24, 32, n)], axis=1)
    hidden, bias = np.zeros(n, np.int64), rng.normal(0, REPORT_BIAS, (n, 2))
    keep = np.exp(-1.0 / BIAS_FRAMES)
    before, out = _camera(0), []
    for k, (place, course) in zip(range(frames), _drive(n, scale, rng), strict=False):
        A, yaw = _camera(k), _yaw(k)
        hidden = _hide(hidden, place, scale, k, rng)
        bias = keep * bias + np.sqrt(1 - keep**2) * rng.normal(0, REPORT_BIAS, (n, 2))
        at = place @ A[:2, :2].T + A[:2, 2]
        boxes, vehicle = _detect(at, course + yaw, side, hidden > 0, scale, rng)
        warp = _slip(rng) @ A @ np.linalg.inv(before)
        reported = at + scale * (bias + rng.normal(0, REPORT, (n, 2)))
        out.append(
            SimulatedFrame(t_us=k * STEP_US, boxes=boxes, vehicle=vehicle, scale=scale, warp=warp, reported=reported)
        )
        before = A
    return out


def _drive(n: int, scale: float, rng: np.random.Generator) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Places (n, 2) px on the ground and courses (n,) rad, frame by frame."""
    place, course = rng.uniform(-EDGE, EDGE, (n, 2)), rng.uniform(-np.pi, np.pi, n)
    speed, turn = scale * rng.uniform(1.5, 6.0, n), np.zeros(n)
    while True:
        turn = np.where(rng.random(n) < 1 / 60, rng.choice([-TURN, 0.0, 0.0, TURN], n), turn)
        home = np.angle(np.exp(1j * (np.arctan2(-place[:, 1], -place[:, 0]) - course)))
        out = (np.abs(place) > EDGE).any(axis=1)
        course = course + np.where(out, np.clip(home, -TURN_BACK, TURN_BACK), turn)
        place = place + speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        yield place, course


def _yaw(k: int) -> float:
    return float(YAW * np.sin(2 * np.pi * k / YAW_FRAMES))


def _camera(k: int) -> FloatArray:
    """(3, 3) from the ground to pixels."""
    c, s = np.cos(_yaw(k)), np.sin(_yaw(k))
    R = np.array([[c, -s], [s, c]])
    A = np.eye(3)
    A[:2, :2], A[:2, 2] = R, SIZE / 2 - R @ (DRIFT * np.sin(2 * np.pi * k / DRIFT_FRAMES))
    return A


def _slip(rng: np.random.Generator) -> FloatArray:
    """(3, 3) by how much telemetry misjudges one step of the camera, about the frame's middle."""
    turn = rng.normal(0, WARP_TURN)
    shift = rng.normal(0, WARP_SHIFT, 2)
    R = np.array([[1.0, -turn], [turn, 1.0]])
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = R, SIZE / 2 - R @ (SIZE / 2) + shift
    return out


def _hide(hidden: IntArray, place: FloatArray, scale: float, k: int, rng: np.random.Generator) -> IntArray:
    """Frames (n,) for which each vehicle stays hidden."""
    n = len(hidden)
    hidden = np.where(hidden > 0, hidden - 1, np.where(rng.random(n) < 1 / 120, rng.integers(3, 21, n), 0))
    if k % 90 == 60:
        shade = np.hypot(*(place - rng.uniform(-EDGE, EDGE)).T) < 250.0 * scale
        hidden = np.where(shade, np.maximum(hidden, rng.integers(15, 41)), hidden)
    apart = np.hypot(*(place[:, None] - place).transpose(2, 0, 1)) + np.where(np.eye(n, dtype=bool), np.inf, 0.0)
    met = (apart < 25.0 * scale).any(axis=1) & (rng.random(n) < 0.3)
    return np.where(met, np.maximum(hidden, 1), hidden)


def _detect(
    at: FloatArray, course: FloatArray, side: FloatArray, hidden: BoolArray, scale: float, rng: np.random.Generator
) -> tuple[Detections, IntArray]:
    """Boxes of vehicles at pixels (n, 2), in any order, and the vehicle of each."""
    n = len(at)
    inside = ((at > 0) & (at < SIZE)).all(axis=1)
    who = rng.permutation(np.flatnonzero(inside & ~hidden & (rng.random(n) > 0.04)))
    false = int(rng.binomial(n, 0.01))
    centre = np.concatenate([at[who] + rng.normal(0, 1.5 * scale, (len(who), 2)), rng.uniform(0, SIZE, (false, 2))])
    sides = np.concatenate([side[who] + rng.normal(0, scale, (len(who), 2)), scale * np.tile([60.0, 28.0], (false, 1))])
    angle = np.concatenate([course[who] + rng.normal(0, 0.03, len(who)), rng.uniform(-np.pi, np.pi, false)])
    weak = rng.random(len(angle)) < 0.1
    boxes = Detections(
        cx=centre[:, 0],
        cy=centre[:, 1],
        w=sides[:, 0],
        h=sides[:, 1],
        angle=angle,
        score=np.where(weak, rng.uniform(0.15, 0.45, len(angle)), rng.uniform(0.65, 0.95, len(angle))),
        heading=np.mod(angle + np.pi / 2, 2 * np.pi),
    )
    return boxes, np.concatenate([who, np.full(false, -1)])
