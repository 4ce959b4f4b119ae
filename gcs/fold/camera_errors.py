"""What the identifier found wrong with the camera's clock and pose, as the program's health tells it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from assoc.geometry.ground import OFFSET, PITCH, YAW
from assoc.identification.identifier import Identifier
from gcs.snapshot import Health

__all__ = ["with_camera_errors"]


def with_camera_errors(health: Health, identifier: Identifier, offset_s: float) -> Health:
    """Health with the estimated errors of the camera's clock, heading and pitch, and whether it is mirrored.

    Args:
        health: How the program is doing.
        identifier: Knows the errors.
        offset_s: By how much the mission declares the video's clock to be ahead of telemetry's.
    """
    theta, std = identifier.pose_correction, identifier.pose_correction_std
    return replace(
        health,
        time_offset_s=offset_s + float(theta[OFFSET]),
        time_offset_std_s=float(std[OFFSET]),
        yaw_offset=float(theta[YAW]) if np.isfinite(std[YAW]) else math.nan,
        yaw_offset_std=float(std[YAW]),
        pitch_offset=float(theta[PITCH]),
        pitch_offset_std=float(std[PITCH]),
        mirrored=identifier.mirrored,
        fit=identifier.fit_probability,
    )
