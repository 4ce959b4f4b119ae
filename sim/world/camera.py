"""True camera pose from the UAV's and the mount's. Independent of the program's own camera model, to test that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.flight import UavTruth
from sim.world.scenario import Scenario
from sim.world.view import CameraView

FloatArray = NDArray[np.float64]

ENU_FROM_NED: FloatArray = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation from north-east-down to east-north-up."""

CAMERA_IN_MOUNT: FloatArray = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Camera (x right, y down, z along the optical axis) to mount (x along the optical axis, y right, z down)."""


def body_rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    """(3, 3) forward-right-down vectors into north-east-down, in the order yaw, pitch, roll; radians."""
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    # R = R_z(ψ) R_y(θ) R_x(φ)
    Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(Rz @ Ry @ Rx)


def mount_rotation(scenario: Scenario) -> FloatArray:
    """(3, 3) gimbal axes (x along the optical axis) in the carrier's frame, as ``session.toml`` declares it."""
    camera = scenario.camera
    return body_rotation(*np.radians([camera.yaw_deg, camera.pitch_deg, camera.roll_deg]))


def view_from(scenario: Scenario, uav: UavTruth) -> CameraView:
    """The true camera. A stabilized mount follows the UAV's yaw and stays level except for its own tilt error."""
    yaw = float(uav.yaw)
    if scenario.camera.mount == "fixed":
        carrier = body_rotation(yaw, float(uav.pitch), float(uav.roll))
    else:
        error = np.radians([scenario.attitude.tilt_pitch_deg, scenario.attitude.tilt_roll_deg])
        carrier = body_rotation(yaw, float(error[0]), float(error[1]))
    camera = scenario.camera
    # flipped left to right: u' = W − u = −f_x x/z + (W − c_x)
    fx, cx = (-camera.fx, camera.width - camera.cx) if camera.mirrored else (camera.fx, camera.cx)
    return CameraView(
        width=camera.width,
        height=camera.height,
        fx=fx,
        fy=camera.fy,
        cx=cx,
        cy=camera.cy,
        distortion=np.array(camera.distortion),
        R_enu_cam=ENU_FROM_NED @ carrier @ mount_rotation(scenario) @ CAMERA_IN_MOUNT,
        p_enu=np.asarray(uav.p_enu, dtype=np.float64),
    )
