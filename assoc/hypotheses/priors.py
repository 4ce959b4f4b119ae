"""Priors of an update: the prior of the camera's pose and the noise of the vehicles' reports."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.likelihood import PLACE_TAU_S, Noise
from assoc.geometry.ground import HEIGHT, LAG, OFFSET, PITCH, THETA, YAW
from assoc.hypotheses.pose import PosePrior
from assoc.params import IdentifierParams
from assoc.records import CameraState

FloatArray = NDArray[np.float64]

_EXTRA_WHITE_VAR = 0.01
"""Jitter of a box about its vehicle, m², whatever the reports' noise."""
_FREE_TILT_STD_DEG, _FREE_YAW_RATE_STD_DEG_S, _FREE_POSITION_STD_M = 5.0, 3.0, 30.0
"""Prior 1σ where nothing is reported: tilt of a camera fixed to the body, drift of the heading, horizontal position."""

_GROSS: tuple[tuple[int, FloatArray, float, float], ...] = (
    (YAW, np.deg2rad([90.0, 180.0, -90.0]), float(np.deg2rad(12.0)), 2e-3),
    (PITCH, np.deg2rad([15.0, -15.0]), float(np.deg2rad(5.0)), 1e-3),
    (OFFSET, np.array([0.4, -0.4]), 0.2, 1e-2),
    (OFFSET, np.array([1.0, 2.0, 3.0, 4.0, 5.0, -1.0, -2.0, -3.0, -4.0, -5.0]), 0.4, 1e-3),
    (LAG, np.array([0.6, 1.2]), 0.3, 1e-2),
)
"""Gross errors: which number of θ, about which means, with which 1σ, and the weight of each in the prior: cameras
mounted turned, a gimbal's angle that is not reported, video that is late or dated by another clock, positions that are
older than they say."""
_LAG_STD_S = 0.12
"""Prior 1σ of the age of the UAV's positions beyond their time stamps, seconds: a receiver takes a tenth, of which
autopilots take out most."""
_MIN_FLIGHT_MPS = 2.0
"""Speed of a flight below which no age of a position matters, m/s."""

_OTHER_HEIGHT_STD_M, _OTHER_HEIGHT_SHARE = 6.0, 0.3
"""1σ of the height that another source gives, metres, and its weight in the prior: they are nearly on a par."""
_HILLS_M, _HILL_SHARE = (0.0, 12.0, -12.0, 24.0, -24.0), 0.01
"""Amounts by which that source may be off too, metres, and the weight of each but the first."""


def noise_of(
    q: IdentifierParams,
    camera: CameraState,
    *,
    white_std_m: float,
    bias_std: float,
    tau_s: float,
    in_view_bonus: FloatArray,
    by_place: bool = False,
) -> Noise:
    """Noise levels as estimated now.

    Args:
        q: Numbers of the identifier.
        camera: The newest frame's.
        white_std_m: 1σ of the reports' white noise, metres.
        bias_std: 1σ per axis of the reports' wandering bias, metres.
        tau_s: Its correlation time.
        in_view_bonus: (n,) see :class:`Noise`.
        by_place: The size of residuals alone counts, not their course.
    """
    decay = float(np.exp(-q.block_s / tau_s))
    # a bias wanders within a block, too: by λ from end to end, about its mean by a sixth of the variance of that
    wander_var = 0.0 if by_place else (1.0 - decay**2) * bias_std**2 / 6.0
    return Noise(
        white_var=white_std_m**2 + _EXTRA_WHITE_VAR + wander_var,
        bias_std=bias_std,
        decay=decay,
        floor_var=q.mean_floor_m**2,
        pixel_var=q.pixel_std**2,
        height=float(camera.p_enu[2]) - camera.ground_z,
        increment_max=q.increment_max,
        in_view_bonus=in_view_bonus,
        bears_each=not camera.attitude_known,
        place_rate=q.block_s / PLACE_TAU_S if by_place else 0.0,
    )


def prior_of(q: IdentifierParams, camera: CameraState, offset_std_s: float, speed_mps: float) -> PosePrior:
    """Prior of θ for a camera; without attitude all headings are possible.

    Args:
        q: Numbers of the identifier.
        camera: The newest frame's.
        offset_std_s: 1σ of δ, seconds.
        speed_mps: The most that the camera flew at in the window, m/s.
    """
    free = not camera.attitude_known
    tilt = np.deg2rad(_FREE_TILT_STD_DEG if free and not camera.stabilized else q.tilt_std_deg)
    yaw, rate = (
        (np.pi, np.deg2rad(_FREE_YAW_RATE_STD_DEG_S))
        if free
        else (np.deg2rad(q.yaw_std_deg), np.deg2rad(q.yaw_rate_std_deg_s))
    )
    level = _FREE_POSITION_STD_M
    if camera.position_known:
        level = camera.position_std_m if np.isfinite(camera.position_std_m) else q.position_std_m
    height = camera.height_std_m if np.isfinite(camera.height_std_m) else q.height_std_m
    std = np.array([yaw, rate, tilt, tilt, level, level, height, offset_std_s, _LAG_STD_S], np.float64)
    # along a road an offset of seconds is a shift, and what does not fit of it would be taken for a sway
    sways = free and not camera.stabilized
    others = [] if sways else list(_gross_errors(std, attitude_known=not free, flies=speed_mps > _MIN_FLIGHT_MPS))
    return PosePrior(std=std, others=(*_other_heights(std, camera.other_heights_m), *others))


def _other_heights(std: FloatArray, heights_m: tuple[float, ...]) -> Iterator[PosePrior]:
    """The parts in which another source of the camera's height is right; or none is, as where it took off on a hill."""
    for height_m in heights_m:
        for off_m in _HILLS_M:
            mean, wider = np.zeros(THETA), std.copy()
            mean[HEIGHT], wider[HEIGHT] = height_m + off_m, _OTHER_HEIGHT_STD_M
            share = _HILL_SHARE if off_m else _OTHER_HEIGHT_SHARE
            yield PosePrior(std=wider, mean=mean, log_share=float(np.log(share)), at_once=not off_m)


def _gross_errors(std: FloatArray, *, attitude_known: bool, flies: bool) -> Iterator[PosePrior]:
    """The rare parts of the prior: one quantity is far off, the others err as usual."""
    for index, means, wide, share in _GROSS:
        known = flies if index == LAG else attitude_known or index == OFFSET
        if std[index] < wide and known:
            for mean in means:
                off, wider = np.zeros(THETA), std.copy()
                off[index], wider[index] = mean, wide
                yield PosePrior(std=wider, mean=off, log_share=float(np.log(share)))


class OffsetPrior:
    """The prior of the clock offset, which is widened once the estimate has long been outside it."""

    def __init__(self, params: IdentifierParams) -> None:
        self._params = params
        self.std_s = params.time_offset_std_s
        """1σ."""
        self._tense_since_s = np.inf

    def update(self, t: float, offset_s: float, *, locked: bool) -> None:
        """Take in the estimate at time t, and whether the search is locked."""
        q = self._params.learning
        tense = locked and abs(offset_s) > q.offset_tension * self._params.time_offset_std_s
        self._tense_since_s = min(self._tense_since_s, t) if tense else np.inf
        if t - self._tense_since_s > q.offset_tension_s:
            self.std_s = max(self.std_s, self._params.unknown_offset_std_s)
