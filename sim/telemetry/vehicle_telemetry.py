"""The vehicles' telemetry: real MAVLink 2 packets in order of arrival, with clocks, delays and losses of their own.

Packets are made as they are asked for, so that a long flight needs no more memory than its readings.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.telemetry import messages
from sim.telemetry.messages import BootClock, Stream
from sim.telemetry.sensors import Sensors
from sim.world.scenario import UAV_ID, Scenario
from sim.world.world import World, random_stream

FloatArray = NDArray[np.float64]

TELEMETRY_FROM_S, TELEMETRY_AFTER_S = -2.0, 1.0
"""Telemetry begins before the first frame and ends after the last."""

UAV_POSITION_HZ, GIMBAL_HZ, FIX_HZ, TEXT_HZ = 10.0, 10.0, 2.0, 1.0 / 15.0
"""Rates of the UAV's position and gimbal, and of every vehicle's fix and texts; a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryPacket:
    """One packet as it arrives."""

    t_us: int
    """Arrival, Unix time."""
    raw: bytes
    vehicle: int
    """−1 an aircraft, else the ground vehicle's index."""

    @property
    def system_id(self) -> int:
        """System id of the sender."""
        return self.raw[5]  # magic, length, two flags and the sequence number are before it


def fleet_telemetry(
    world: World, start_us: int | None = None, views: Sequence[World] = ()
) -> Iterator[TelemetryPacket]:
    """All packets of the flight by time of arrival; lost ones are left out, their sequence numbers stay used.

    Args:
        start_us: Unix time of the first frame, in place of the scenario's.
        views: the same with each further camera's aircraft; those on masts send nothing.
    """
    scenario = _begun(world.scenario, start_us)
    sensors = Sensors(world)
    vehicles = [_uav(scenario, sensors), *(_ugv(scenario, sensors, i) for i in range(scenario.fleet_size))]
    ids = (UAV_ID, *scenario.ugv_ids)
    sent = [_sent(scenario, vehicle - 1, ids[vehicle], stream) for vehicle, stream in enumerate(vehicles)]
    for k, view in enumerate(views, 1):
        if scenario.views[k - 1].mast:
            continue
        own = _begun(view.scenario, start_us)
        sent.append(_sent(own, -1, UAV_ID + k, _uav(own, Sensors(view))))
    return heapq.merge(*sent, key=lambda packet: packet.t_us)


def _begun(scenario: Scenario, start_us: int | None) -> Scenario:
    return scenario if start_us is None else dataclasses.replace(scenario, start_us=start_us)


def _sent(scenario: Scenario, vehicle: int, system_id: int, stream: Stream) -> Iterator[TelemetryPacket]:
    rng = random_stream(scenario, f"radio {vehicle}")
    mav = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    last_us = 0
    for t, message in stream:
        raw = bytes(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
        delay = scenario.timing.latency_s + rng.exponential(scenario.timing.jitter_s)
        # one vehicle's packets share a radio and don't overtake each other
        last_us = max(last_us + 1, scenario.start_us + round((t + delay) * 1e6))
        if rng.random() >= scenario.timing.loss:
            yield TelemetryPacket(t_us=last_us, raw=raw, vehicle=vehicle)


def _uav(scenario: Scenario, sensors: Sensors) -> Stream:
    clock = BootClock(scenario, -1)
    streams = _common(scenario, clock, -1)
    t = _times(scenario, UAV_POSITION_HZ, -1, "position")
    reading = sensors.uav(t, "position")
    never = np.zeros(len(t), dtype=bool)
    some = slice(None, None, _every(UAV_POSITION_HZ))
    above_home = -scenario.flight.takeoff_above_m
    hdg = np.full(len(t), np.nan) if scenario.attitude.missing else reading.yaw
    streams += [
        messages.positions(scenario, clock, t, reading.p_enu, reading.v_enu, hdg, never, above_home),
        messages.fixes(scenario, clock, t[some], reading.p_enu[some], reading.v_enu[some], never[some]),
    ]
    if not scenario.attitude.missing:
        t = _times(scenario, scenario.timing.attitude_hz, -1, "attitude")
        reading = sensors.uav(t, "attitude")
        streams.append(messages.attitudes(clock, t, reading.yaw, reading.pitch, reading.roll, reading.rates))
        if scenario.camera.mount == "stabilized" and scenario.attitude.gimbal:
            streams.append(messages.gimbal(scenario, clock, _times(scenario, GIMBAL_HZ, -1, "gimbal")))
    return _merged(streams)


def _ugv(scenario: Scenario, sensors: Sensors, vehicle: int) -> Stream:
    clock = BootClock(scenario, vehicle)
    streams = _common(scenario, clock, vehicle)
    rng = random_stream(scenario, f"rate {vehicle}")
    rate = float(rng.uniform(scenario.timing.rate_min_hz, scenario.timing.rate_max_hz))
    t = _times(scenario, rate, vehicle, "position")
    reading = sensors.ugv(vehicle, t)
    p, v, zeroed, some = reading.p_enu, reading.v_enu, reading.zeroed, slice(None, None, _every(rate))
    hdg = np.full(len(t), np.nan) if scenario.attitude.ugv_heading_missing else reading.heading
    streams += [
        messages.positions(scenario, clock, t, p, v, hdg, zeroed, scenario.gnss.altitude_quirk_m),
        messages.fixes(scenario, clock, t[some], p[some], v[some], zeroed[some]),
    ]
    # a vehicle whose heading is unknown throughout reports none
    if not scenario.attitude.ugv_heading_missing and np.isfinite(reading.heading).all():
        level = np.zeros(len(t))
        rates = np.stack([level, level, reading.yaw_rate], axis=-1)
        streams.append(messages.attitudes(clock, t, reading.heading, level, level, rates))
    return ((now, message) for now, message in _merged(streams) if not sensors.silent(vehicle, now))


def _common(scenario: Scenario, clock: BootClock, vehicle: int) -> list[Stream]:
    return [
        messages.heartbeats(_times(scenario, 1.0, vehicle, "heartbeat"), vehicle),
        messages.system_times(scenario, clock, _times(scenario, 1.0, vehicle, "time")),
        messages.texts(_times(scenario, TEXT_HZ, vehicle, "text")),
    ]


def _merged(streams: list[Stream]) -> Stream:
    return heapq.merge(*streams, key=lambda pair: pair[0])


def _every(rate_hz: float) -> int:
    return max(1, round(rate_hz / FIX_HZ))


def _times(scenario: Scenario, rate_hz: float, vehicle: int, what: str) -> FloatArray:
    """Sample times with a phase of the vehicle's own."""
    phase = random_stream(scenario, f"phase {vehicle} {what}").random()
    count = int((scenario.duration_s + TELEMETRY_AFTER_S - TELEMETRY_FROM_S) * rate_hz)
    beats = np.arange(count) + phase
    if what == "position" and scenario.timing.irregular > 0.0:
        uneven = random_stream(scenario, f"uneven {vehicle}").uniform(-0.5, 0.5, count)
        beats = beats + scenario.timing.irregular * uneven
    return np.asarray(TELEMETRY_FROM_S + beats / rate_hz)
