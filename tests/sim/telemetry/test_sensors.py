import dataclasses

import numpy as np
import pytest

from sim.telemetry.detections import DetectorModel
from sim.telemetry.sensors import Sensors, gauss_markov, lasting_error, report_noise
from sim.world.boxes import true_boxes
from sim.world.earth import to_geodetic
from sim.world.motion import wrapped
from sim.world.presets import nominal
from sim.world.scenario import (
    Blackout,
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)
from sim.world.world import World

pytestmark = pytest.mark.usefixtures("moved_once")

T = np.arange(0.0, 20.0, 0.2)


def flight(**knobs):
    return Sensors(World(dataclasses.replace(nominal(3), duration_s=20.0, **knobs)))


def errors_of(sensors, vehicle, t=T):
    return sensors.ugv(vehicle, t).p_enu[:, :2] - sensors.world.track_of(vehicle, t)[0]


def test_gauss_markov_has_its_deviation_and_its_correlation_time():
    b = gauss_markov(600, (4000,), 2.0, 10.0, 0.1, np.random.default_rng(1))
    assert b[0].std() == pytest.approx(2.0, rel=0.05)
    assert b[-1].std() == pytest.approx(2.0, rel=0.05)
    for lag in (50, 100, 200):
        # autocorrelation e^(−Δt/τ)
        assert np.mean(b[:-lag] * b[lag:]) / 4.0 == pytest.approx(np.exp(-lag * 0.1 / 10.0), abs=0.03)


def test_white_noise_alone_has_its_deviation_and_no_memory():
    sensors = flight(gnss=Gnss(white_m=0.8, bias_m=0.0))
    e = np.stack([errors_of(sensors, i) for i in range(7)])
    assert e.std() == pytest.approx(0.8, rel=0.06)
    assert abs(np.mean(e[:, 1:] * e[:, :-1])) / 0.64 < 0.06


@pytest.mark.slow
def test_a_wandering_bias_is_slow_and_differs_between_vehicles():
    e = np.stack([errors_of(flight(gnss=Gnss(white_m=0.0, bias_m=1.0, tau_s=60.0)), i) for i in range(7)])
    steps = np.diff(e, axis=1)
    # a step of 0.2 s has σ √(2 (1 − e^(−Δt/τ))) on average, less between the samples of the bias
    assert steps.std() == pytest.approx(np.sqrt(2 * (1 - np.exp(-0.2 / 60))), rel=0.15)
    assert np.ptp(e.mean(axis=1), axis=0).min() > 0.3


def test_the_uavs_errors_are_as_ordered():
    sensors = flight(
        gnss=Gnss(uav_white_m=0.0, uav_bias_m=1.5, height_bias_m=0.7),
        attitude=ScenarioAttitude(compass_bias_deg=8.0, noise_deg=0.0),
    )
    reading, truth = sensors.uav(T, "position"), sensors.world.at_uav(T)
    error = reading.p_enu - truth.p_enu
    np.testing.assert_allclose(np.hypot(error[:, 0], error[:, 1]), 1.5, atol=1e-9)
    np.testing.assert_allclose(error[:, 2], 0.7, atol=1e-9)
    np.testing.assert_allclose(reading.yaw - truth.yaw, np.radians(8.0), atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "size", "growth"),
    [("jump", 12.0, lambda t: np.full_like(t, 12.0)), ("drift", 0.5, lambda t: 0.5 * (t - 10.0))],
)
def test_a_spoofed_vehicle_is_off_by_what_was_asked(kind, size, growth, monkeypatch):
    monkeypatch.undo()  # each moves its own bodies: a spoof is to change no motion
    faults = (ScenarioFault(vehicle=2, kind=kind, start_s=10.0, size=size),)
    good, bad = flight(), flight(faults=faults)
    off = np.linalg.norm(bad.ugv(2, T).p_enu - good.ugv(2, T).p_enu, axis=1)
    assert off[T < 9.99].max() == 0.0
    np.testing.assert_allclose(off[T >= 10.0], growth(T[T >= 10.0]), atol=1e-9)
    assert np.array_equal(bad.ugv(1, T).p_enu, good.ugv(1, T).p_enu)


def test_a_lagging_vehicle_speaks_of_the_past():
    sensors = flight(
        gnss=Gnss(white_m=0.0, bias_m=0.0), faults=(ScenarioFault(vehicle=0, kind="lag", start_s=5.0, size=3.0),)
    )
    late = T >= 5.0
    want = sensors.world.track_of(0, T[late] - 3.0)[0]
    np.testing.assert_allclose(sensors.ugv(0, T).p_enu[late, :2], want, atol=1e-9)


def test_a_frozen_vehicle_repeats_itself_to_the_bit():
    reading = flight(faults=(ScenarioFault(vehicle=0, kind="frozen", start_s=5.0, stop_s=9.0),)).ugv(0, T)
    held = (T >= 5.0) & (T < 9.0)
    assert len(np.unique(reading.p_enu[held], axis=0)) == 1
    assert len(np.unique(reading.p_enu[~held], axis=0)) == (~held).sum()


def test_zero_and_silent_are_marked():
    faults = (
        ScenarioFault(vehicle=0, kind="zero", start_s=5.0, stop_s=6.0),
        ScenarioFault(vehicle=1, kind="silent", start_s=3.0),
    )
    sensors = flight(faults=faults)
    assert np.array_equal(sensors.ugv(0, T).zeroed, (T >= 5.0) & (T < 6.0))
    assert [sensors.silent(1, t) for t in (2.9, 3.0, 19.0)] == [False, True, True]
    assert not sensors.silent(0, 5.5)


def test_geodetic_agrees_with_an_independent_oracle():
    pymap3d = pytest.importorskip("pymap3d")
    p = np.random.default_rng(2).uniform(-2000.0, 2000.0, (50, 3)) * (1, 1, 0.1)
    for origin in ((48.1, 11.6, 550.0), (-33.9, 151.2, 20.0), (0.0, -179.99, 0.0)):
        np.testing.assert_allclose(to_geodetic(p, *origin), pymap3d.enu2geodetic(*p.T, *origin), rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_detectors_noise_is_as_ordered():
    detector = ScenarioDetector(pixel_noise=1.5, angle_noise_deg=3.0, miss=0.1, flip=0.05)
    world = World(dataclasses.replace(nominal(), detector=detector))
    model, rows, seen = DetectorModel(world), [], 0
    for k in range(300):
        found = model.detect(k / 10)
        boxes = true_boxes(world.view(k / 10), world.bodies(k / 10))
        index = found.system_id - 11
        true = np.stack([boxes.cx, boxes.cy, boxes.w, boxes.h, boxes.angle], axis=-1)[index]
        rows.append(np.column_stack([found.values[:, :5] - true, found.values[:, 5:7], found.values[:, 4]]))
        seen += len(found.values)
    error = np.concatenate(rows)
    assert seen / (300 * 7) == pytest.approx(0.9, abs=0.03)
    np.testing.assert_allclose(error[:, :4].std(axis=0), 1.5, rtol=0.1)
    flipped = np.abs(wrapped(error[:, 4])) > np.pi / 2
    assert flipped.mean() == pytest.approx(0.05, abs=0.02)
    assert np.degrees(wrapped(error[~flipped, 4]).std()) == pytest.approx(3.0, rel=0.1)
    # heading = angle + π/2
    np.testing.assert_allclose(np.cos(error[:, 6] - error[:, 7] - np.pi / 2), 1.0, atol=1e-12)
    assert 0.5 < error[:, 5].min() < 0.75 < error[:, 5].max() < 0.96


def test_clutter_blackouts_bursts_and_strangers():
    scenario = Scenario(
        duration_s=20.0,
        ground=ScenarioGround(kind="parked", vehicles=4),
        targets=Targets(still=1, persons=1, lookalikes=1),
        detector=ScenarioDetector(miss=0.0, clutter=0.5, bursts_per_min=6.0, heading_missing=True),
        blackouts=(Blackout(start_s=5.0, stop_s=6.0),),
    )
    world = World(scenario)
    model = DetectorModel(world)
    found = [model.detect(k / 10) for k in range(200)]
    assert all(len(f.values) == 0 for f in found[50:60])
    assert all(len(f.values) == len(f.system_id) for f in found)
    strangers = np.array([(f.system_id == 0).sum() for f in found])
    assert 2.0 < np.delete(strangers, range(50, 60)).mean() < 4.5
    ours = np.array([(f.system_id > 0).sum() for f in found])
    assert (ours[:50] < 4).any() or (ours[60:] < 4).any()
    values = np.concatenate([f.values for f in found])
    assert np.isnan(values[:, 6]).all()
    assert np.abs(values[:, 4]).max() <= np.pi / 2


def test_rows_of_a_frame_are_in_no_order():
    model = DetectorModel(World(nominal()))
    assert len({tuple(model.detect(k / 10).system_id.tolist()) for k in range(20)}) > 15


@pytest.mark.parametrize("kind", ["walk", "steps", "sine"])
def test_other_lasting_errors_begin_with_their_deviation_and_move_in_their_time(kind):
    gnss = Gnss(bias_m=2.0, bias_kind=kind, tau_s=20.0)
    b = lasting_error(gnss, 401, (3000, 2), 0.1, np.random.default_rng(4))
    assert b[0].std() == pytest.approx(2.0, rel=0.05)
    # after τ: a walk has moved by σ, steps by √2 σ where one has come, a wave by √2 σ √(1 − E cos(2π τ/τ'))
    stepped, turned = 1.0 - np.exp(-1.0), 1.0 - np.cos(2.0 * np.pi / np.linspace(0.75, 1.33, 999)).mean()
    moved = {"walk": 2.0, "steps": np.sqrt(8.0 * stepped), "sine": np.sqrt(8.0 * turned)}[kind]
    assert (b[200] - b[0]).std() == pytest.approx(moved, rel=0.15)
    still = (np.diff(b, axis=0) == 0.0).mean()
    assert still == pytest.approx({"steps": np.exp(-0.1 / 20.0)}.get(kind, 0.0), abs=0.01)


@pytest.mark.parametrize(
    ("kind", "variance", "fourth"), [("normal", 1.0, 3.0), ("laplace", 1.0, 6.0), ("outliers", 1.96, 20.3)]
)
def test_report_noise_has_the_variance_and_the_tails_of_its_kind(kind, variance, fourth):
    x = report_noise(kind, (200_000, 2), np.random.default_rng(5))
    assert x.var() == pytest.approx(variance, rel=0.03)
    # kurtosis E x⁴ / (E x²)²
    assert np.mean(x**4) / x.var() ** 2 == pytest.approx(fourth, rel=0.1)


def test_a_spoof_has_errors_of_its_own_and_a_copy_those_of_the_other():
    def reports(kind, delay):
        faults = (ScenarioFault(vehicle=2, kind=kind, start_s=-10.0, other=4, size=delay),)
        sensors = flight(faults=faults)
        return sensors.ugv(2, T + delay).p_enu, sensors.ugv(4, T).p_enu, sensors.world.track_enu(4, T)[0]

    for delay in (0.0, 0.6):
        copied, said, _ = reports("copy", delay)
        np.testing.assert_allclose(copied, said, atol=1e-9)
        claimed, said, true = reports("spoof", delay)
        assert 0.1 < np.linalg.norm((claimed - true)[:, :2], axis=1).mean() < 3.0
        assert np.linalg.norm(claimed - said, axis=1).min() > 0.0


def test_the_uavs_rates_are_those_of_its_wobble_or_none():
    wobbling = ScenarioFlight(wobble_deg=2.5, wobble_tau_s=0.15)
    sensors = flight(flight=wobbling, attitude=ScenarioAttitude(noise_deg=0.0, wander_deg=0.0))
    reading = sensors.uav(np.arange(0.0, 20.0, 0.01), "attitude")
    # small angles: pitch' is nearly the second rate
    np.testing.assert_allclose(np.gradient(reading.pitch, 0.01), reading.rates[:, 1], atol=np.radians(6.0))
    assert np.degrees(reading.rates[:, 1].std()) > 5.0
    silent = flight(flight=wobbling, attitude=ScenarioAttitude(rates=False)).uav(T, "attitude")
    assert not silent.rates.any()


def test_attitude_wanders_slowly_and_the_uavs_position_lags():
    attitude = ScenarioAttitude(noise_deg=0.0, compass_bias_deg=0.0, wander_deg=1.5)
    sensors = flight(
        attitude=attitude, gnss=Gnss(uav_white_m=0.0, uav_bias_m=0.0), timing=ScenarioTiming(uav_lag_s=0.4)
    )
    reading, truth = sensors.uav(T, "attitude"), sensors.world.at_uav(T)
    error = np.degrees(np.stack([reading.yaw - truth.yaw, reading.pitch - truth.pitch, reading.roll - truth.roll]))
    assert 0.3 < np.sqrt(np.mean(error**2)) < 4.0
    assert np.abs(np.diff(error, axis=1)).std() < 0.3
    np.testing.assert_allclose(reading.p_enu, sensors.world.at_uav(T - 0.4).p_enu)


def test_reported_altitudes_err_by_vehicle_and_from_report_to_report():
    sensors = flight(gnss=Gnss(altitude_bias_m=4.0, altitude_white_m=0.5))
    z = np.stack([sensors.ugv(vehicle, T).p_enu[:, 2] for vehicle in range(7)])
    assert 1.0 < z.mean(axis=1).std() < 8.0
    assert (z - z.mean(axis=1, keepdims=True)).std() == pytest.approx(0.5, rel=0.15)


@pytest.mark.slow
def test_misses_come_in_runs_of_the_length_that_was_asked():
    world = World(dataclasses.replace(nominal(), detector=ScenarioDetector(miss=0.2, miss_run_s=0.5)))
    model = DetectorModel(world)
    seen = np.array([np.isin(range(11, 18), model.detect(k / 10).system_id) for k in range(600)])
    assert 1.0 - seen.mean() == pytest.approx(0.2, abs=0.05)
    ends = (~seen[:-1] & seen[1:]).sum()
    assert (~seen).sum() / ends / 10.0 == pytest.approx(0.5, rel=0.3)


@pytest.mark.slow
def test_noise_in_shares_of_the_box_grows_with_it():
    world = World(dataclasses.replace(nominal(), detector=ScenarioDetector(pixel_noise=0.0, size_noise=0.1, miss=0.0)))
    model, errors = DetectorModel(world), []
    for k in range(100):
        found, boxes = model.detect(k / 10), true_boxes(world.view(k / 10), world.bodies(k / 10))
        index = found.system_id - 11
        errors.append((found.values[:, 0] - boxes.cx[index]) / np.sqrt(boxes.w * boxes.h)[index])
    assert np.concatenate(errors).std() == pytest.approx(0.1, rel=0.1)
