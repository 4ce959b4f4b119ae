"""The camera's path over level ground, from how the images of a film map onto each other.

Each image's pose is the one under which ground points, placed by the pose before it, appear where the homography
between the two images sends them. In a narrow view a tilt looks like a shift; what the pixels leave open is decided
for a camera that is held level, so that errors add up to a slow drift over the ground and not to a fall. Ground
positions are placed by these same poses: a drift moves vehicles and camera alike and leaves where they appear as it
was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sim.world.camera import view_from
from sim.world.flight import UavMotion, UavTruth
from sim.world.scenario import Scenario
from sim.world.view import CameraView, project, ray_ground
from sim.world.world import LEAD_S, TAIL_S

FloatArray = NDArray[np.float64]

GRID = 5
"""Points across and down the image at which two poses are compared."""
PIXEL_STD = 1.0
"""How well a homography holds, px."""
LEVEL_STD = np.radians(2.0)
"""How far a camera that is held level strays from its tilt."""
FARTHEST = 8.0
"""Ground that is so many heights away is too near the horizon to compare poses by."""
LEAST_POINTS = 6
"""Points of the ground that two images must share."""
FAR_OFF = 1e4
"""A point that a pose does not show counts as so many px off, and none as more."""
MOST_CLIMB = 1.5
"""From one image to the next no camera gets so much higher or lower: a homography that says so is wrong."""
SPEED_SPAN_S = 1.0
"""Over which the reported speed of the UAV is taken."""
MOST_TRIES = 60
"""Maximum tries of poses for one image, derivatives included; ten are common."""


def hovering(scenario: Scenario, t: FloatArray) -> UavMotion:
    """A camera that does not move, at the scenario's height; t (T,) seconds of the images."""
    pose = np.array([0.0, 0.0, scenario.flight.height_m, 0.0, 0.0, 0.0])
    return _motion(t, np.tile(pose, (len(t), 1)))


def follow_camera(scenario: Scenario, t: FloatArray, motions: Sequence[FloatArray | None]) -> UavMotion:
    """The UAV's motion that explains the images.

    Args:
        scenario: its camera, mounted so that it has the film's usual tilt on a level UAV, and the first height.
        t: (T,) seconds of the images.
        motions: T homographies (3, 3) from the image before to this one, px; None where the images do not tell: the
            camera is taken to stand still then. The first is not used.
    """
    uv = _grid(scenario)
    poses = [np.array([0.0, 0.0, scenario.flight.height_m, 0.0, 0.0, 0.0])]
    for H in motions[1:]:
        poses.append(poses[-1] if H is None else _next_pose(scenario, poses[-1], H, uv))
    return _motion(t, np.array(poses))


def _next_pose(scenario: Scenario, before: FloatArray, H: FloatArray, uv: FloatArray) -> FloatArray:
    """Pose (6,) east, north, up, yaw, pitch, roll of the image that H leads to."""
    height = before[2]
    ground = ray_ground(_view(scenario, before), uv)
    near = np.linalg.norm(ground[:, :2] - before[:2], axis=1) < FARTHEST * height
    homogeneous = np.column_stack([uv, np.ones(len(uv))]) @ H.T
    near &= homogeneous[:, 2] > 0.0
    if np.count_nonzero(near) < LEAST_POINTS:
        return before
    ground, wanted = ground[near], homogeneous[near, :2] / homogeneous[near, 2:]

    def residuals(pose: FloatArray) -> FloatArray:
        seen, _ = project(_view(scenario, pose), ground)
        off = np.clip(np.nan_to_num((seen - wanted) / PIXEL_STD, nan=FAR_OFF), -FAR_OFF, FAR_OFF)
        return np.concatenate([off.ravel(), pose[4:] / LEVEL_STD])

    scale = [height, height, height, 1.0, 1.0, 1.0]
    found = least_squares(residuals, before, method="lm", x_scale=scale, max_nfev=MOST_TRIES)
    told = bool(np.isfinite(found.x).all()) and 1.0 / MOST_CLIMB < found.x[2] / height < MOST_CLIMB
    return np.asarray(found.x) if told else before


def _grid(scenario: Scenario) -> FloatArray:
    camera = scenario.camera
    u, v = np.meshgrid(np.linspace(0.05, 0.95, GRID) * camera.width, np.linspace(0.05, 0.95, GRID) * camera.height)
    return np.column_stack([u.ravel(), v.ravel()])


def _view(scenario: Scenario, pose: FloatArray) -> CameraView:
    at = UavTruth(p_enu=pose[:3], v_enu=np.zeros(3), yaw=pose[3], pitch=pose[4], roll=pose[5])
    return view_from(scenario, at)


def _motion(t: FloatArray, poses: FloatArray) -> UavMotion:
    """Poses (T, 6) at times t (T,), held before the first and after the last."""
    t = np.concatenate([[min(-LEAD_S, t[0] - 1.0)], t, [t[-1] + TAIL_S + 1.0]])
    poses = np.concatenate([poses[:1], poses, poses[-1:]])
    poses[:, 3:] = np.unwrap(poses[:, 3:], axis=0)
    ends = [
        np.stack([np.interp(t + s, t, p) for p in poses[:, :3].T], axis=1)
        for s in (-0.5 * SPEED_SPAN_S, 0.5 * SPEED_SPAN_S)
    ]
    v = (ends[1] - ends[0]) / SPEED_SPAN_S
    return UavMotion(t=t, values=np.column_stack([poses[:, :3], v, poses[:, 3:]]), wobble=np.empty((0, 3)))
