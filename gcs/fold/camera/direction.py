"""Direction of the camera: as the mission's mount has it, or as the gimbal reports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs.mission.mission import Camera, Mission
from gcs.snapshot import Event
from mavlink.state import CameraReport, UavAttitude, UavState
from vision.camera.camera import CameraPose, Mount, camera_rotation

MOUNT_DOUBT = np.deg2rad(20.0)
"""Largest angle between the gimbal's report and the mission's mount of the camera: mounts are set up by eye."""
TURNED_US = 5_000_000
"""Time for a gimbal's reports to come that were asked for when an order turned the camera."""
LOST_US = 3_000_000
"""Time without an attitude of the gimbal after which its loss is reported."""
LEVEL = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""(3, 3) body of a level UAV whose nose points north, to ENU."""


class CameraDirection:
    """The camera's mount, and whether the gimbal's reports take precedence over it."""

    def __init__(self, mission: Mission) -> None:
        self._camera = mission.camera
        self._mount = mount_of(mission.camera)
        self._mount_doubted = False
        self._turned_us = 0
        """Time at which an order turned the camera: from then on the mission does not know where it looks."""
        self._turn_reported = False
        self._reported_us, self._lost_reported = 0, False
        """Time at which the gimbal's attitude was known last, and whether its loss was reported."""

    @property
    def stabilized(self) -> bool:
        """True if a gimbal keeps the camera's horizon level."""
        return self._mount.kind == "stabilized"

    @property
    def follows_gimbal(self) -> bool:
        """True if the gimbal's reports take precedence over the mission; a camera fixed to the body has no gimbal."""
        return self._camera is None or self._camera.mount == "gimbal" or bool(self._turned_us)

    def use(self, camera: Camera) -> None:
        """Take the mount of a camera that was found, from now on."""
        self._camera, self._mount, self._mount_doubted = camera, mount_of(camera), False

    def order_given(self, t_us: int) -> None:
        """Note an order that turns the camera."""
        self._turned_us = self._turned_us or t_us

    def pose(self, uav: UavState, p_enu: NDArray[np.float64]) -> CameraPose:
        """The camera's pose; without an attitude, that of a level UAV whose nose points north.

        Args:
            uav: how it hangs in the air.
            p_enu: (3,) where it is, metres.
        """
        return CameraPose(R_enu_cam=self.rotation(uav, uav.camera), p_enu=p_enu)

    def rotation(self, uav: UavAttitude, report: CameraReport | None) -> NDArray[np.float64]:
        """The rotation (3, 3) of the camera's pose alone."""
        mount = self._mount
        if self._camera is None and report is not None:
            # an image turned clockwise is that of a camera rolled the other way
            mount = replace(mount, roll=-math.radians(report.rotation_deg))
        R_enu_body = uav.R_enu_body if uav.attitude_valid else LEVEL
        return camera_rotation(mount, R_enu_body, _gimbal(uav) if self.follows_gimbal else None)

    def check(self, t_us: int, uav: UavState) -> Iterator[Event]:
        """News for the operator about the direction, each once."""
        R_enu_gimbal = _gimbal(uav)
        if self.follows_gimbal and uav.attitude_valid:
            yield from self._check_lost(t_us, R_enu_gimbal is not None)
        if self._turned_us and not self._turn_reported:
            yield from self._check_turned(t_us, R_enu_gimbal is not None)
        if self.follows_gimbal or self._mount_doubted or R_enu_gimbal is None:
            return
        R_enu_cam = camera_rotation(self._mount, uav.R_enu_body)
        if R_enu_cam[:, 2] @ R_enu_gimbal[:, 0] < np.cos(MOUNT_DOUBT):
            self._mount_doubted = True
            text = 'the gimbal reports another direction than the mission\'s camera; mount = "gimbal" would follow it'
            yield Event(t_us=t_us, level="warning", kind="video", text=text)

    def _check_lost(self, t_us: int, reported: bool) -> Iterator[Event]:
        """Events on a gimbal whose attitude is no longer known, or known again."""
        if reported:
            if self._lost_reported:
                text = "the gimbal reports again where the camera looks"
                yield Event(t_us=t_us, level="info", kind="camera", text=text)
            self._reported_us, self._lost_reported = t_us, False
        elif self._reported_us and t_us - self._reported_us > LOST_US and not self._lost_reported:
            self._lost_reported = True
            text = "the gimbal's attitude is no longer known: the camera is taken to look where the mission says"
            yield Event(t_us=t_us, level="warning", kind="camera", text=text)

    def _check_turned(self, t_us: int, reported: bool) -> Iterator[Event]:
        """Events on the direction of a camera that an order has turned."""
        if self._camera is None or self._camera.mount != "stabilized":
            self._turn_reported = True
        elif reported:
            self._turn_reported = True
            text = "an order turned the camera: its direction is what the gimbal reports from now on"
            yield Event(t_us=t_us, level="info", kind="camera", text=text)
        elif t_us - self._turned_us > TURNED_US:
            self._turn_reported = True
            text = "an order turned the camera and no gimbal reports where to: do not act on names"
            yield Event(t_us=t_us, level="alarm", kind="camera", text=text)


def _gimbal(uav: UavAttitude) -> NDArray[np.float64] | None:
    return uav.R_enu_gimbal if uav.attitude_valid else None


def mount_of(camera: Camera | None) -> Mount:
    """Mount of the camera; straight down on a gimbal unless the mission states another mount."""
    if camera is None:
        return Mount(kind="stabilized", roll=0.0, pitch=-np.pi / 2, yaw=0.0)
    roll, pitch, yaw = np.deg2rad([camera.roll_deg, camera.pitch_deg, camera.yaw_deg])
    kind: Literal["fixed", "stabilized"] = "fixed" if camera.mount == "fixed" else "stabilized"
    return Mount(kind=kind, roll=float(roll), pitch=float(pitch), yaw=float(yaw))
