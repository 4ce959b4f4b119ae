"""What is expected of a camera and of its vehicles' receivers before an update looks: the pose's prior, the noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import Noise
from assoc.hypotheses.pose import PosePrior
from assoc.params import IdentifierParams
from assoc.records import CameraState

__all__ = ["noise_of", "prior_of"]

FloatArray = NDArray[np.float64]

_EXTRA_WHITE_VAR = 0.02
"""Jitter of a box about its vehicle, m², whatever the reports' noise."""


def noise_of(
    q: IdentifierParams,
    camera: CameraState,
    *,
    white_std_m: float,
    bias_std: float,
    tau_s: float,
    in_view_bonus: FloatArray,
) -> Noise:
    """Noise levels as believed now.

    Args:
        q: Numbers of the identifier.
        camera: The newest frame's.
        white_std_m: 1σ of the reports' white noise, metres.
        bias_std: 1σ per axis of the reports' wandering bias, metres.
        tau_s: Its correlation time.
        in_view_bonus: (n,) see :class:`Noise`.
    """
    height = max(float(camera.p_enu[2]) - camera.ground_z, 1.0)
    area = float(np.clip(2.0 * height**2, 50.0, 5e4))
    return Noise(
        white_var=white_std_m**2 + _EXTRA_WHITE_VAR,
        bias_std=bias_std,
        decay=float(np.exp(-q.block_s / tau_s)),
        floor_var=q.mean_floor_m**2,
        pixel_var=q.pixel_std**2,
        log_area=float(np.log(2.0 * area)),
        increment_max=q.increment_max,
        in_view_bonus=in_view_bonus,
    )


def prior_of(q: IdentifierParams, camera: CameraState, offset_std_s: float) -> PosePrior:
    """Prior of θ for this camera; without attitude all headings are possible. ``offset_std_s``: 1σ of δ."""
    free = not camera.attitude_known
    tilt = np.deg2rad(5.0 if free and not camera.stabilized else q.tilt_std_deg)
    yaw, rate = (np.pi, np.deg2rad(3.0)) if free else (np.deg2rad(q.yaw_std_deg), np.deg2rad(q.yaw_rate_std_deg_s))
    level = q.position_std_m if camera.position_known else 30.0
    return PosePrior(std=np.array([yaw, rate, tilt, tilt, level, level, q.height_std_m, offset_std_s], np.float64))
