"""The UAV's true path and attitude: follow or hover, drift, climb, turn, the wind's sway and the body's wobble."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d

from sim.world.motion import STEP_S
from sim.world.scenario import ScenarioCamera, ScenarioFlight

FloatArray = NDArray[np.float64]

FOLLOW_SMOOTHING_S = 2.0
"""Standard deviation of the Gaussian that smooths the path of the fleet's middle, which the UAV follows; a choice."""
WOBBLE_STEP_S = 0.005
"""Sampling of the wobble, a tenth of its shortest time constant."""
WOBBLE_IN_YAW = 1.0 / 3.0
"""Share of the wobble about the vertical axis: rotors turn a body less about it; a choice."""
SETTLING = 12.0
"""Time constants after which nothing is left of the state in which the wobble's filter began."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UavTruth:
    """The UAV at one instant or at several (leading shape ...)."""

    p_enu: FloatArray
    """(..., 3) metres."""
    v_enu: FloatArray
    """(..., 3) m/s."""
    yaw: FloatArray
    """(...) clockwise from north; pitch nose up, roll right side down; radians."""
    pitch: FloatArray
    roll: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class UavMotion:
    """The UAV on the time grid t (T,)."""

    t: FloatArray
    values: FloatArray
    """(T, 9) position, velocity, yaw, pitch, roll."""
    wobble: FloatArray
    """(W, 3) yaw, pitch and roll on top, radians, every ``WOBBLE_STEP_S`` from t[0] on; (0, 3) without."""

    def at(self, t: ArrayLike) -> UavTruth:
        """State at times t (...)."""
        t = np.asarray(t, dtype=np.float64)
        v = np.stack([np.interp(t, self.t, column) for column in self.values.T], axis=-1)
        if len(self.wobble):
            fine = self.t[0] + WOBBLE_STEP_S * np.arange(len(self.wobble))
            v[..., 6:] += np.stack([np.interp(t, fine, column) for column in self.wobble.T], axis=-1)
        return UavTruth(p_enu=v[..., :3], v_enu=v[..., 3:6], yaw=v[..., 6], pitch=v[..., 7], roll=v[..., 8])


def fly(
    t: FloatArray,
    filmed_xy: FloatArray,
    flight: ScenarioFlight,
    camera: ScenarioCamera,
    rng: np.random.Generator,
    wobble_rng: np.random.Generator,
) -> UavMotion:
    """Fly so that the filmed ground stays in view.

    Args:
        t: (T,) seconds.
        filmed_xy: (T, n, 2) what is to be filmed, ENU metres.
        camera: for the distance from which an oblique camera films.
    """
    middle = 0.5 * (filmed_xy.min(axis=1) + filmed_xy.max(axis=1))
    if flight.follow:
        target = gaussian_filter1d(middle, FOLLOW_SMOOTHING_S / STEP_S, axis=0, mode="nearest")
    else:
        target = np.broadcast_to(middle[int(np.argmin(np.abs(t)))], middle.shape)
    yaw = np.radians(flight.yaw_deg + flight.yaw_rate_dps * t) + np.radians(flight.yaw_sway_deg) * _sway(t, 1, rng)[0]
    height = np.maximum(flight.height_m + flight.climb_mps * t, 2.0)
    bearing = yaw + np.radians(camera.yaw_deg)
    # the UAV is h / tan |pitch| behind the filmed point, against the direction of view
    standoff = height / np.tan(np.radians(-camera.pitch_deg))
    look = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    drift_bearing = rng.uniform(-np.pi, np.pi)
    drift = flight.drift_mps * t[:, None] * (np.sin(drift_bearing), np.cos(drift_bearing))
    target = target + _roaming(t, flight, rng)
    xy = target - standoff[:, None] * look + drift + flight.sway_m * _sway(t, 2, rng).T
    z = height + 0.2 * flight.sway_m * _sway(t, 1, rng)[0]
    p = np.concatenate([xy, z[:, None]], axis=1)
    v = np.gradient(p, STEP_S, axis=0)
    tilt = np.radians(flight.tilt_sway_deg) * _sway(t, 2, rng, fastest_s=2.0, slowest_s=8.0).T
    values = np.concatenate([p, v, yaw[:, None], tilt], axis=1)
    return UavMotion(t=t, values=values, wobble=_wobble(float(np.ptp(t)), flight, wobble_rng))


def _wobble(duration_s: float, flight: ScenarioFlight, rng: np.random.Generator) -> FloatArray:
    """(W, 3) yaw, pitch, roll, radians: white noise through three equal poles."""
    if flight.wobble_deg == 0.0:
        return np.empty((0, 3))
    from scipy.signal import lfilter  # here: it brings scipy.stats, and few flights wobble

    lead = round(SETTLING * flight.wobble_tau_s / WOBBLE_STEP_S)
    # white noise of power density q through 1 / (1 + iωT)³ has the variance 3 q / 16 T; samples of σ² have q = σ² Δt
    std = np.radians(flight.wobble_deg) * np.sqrt(16.0 * flight.wobble_tau_s / (3.0 * WOBBLE_STEP_S))
    angles = rng.normal(0.0, std, (lead + round(duration_s / WOBBLE_STEP_S) + 1, 3)) * (WOBBLE_IN_YAW, 1.0, 1.0)
    keep = np.exp(-WOBBLE_STEP_S / flight.wobble_tau_s)
    for _ in range(3):
        # x_k = λ x_{k−1} + (1 − λ) u_k,  λ = exp(−Δt/T)
        angles = lfilter([1.0 - keep], [1.0, -keep], angles, axis=0)
    return np.asarray(angles[lead:])


def _roaming(t: FloatArray, flight: ScenarioFlight, rng: np.random.Generator) -> FloatArray:
    """(T, 2) ENU metres: twice as wide across the mean direction of view as along it."""
    if flight.roam_m == 0.0:
        return np.zeros((len(t), 2))
    phase = rng.uniform(0.0, 2.0 * np.pi)
    turns = 2.0 * np.pi * t / flight.roam_s
    across, along = flight.roam_m * np.sin(turns + phase), 0.5 * flight.roam_m * np.sin(1.6 * turns + 2.0 * phase)
    yaw = np.radians(flight.yaw_deg)
    right, ahead = np.array([np.cos(yaw), -np.sin(yaw)]), np.array([np.sin(yaw), np.cos(yaw)])
    return np.asarray(across[:, None] * right + along[:, None] * ahead)


def _sway(
    t: FloatArray, n: int, rng: np.random.Generator, fastest_s: float = 5.0, slowest_s: float = 25.0
) -> FloatArray:
    """(n, T) sums of three waves, of amplitude about 1."""
    periods = rng.uniform(fastest_s, slowest_s, (n, 3, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, (n, 3, 1))
    return np.asarray(np.sin(2.0 * np.pi * t / periods + phases).mean(axis=1) * 1.5)
