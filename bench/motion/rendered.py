"""A rendered flight: the motion between its frames against the true cameras, and what it takes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gcs.session.frame_tables import motion_row, read_detections
from infra.session_format import DETECTIONS, MOTION
from sim.render.film import Film
from sim.session import frame_times
from sim.world.scenario import Scenario
from sim.world.view import CameraView, project, ray_ground
from sim.world.world import World
from vision.camera.intrinsics import Intrinsics
from vision.motion.estimator import MotionEstimator
from vision.motion.image_motion import ImageMotion
from vision.motion.plane_fit import mapped
from vision.motion.rotation import GroundShift, rotation_of

__all__ = ["MotionErrors", "write_motion"]

FloatArray = NDArray[np.float64]

SPEED_STD = 0.3
"""1σ of the UAV's reported velocity, m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionErrors:
    """What came of the pairs of frames of one flight."""

    cpu_ms: FloatArray
    """(k,) processor time of each comparison."""
    none: int
    """Pairs that were not compared."""
    moved_px: FloatArray
    """(k,) how far the ground moved between the two, root mean square over the image."""
    error_px: FloatArray
    """(k,) how far the homography was off, the same."""
    turn_error_deg: FloatArray
    """(k,) how far the turn was off."""
    turn_surprise: FloatArray
    """(k,) squared error of the turn in its covariance: 3 on average."""


def write_motion(scenario: Scenario, folder: Path) -> MotionErrors:
    """Compare the frames of a session that was written without video, and put ``motion.csv`` beside it."""
    boxes = read_detections(folder / DETECTIONS.name)
    world, rng = World(scenario), np.random.default_rng(scenario.seed)
    estimator = MotionEstimator()
    cpu_ms: list[float] = []
    errors: list[tuple[float, float, float, float]] = []
    rows, before, before_t = "", None, 0.0
    t, _ = frame_times(scenario)
    for index, (now, image) in enumerate(_images(world, t)):
        begin_s = time.process_time()
        motion = estimator.update(image, boxes.at(index))
        cpu_ms.append(1e3 * (time.process_time() - begin_s))
        view = world.view(now)
        if motion is not None and before is not None:
            rows += motion_row(index, motion)
            errors.append(_errors(motion, before, view, now - before_t, rng))
        before, before_t = view, now
    (folder / MOTION.name).write_text(MOTION.header + rows)
    moved, off, turn, surprise = np.array(errors).reshape(-1, 4).T
    return MotionErrors(
        cpu_ms=np.array(cpu_ms[1:]),
        none=len(t) - 1 - len(errors),
        moved_px=moved,
        error_px=off,
        turn_error_deg=turn,
        turn_surprise=surprise,
    )


def _images(world: World, t: FloatArray) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Frames as a camera's compression leaves them."""
    film = Film(world)
    for index, now in enumerate(t.tolist()):
        packed = cv2.imencode(".jpg", film.image(now, index), [cv2.IMWRITE_JPEG_QUALITY, 60])[1]
        yield now, np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def _errors(
    motion: ImageMotion, before: CameraView, view: CameraView, dt: float, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """How far the ground moved and the homography is off, px; how far the turn is, degrees and in its covariance."""
    across, down = (np.linspace(0.03, 0.97, n) for n in (9, 6))
    places = np.stack(np.meshgrid(across * view.width, down * view.height), axis=-1).reshape(-1, 2)
    true = project(view, ray_ground(before, places))[0]
    inside = np.isfinite(true).all(axis=1) & ((true > 0) & (true < (view.width, view.height))).all(axis=1)
    moved, off = (np.linalg.norm(a - true, axis=1)[inside] for a in (places, mapped(motion.H, places)))
    R = before.R_enu_cam
    shift = view.p_enu - before.p_enu + rng.normal(0.0, SPEED_STD * dt, 3)
    ground = GroundShift(
        shift=R.T @ shift, shift_std=SPEED_STD * dt, down=R.T @ [0.0, 0.0, -1.0], height=float(before.p_enu[2])
    )
    lens = {name: getattr(view, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "distortion")}
    turn = rotation_of(motion, Intrinsics(**lens), ground)
    if turn is None:
        return _rms(moved), _rms(off), np.nan, np.nan
    # R_enu_later = R_enu_earlier R_later_earlierᵀ
    wrong = (Rotation.from_matrix(view.R_enu_cam.T @ R) * Rotation.from_rotvec(turn.vector).inv()).as_rotvec()
    return (
        _rms(moved),
        _rms(off),
        float(np.degrees(np.linalg.norm(wrong))),
        float(wrong @ np.linalg.solve(turn.cov, wrong)),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values * values))) if len(values) else np.nan
