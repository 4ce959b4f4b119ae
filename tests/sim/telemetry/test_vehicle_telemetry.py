import dataclasses
import itertools
from collections import Counter

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.telemetry.vehicle_telemetry import fleet_telemetry
from sim.world.camera import body_rotation
from sim.world.presets import nominal
from sim.world.scenario import Gnss, ScenarioAttitude, ScenarioCamera, ScenarioFault, ScenarioFlight, ScenarioTiming
from sim.world.world import World

CLEAN = Gnss(white_m=0.0, bias_m=0.0, uav_white_m=0.0, uav_bias_m=0.0)
ORIGIN = (48.1, 11.6)


def flight(**knobs):
    return World(dataclasses.replace(nominal(), duration_s=6.0, **knobs))


def parsed(world):
    """(packet, message) of every packet, parsed as any receiver would."""
    parser = dialect.MAVLink(None)
    out = []
    for packet in fleet_telemetry(world):
        messages = parser.parse_buffer(packet.raw)
        assert len(messages) == 1
        out.append((packet, messages[0]))
    return out


def of(pairs, kind, system_id):
    return [(p, m) for p, m in pairs if m.get_type() == kind and m.get_srcSystem() == system_id]


def metres(lat, lon):
    """East and north of the origin, by the radii of curvature."""
    phi = np.radians(ORIGIN[0])
    w = 1.0 - 0.00669437999014 * np.sin(phi) ** 2
    north = 6378137.0 * (1.0 - 0.00669437999014) / w**1.5 + 550.0
    east = (6378137.0 / np.sqrt(w) + 550.0) * np.cos(phi)
    return np.radians(lon - ORIGIN[1]) * east, np.radians(lat - ORIGIN[0]) * north


def test_what_is_said_and_how_often():
    pairs = parsed(flight())
    counts = Counter((m.get_srcSystem(), m.get_type()) for _, m in pairs)
    seconds = 9.0  # two before the first frame and one after the last
    assert counts[1, "HEARTBEAT"] == counts[11, "HEARTBEAT"] == seconds
    assert counts[1, "SYSTEM_TIME"] == counts[17, "SYSTEM_TIME"] == seconds
    assert counts[1, "ATTITUDE"] == 20 * seconds
    assert counts[1, "GLOBAL_POSITION_INT"] == 10 * seconds
    assert counts[1, "GIMBAL_DEVICE_ATTITUDE_STATUS"] == 10 * seconds
    assert counts[11, "GLOBAL_POSITION_INT"] == counts[17, "GLOBAL_POSITION_INT"] == 5 * seconds
    assert 1.5 * seconds < counts[11, "GPS_RAW_INT"] < 3 * seconds
    assert {s for s, _ in counts} == {1, *range(11, 18)}
    assert all(p.raw[0] == 0xFD for p, _ in pairs)


def test_arrivals_are_in_order_and_sequences_without_gaps():
    pairs = parsed(flight())
    assert all(a.t_us <= b.t_us for (a, _), (b, _) in itertools.pairwise(pairs))
    for system_id in (1, 13):
        seqs = [m.get_seq() for _, m in pairs if m.get_srcSystem() == system_id]
        assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(seqs))


def test_positions_are_those_of_the_world():
    world = flight(
        gnss=CLEAN,
        attitude=ScenarioAttitude(ugv_heading_noise_deg=0.0, ugv_heading_bias_deg=0.0, noise_deg=0.0),
        timing=ScenarioTiming(latency_s=0.0, jitter_s=0.0),
    )
    pairs, start = parsed(world), world.scenario.start_us
    for vehicle in (0, 5):
        for packet, m in of(pairs, "GLOBAL_POSITION_INT", 11 + vehicle):
            truth = world.at((packet.t_us - start) / 1e6)
            np.testing.assert_allclose(metres(m.lat / 1e7, m.lon / 1e7), truth.xy[vehicle], atol=0.02)
            np.testing.assert_allclose([m.vy / 100, m.vx / 100], truth.v_enu[vehicle, :2], atol=0.08)
            turn = np.radians(m.hdg / 100) - truth.heading[vehicle]
            assert np.cos(turn) > np.cos(np.radians(0.6))
            assert (m.alt, m.relative_alt) == (pytest.approx(550_000, abs=2), 0)
    for packet, m in of(pairs, "GLOBAL_POSITION_INT", 1):
        truth = world.at((packet.t_us - start) / 1e6).uav
        np.testing.assert_allclose(metres(m.lat / 1e7, m.lon / 1e7), truth.p_enu[:2], atol=0.02)
        assert m.relative_alt / 1e3 == pytest.approx(truth.p_enu[2], abs=0.02)
    for packet, m in of(pairs, "ATTITUDE", 1):
        truth = world.at((packet.t_us - start) / 1e6).uav
        np.testing.assert_allclose([m.roll, m.pitch, m.yaw], [truth.roll, truth.pitch, truth.yaw], atol=1e-4)


def test_the_gimbals_quaternion_points_the_camera():
    pairs = parsed(flight(camera=ScenarioCamera(pitch_deg=-45.0, yaw_deg=20.0)))
    q = of(pairs, "GIMBAL_DEVICE_ATTITUDE_STATUS", 1)[0][1].q
    w, x, y, z = q
    forward = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    np.testing.assert_allclose(forward, body_rotation(np.radians(20), np.radians(-45), 0) @ [1, 0, 0], atol=1e-6)
    assert of(pairs, "GIMBAL_DEVICE_ATTITUDE_STATUS", 1)[0][1].flags & dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME


def test_boot_clocks_differ_and_drift_within_bounds():
    pairs = parsed(flight(timing=ScenarioTiming(latency_s=0.0, jitter_s=0.0, clock_ppm=150.0)))
    zeros = set()
    for system_id in (1, 11, 12, 13):
        rows = [(p.t_us / 1e6, m.time_boot_ms / 1e3) for p, m in of(pairs, "GLOBAL_POSITION_INT", system_id)]
        t, boot = np.array(rows).T
        assert abs((boot[-1] - boot[0]) / (t[-1] - t[0]) - 1.0) < 150e-6 + 2e-3 / 8.0
        zeros.add(round(t[0] - boot[0]))
    assert len(zeros) == 4


def test_latency_jitter_loss_and_rates():
    world = flight(timing=ScenarioTiming(latency_s=0.1, jitter_s=0.05, loss=0.2, rate_min_hz=1.0, rate_max_hz=10.0))
    pairs = parsed(world)
    seqs = [m.get_seq() for _, m in pairs if m.get_srcSystem() == 1]
    gaps = sum((b - a) % 256 - 1 for a, b in itertools.pairwise(seqs))
    assert gaps / (gaps + len(seqs)) == pytest.approx(0.2, abs=0.06)
    rates = [len(of(pairs, "GLOBAL_POSITION_INT", i)) / 9.0 / 0.8 for i in range(11, 18)]
    assert max(rates) - min(rates) > 1.0
    assert all(0.7 < rate < 11.5 for rate in rates)
    delay = []
    quick = flight(timing=ScenarioTiming(latency_s=0.0, jitter_s=0.0, rate_min_hz=1.0, rate_max_hz=10.0))
    on_time = {m.time_boot_ms: p.t_us for p, m in of(parsed(quick), "ATTITUDE", 1)}
    delay = [(p.t_us - on_time[m.time_boot_ms]) / 1e6 for p, m in of(pairs, "ATTITUDE", 1)]
    assert min(delay) == pytest.approx(0.1, abs=0.01)
    assert np.mean(delay) > 0.14


def test_unknown_attitude_and_heading_are_left_out():
    pairs = parsed(flight(attitude=ScenarioAttitude(missing=True, ugv_heading_missing=True)))
    types = {m.get_type() for _, m in pairs}
    assert "ATTITUDE" not in types
    assert "GIMBAL_DEVICE_ATTITUDE_STATUS" not in types
    assert {m.hdg for _, m in pairs if m.get_type() == "GLOBAL_POSITION_INT"} == {65535}


def test_faults_reach_the_air():
    faults = (ScenarioFault(vehicle=0, kind="silent", start_s=2.0), ScenarioFault(vehicle=1, kind="zero", start_s=2.0))
    world = flight(faults=faults, gnss=Gnss(altitude_quirk_m=550.0))
    pairs, turn_us = parsed(world), world.scenario.start_us + 2_200_000
    assert max(p.t_us for p, m in pairs if m.get_srcSystem() == 11) < turn_us
    late = [m for p, m in of(pairs, "GLOBAL_POSITION_INT", 12) if p.t_us > turn_us]
    assert late
    assert all((m.lat, m.lon) == (0, 0) for m in late)
    assert all(m.fix_type == 1 for p, m in of(pairs, "GPS_RAW_INT", 12) if p.t_us > turn_us)
    assert of(pairs, "GLOBAL_POSITION_INT", 13)[0][1].relative_alt == 550_000


def test_the_unix_time_of_a_live_play_replaces_the_scenarios():
    world = flight()
    first = next(fleet_telemetry(world, start_us=1_900_000_000_000_000))
    assert abs(first.t_us - 1_899_999_998_000_000) < 1_000_000


def test_the_uavs_altitude_counts_from_where_it_took_off():
    pairs = parsed(flight(gnss=CLEAN, flight=ScenarioFlight(height_m=45.0, sway_m=0.0, takeoff_above_m=-20.0)))
    uav, rover = (of(pairs, "GLOBAL_POSITION_INT", i)[0][1] for i in (1, 11))
    assert uav.relative_alt == pytest.approx(65_000, abs=2)
    # above the vehicles, by what both report, it is where it is
    assert uav.alt - rover.alt == pytest.approx(45_000, abs=5)


def test_attitude_comes_at_its_rate_and_positions_unevenly_if_asked():
    pairs = parsed(flight(timing=ScenarioTiming(attitude_hz=4.0, irregular=0.8)))
    assert len(of(pairs, "ATTITUDE", 1)) == 4 * 9
    gaps = np.diff([m.time_boot_ms for _, m in of(pairs, "GLOBAL_POSITION_INT", 12)])
    assert gaps.min() < 0.7 * 200.0 < 1.3 * 200.0 < gaps.max()
    assert gaps.min() > 0.0
