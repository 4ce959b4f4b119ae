"""Sensors of the vehicles: GNSS, compass, attitude, with errors that last and errors that don't."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.flight import WOBBLE_STEP_S
from sim.world.scenario import Gnss, ScenarioFault
from sim.world.world import LEAD_S, TAIL_S, World, random_stream

FloatArray = NDArray[np.float64]

BIAS_STEP_S = 0.1
"""Sampling of the position's bias, far below its correlation time."""
RATE_STEP_S = 0.05
"""Half the span of the central difference that gives rates; the true motion without wobble is smooth over it."""
WANDER_TAU_S = 30.0
"""Correlation time of the slow errors of attitude, as of a filter that weighs gyroscopes against the horizon."""
FILTER_S = 0.6
"""Time constant with which an autopilot's filter follows its receiver."""
OUTLIER_SHARE, OUTLIER_FACTOR = 1.0 / 25.0, 5.0
"""Share of reports that are outliers, and how much wider they scatter; a choice after urban GNSS."""


def lasting_error(gnss: Gnss, steps: int, shape: tuple[int, ...], dt_s: float, rng: np.random.Generator) -> FloatArray:
    """(steps, *shape) metres, every ``dt_s``: the slowly varying error, of the kind that the scenario asks for."""
    if gnss.bias_kind == "gauss-markov":
        return gauss_markov(steps, shape, gnss.bias_m, gnss.tau_s, dt_s, rng)
    if gnss.bias_kind == "filtered":
        return _smoothed(gauss_markov(steps, shape, gnss.bias_m, gnss.tau_s, dt_s, rng), dt_s)
    start = rng.normal(0.0, gnss.bias_m, shape)
    if gnss.bias_kind == "walk":
        # b_{k+1} = b_k + σ √(Δt/τ) w
        moves = rng.normal(0.0, gnss.bias_m * np.sqrt(dt_s / gnss.tau_s), (steps, *shape))
        return np.asarray(start + np.cumsum(moves, axis=0))
    if gnss.bias_kind == "sine":
        # b = √2 σ sin(2π t/τ' + φ),  τ' within a third of τ
        period, phase = gnss.tau_s * rng.uniform(0.75, 1.33, shape), rng.uniform(0.0, 2.0 * np.pi, shape)
        t = dt_s * np.arange(steps).reshape(-1, *(1 for _ in shape))
        return np.asarray(np.sqrt(2.0) * gnss.bias_m * np.sin(2.0 * np.pi * t / period + phase))
    fresh = rng.normal(0.0, gnss.bias_m, (steps, *shape))
    fresh[0] = start
    # all axes of a vehicle step at once
    changes = rng.random((steps, *shape[:-1], 1)) < dt_s / gnss.tau_s
    changes[0] = True
    last = np.maximum.accumulate(np.where(changes, np.arange(steps).reshape(-1, *(1 for _ in shape)), 0), axis=0)
    return np.take_along_axis(fresh, np.broadcast_to(last, fresh.shape), axis=0)


def _smoothed(values: FloatArray, dt_s: float) -> FloatArray:
    """Values (steps, ...) through two poles, each of the time constant of an autopilot's position filter."""
    keep = np.exp(-dt_s / FILTER_S)
    for _ in range(2):
        for k in range(1, len(values)):
            values[k] = keep * values[k - 1] + (1.0 - keep) * values[k]
    return values


def report_noise(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """Noise (k, n) of unit scale, each row of one report: normal, Laplace of variance 1, or normal with outliers."""
    noise = rng.normal(0.0, 1.0, shape)
    if kind == "laplace":
        # x = √E z with E exponential of mean 1 has Laplace's density of variance 1
        return np.asarray(noise * np.sqrt(rng.exponential(1.0, shape)))
    if kind == "outliers":
        return np.asarray(noise * np.where(rng.random((shape[0], 1)) < OUTLIER_SHARE, OUTLIER_FACTOR, 1.0))
    return noise


def gauss_markov(
    steps: int, shape: tuple[int, ...], std: float, tau_s: float, dt_s: float, rng: np.random.Generator
) -> FloatArray:
    """(steps, *shape) first-order Gauss–Markov processes in their steady state."""
    # b_{k+1} = λ b_k + σ √(1 − λ²) w,  λ = exp(−Δt/τ)
    keep = np.exp(-dt_s / tau_s)
    draws = rng.normal(0.0, std, (steps, *shape))
    values = np.empty_like(draws)
    values[0] = draws[0]
    for k in range(1, steps):
        values[k] = keep * values[k - 1] + np.sqrt(1.0 - keep * keep) * draws[k]
    return values


@dataclass(frozen=True, slots=True, kw_only=True)
class UgvReading:
    """Readings of one ground vehicle's sensors at k sample times."""

    p_enu: FloatArray
    """(k, 3)."""
    v_enu: FloatArray
    """(k, 3)."""
    heading: FloatArray
    """(k,) radians clockwise from north."""
    yaw_rate: FloatArray
    """(k,) rad/s."""
    zeroed: NDArray[np.bool_]
    """(k,) True where the vehicle reports latitude and longitude 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UavReading:
    """Readings of the UAV's sensors at k sample times."""

    p_enu: FloatArray
    """(k, 3)."""
    v_enu: FloatArray
    """(k, 3)."""
    yaw: FloatArray
    """(k,) radians clockwise from north; pitch nose up, roll right side down."""
    pitch: FloatArray
    roll: FloatArray
    rates: FloatArray
    """(k, 3) of its gyroscopes: about the roll, pitch and yaw axes of the body, rad/s."""


class Sensors:
    """The errors of one flight, drawn once; readings at any times."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.scenario = scenario = world.scenario
        rng = random_stream(scenario, "sensors")
        self._t = np.arange(-LEAD_S, scenario.duration_s + TAIL_S + BIAS_STEP_S, BIAS_STEP_S)
        n = scenario.fleet_size
        self._bias = lasting_error(scenario.gnss, len(self._t), (n, 2), BIAS_STEP_S, rng)
        self._bias += self._steps(n)
        self._heading_bias = rng.normal(0.0, np.radians(scenario.attitude.ugv_heading_bias_deg), n)
        bearing = rng.uniform(-np.pi, np.pi)
        self._uav_bias = scenario.gnss.uav_bias_m * np.array([np.sin(bearing), np.cos(bearing)])
        wander = (np.radians(scenario.attitude.wander_deg), WANDER_TAU_S, BIAS_STEP_S)
        self._wander = gauss_markov(len(self._t), (3,), *wander, random_stream(scenario, "wander"))
        self._altitude_bias = random_stream(scenario, "altitudes").normal(0.0, scenario.gnss.altitude_bias_m, n)

    def ugv(self, vehicle: int, t: FloatArray) -> UgvReading:
        """Readings of one ground vehicle at times t (k,), faults included."""
        reading = self._measured(vehicle, t)
        for fault in self._faults(vehicle):
            if fault.kind == "copy":
                active = (t >= fault.start_s) & (t < fault.stop_s)
                reading = _instead(reading, self._measured(fault.other, t - fault.size), active)
        return reading

    def _measured(self, vehicle: int, t: FloatArray) -> UgvReading:
        rng = random_stream(self.scenario, f"gnss {vehicle}")
        seen = _faulty_time(t, self._faults(vehicle))
        p, v, heading = self._claimed(vehicle, t, seen)
        bias = np.stack([np.interp(seen, self._t, self._bias[:, vehicle, axis]) for axis in (0, 1)], axis=-1)
        gnss = self.scenario.gnss
        noise = _held(report_noise(gnss.white_kind, (len(t), 3), rng), seen)
        xy = p[:, :2] + bias + gnss.white_m * noise[:, :2] + self._shift(vehicle, t, rng)
        rng = random_stream(self.scenario, f"altitude {vehicle}")
        above = (
            self._altitude_bias[vehicle]
            + gnss.altitude_datum_m
            + gnss.altitude_white_m * _held(rng.normal(0.0, 1.0, (len(t), 1)), seen)
        )
        spread = np.radians(self.scenario.attitude.ugv_heading_noise_deg)
        return UgvReading(
            p_enu=np.concatenate([xy, p[:, 2:] + above], axis=1),
            v_enu=v,
            heading=heading + self._heading_bias[vehicle] + spread * noise[:, 2],
            yaw_rate=self._yaw_rate(vehicle, seen),
            zeroed=_during(t, self._faults(vehicle), "zero"),
        )

    def uav(self, t: FloatArray, what: str) -> UavReading:
        """Readings of the UAV at times t (k,); each purpose has noise of its own."""
        rng = random_stream(self.scenario, f"uav {what}")
        scenario, truth = self.scenario, self.world.at_uav(t)
        before = self.world.at_uav(t - scenario.timing.uav_lag_s)
        noise = rng.normal(0.0, 1.0, (len(t), 6))
        p = before.p_enu + scenario.gnss.uav_white_m * noise[:, :3] * (1.0, 1.0, 0.5)
        p = p + np.append(self._uav_bias, scenario.gnss.height_bias_m)
        fixed = scenario.camera.mount == "fixed"
        tilt = np.radians([scenario.attitude.tilt_pitch_deg, scenario.attitude.tilt_roll_deg]) * fixed
        spread = np.radians(scenario.attitude.noise_deg)
        slow = np.stack([np.interp(t, self._t, column) for column in self._wander.T])
        return UavReading(
            p_enu=p,
            v_enu=before.v_enu,
            yaw=truth.yaw + np.radians(scenario.attitude.compass_bias_deg) + spread * noise[:, 3] + slow[0],
            pitch=truth.pitch + tilt[0] + 0.3 * spread * noise[:, 4] + slow[1],
            roll=truth.roll + tilt[1] + 0.3 * spread * noise[:, 5] + slow[2],
            rates=self._body_rates(t) * scenario.attitude.rates,
        )

    def _body_rates(self, t: FloatArray) -> FloatArray:
        step = WOBBLE_STEP_S if self.scenario.flight.wobble_deg > 0.0 else RATE_STEP_S
        now, before, after = (self.world.at_uav(t + dt) for dt in (0.0, -step, step))
        roll, pitch, yaw = (
            (getattr(after, name) - getattr(before, name)) / (2.0 * step) for name in ("roll", "pitch", "yaw")
        )
        # p = φ' − ψ' sin θ,  q = θ' cos φ + ψ' sin φ cos θ,  r = ψ' cos φ cos θ − θ' sin φ
        p = roll - yaw * np.sin(now.pitch)
        q = pitch * np.cos(now.roll) + yaw * np.sin(now.roll) * np.cos(now.pitch)
        r = yaw * np.cos(now.roll) * np.cos(now.pitch) - pitch * np.sin(now.roll)
        return np.stack([p, q, r], axis=-1)

    def silent(self, vehicle: int, t: float) -> bool:
        """True while a fault keeps the vehicle off the air."""
        return any(f.kind == "silent" and f.start_s <= t < f.stop_s for f in self._faults(vehicle))

    def _claimed(self, vehicle: int, t: FloatArray, seen: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The position that is reported: the vehicle's own at the times ``seen``, or that of another one."""
        p, v, heading = self.world.track_enu(vehicle, seen)
        for fault in self._faults(vehicle):
            if fault.kind == "spoof":
                active = (t >= fault.start_s) & (t < fault.stop_s)
                p_other, v_other, heading_other = self.world.track_enu(fault.other, t - fault.size)
                p, v = np.where(active[:, None], p_other, p), np.where(active[:, None], v_other, v)
                heading = np.where(active, heading_other, heading)
        return p, v, heading

    def _yaw_rate(self, vehicle: int, t: FloatArray) -> FloatArray:
        before, after = (self.world.track_of(vehicle, t + dt)[2] for dt in (-RATE_STEP_S, RATE_STEP_S))
        return np.asarray((after - before) / (2.0 * RATE_STEP_S))

    def _steps(self, n: int) -> FloatArray:
        """(T, n, 2) offsets that change with the satellites in use; none before the first change."""
        gnss, rng = self.scenario.gnss, random_stream(self.scenario, "steps")
        offset = np.zeros((len(self._t), n, 2))
        if gnss.steps_per_min == 0.0:
            return offset
        for vehicle in range(n):
            count = rng.poisson(gnss.steps_per_min * (self._t[-1] - self._t[0]) / 60.0)
            for start in np.sort(rng.uniform(self._t[0], self._t[-1], count)):
                offset[self._t >= start, vehicle] = rng.normal(0.0, gnss.step_m, 2)
        return offset

    def _faults(self, vehicle: int) -> tuple[ScenarioFault, ...]:
        return tuple(fault for fault in self.scenario.faults if fault.vehicle == vehicle)

    def _shift(self, vehicle: int, t: FloatArray, rng: np.random.Generator) -> FloatArray:
        shift = np.zeros((len(t), 2))
        for fault in self._faults(vehicle):
            bearing = rng.uniform(-np.pi, np.pi)
            toward = np.array([np.sin(bearing), np.cos(bearing)])
            active = (t >= fault.start_s) & (t < fault.stop_s)
            if fault.kind == "jump":
                shift += active[:, None] * (fault.size or 15.0) * toward
            elif fault.kind == "drift":
                shift += (active * (t - fault.start_s))[:, None] * (fault.size or 0.5) * toward
        return shift


def _instead(reading: UgvReading, other: UgvReading, where: NDArray[np.bool_]) -> UgvReading:
    """Return the other reading where asked (k,), the first elsewhere."""
    return UgvReading(
        p_enu=np.where(where[:, None], other.p_enu, reading.p_enu),
        v_enu=np.where(where[:, None], other.v_enu, reading.v_enu),
        heading=np.where(where, other.heading, reading.heading),
        yaw_rate=np.where(where, other.yaw_rate, reading.yaw_rate),
        zeroed=np.where(where, other.zeroed, reading.zeroed),
    )


def _faulty_time(t: FloatArray, faults: tuple[ScenarioFault, ...]) -> FloatArray:
    """The time that a report at time t is about: earlier when it lags, constant when it is frozen."""
    seen = t.copy()
    for fault in faults:
        active = (t >= fault.start_s) & (t < fault.stop_s)
        if fault.kind == "lag":
            seen = np.where(active, t - (fault.size or 3.0), seen)
        elif fault.kind == "frozen":
            seen = np.where(active, fault.start_s, seen)
    return seen


def _held(noise: FloatArray, seen: FloatArray) -> FloatArray:
    """Noise rows repeated where the reported time does not advance: a frozen position is frozen to the bit."""
    first = np.concatenate([[True], np.diff(seen) != 0.0])
    return np.asarray(noise[np.maximum.accumulate(np.where(first, np.arange(len(seen)), 0))])


def _during(t: FloatArray, faults: tuple[ScenarioFault, ...], kind: str) -> NDArray[np.bool_]:
    active = np.zeros(len(t), dtype=bool)
    for fault in faults:
        active |= (fault.kind == kind) & (t >= fault.start_s) & (t < fault.stop_s)
    return active
