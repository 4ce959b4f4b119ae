import dataclasses

import numpy as np
import pytest

from sim.errors import ScenarioError
from sim.telemetry.detections import DetectorModel, merged_boxes
from sim.telemetry.sensors import Sensors
from sim.world.actors import slots
from sim.world.presets import nominal
from sim.world.scenario import Gnss, Scenario, ScenarioDetector, ScenarioFault, ScenarioFlight, ScenarioGround
from sim.world.scenario_file import load_scenario, save_scenario
from sim.world.view import ray_ground
from sim.world.world import World

T = np.arange(0.0, 20.0, 0.2)


def base(**knobs):
    return dataclasses.replace(nominal(3), duration_s=20.0, **knobs)


def test_a_triangle_formation_has_equal_sides():
    places = slots("triangle", 3, 4.0)
    sides = [np.linalg.norm(places[i] - places[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
    np.testing.assert_allclose(sides, 4.0)
    six = slots("triangle", 6, 2.0)
    away = np.linalg.norm(six[:, None] - six, axis=-1) + np.eye(6) * 9.0
    np.testing.assert_allclose(away.min(axis=1), 2.0)


def test_a_rigid_formation_keeps_its_distances():
    ground = ScenarioGround(
        kind="formation", formation="grid", vehicles=9, spacing_m=5.0, station_keeping_m=0.0, bend_deg=0.0
    )
    world = World(base(ground=ground))
    first, last = (world.at(t).xy[:9] for t in (0.0, 18.0))
    np.testing.assert_allclose(first - first[0], last - last[0], atol=1e-6)
    assert np.linalg.norm(last - first, axis=1).min() > 20.0


def test_a_spoofed_vehicle_speaks_of_another_ones_place():
    faults = (ScenarioFault(vehicle=2, kind="spoof", start_s=8.0, other=4),)
    sensors = Sensors(World(base(gnss=Gnss(white_m=0.0, bias_m=0.0), faults=faults)))
    said, after = sensors.ugv(2, T), T >= 8.0
    for vehicle, rows in ((2, ~after), (4, after)):
        np.testing.assert_allclose(said.p_enu[rows, :2], sensors.world.track_of(vehicle, T[rows])[0], atol=1e-9)
    with pytest.raises(ScenarioError, match="other = 9 of fault does not exist"):
        base(faults=(ScenarioFault(vehicle=0, kind="spoof", start_s=1.0, other=9),))


def test_changes_of_satellites_move_the_reports_in_steps():
    quiet = Gnss(white_m=0.0, bias_m=0.0, steps_per_min=12.0, step_m=2.0)
    sensors = Sensors(World(base(gnss=quiet)))
    error = sensors.ugv(0, T).p_enu[:, :2] - sensors.world.track_of(0, T)[0]
    moved = np.linalg.norm(np.diff(error, axis=0), axis=1)
    assert 1 <= (moved > 0.3).sum() <= 15
    assert np.median(moved) < 1e-9


def test_gyroscopes_say_how_the_attitude_goes_on():
    turning = World(base(flight=ScenarioFlight(yaw_rate_dps=12.0, tilt_sway_deg=3.0)))
    quiet = dataclasses.replace(turning.scenario.attitude, noise_deg=0.0)
    sensors = Sensors(World(dataclasses.replace(turning.scenario, attitude=quiet)))
    now, later = (sensors.uav(T + dt, "attitude") for dt in (0.0, 0.1))
    middle = sensors.uav(T + 0.05, "attitude").rates
    np.testing.assert_allclose(np.degrees(middle[:, 2]).mean(), 12.0, atol=1.0)
    for k, name in enumerate(("roll", "pitch", "yaw")):
        # small tilts: body rates are nearly those of the angles
        change = (getattr(later, name) - getattr(now, name)) / 0.1
        assert np.abs(change - middle[:, k]).max() < 0.02


def test_a_roaming_view_goes_to_and_fro():
    still, roaming = (World(base(flight=ScenarioFlight(roam_m=m, sway_m=0.0))) for m in (0.0, 20.0))
    gap = np.array([roaming.at(t).uav.p_enu[:2] - still.at(t).uav.p_enu[:2] for t in T])
    assert 15.0 < np.linalg.norm(gap, axis=1).max() < 25.0
    assert abs(gap.mean(axis=0)).max() < 8.0


def test_sloping_ground_is_seen_and_reported_at_its_height():
    ground = ScenarioGround(kind="straight", vehicles=5, slope_deg=5.0, uphill_deg=90.0)
    world = World(base(ground=ground, gnss=Gnss(white_m=0.0, bias_m=0.0)))
    said = Sensors(world).ugv(0, T)
    # the road runs east, uphill: z = tan 5° · east
    np.testing.assert_allclose(said.p_enu[:, 2], np.tan(np.radians(5.0)) * said.p_enu[:, 0], atol=1e-9)
    np.testing.assert_allclose(said.v_enu[:, 2], np.tan(np.radians(5.0)) * said.v_enu[:, 0], atol=1e-9)
    # what the image's middle shows lies below the UAV on the slope
    view, uav = world.view(10.0), world.at(10.0).uav.p_enu
    along, across = ray_ground(view, [960.0, 540.0])[:2]
    assert along * np.cos(np.radians(5.0)) == pytest.approx(uav[0], abs=0.05)
    assert across == pytest.approx(uav[1], abs=0.05)
    level = World(base(ground=dataclasses.replace(ground, slope_deg=0.0)))
    assert np.array_equal(level.at_uav(T).p_enu, world.at_uav(T).p_enu)


def test_neighbours_come_as_one_box_that_holds_both():
    values = np.array(
        [
            [100.0, 100.0, 60.0, 40.0, 0.0, 0.7, 1.5],
            [150.0, 110.0, 62.0, 40.0, 0.0, 0.8, 1.5],
            [400.0, 100.0, 60.0, 40.0, 0.3, 0.7, 1.5],
        ]
    )
    rows, seen = merged_boxes(values, np.ones(3, dtype=bool), 1.4, np.random.default_rng(0))
    assert seen.tolist() == [False, True, True]
    np.testing.assert_allclose(rows[1, :4], [125.5, 105.0, 111.0, 50.0])
    assert np.array_equal(rows[2], values[2])
    assert merged_boxes(values, np.array([True, False, True]), 1.4, np.random.default_rng(0))[1].sum() == 2


def test_a_detector_that_merges_sees_fewer_and_says_which_body():
    ground = ScenarioGround(kind="curved", vehicles=8, lane_width_m=2.4, spacing_m=6.0)
    apart, merging = (base(ground=ground, detector=ScenarioDetector(miss=0.0, merge_lengths=m)) for m in (0.0, 1.6))
    counts = []
    for scenario in (apart, merging):
        world = World(scenario)
        model = DetectorModel(world)
        found = [model.detect(k / 10) for k in range(50)]
        counts.append(sum(len(rows.values) for rows in found))
        for rows in found:
            assert np.array_equal(world.roles.system_id[rows.body], rows.system_id)
            assert len(set(rows.body.tolist())) == len(rows.body)
    assert counts[1] < counts[0]


def test_the_new_knobs_are_saved_and_loaded(tmp_path):
    scenario = Scenario(
        ground=ScenarioGround(
            kind="formation", formation="triangle", station_keeping_m=0.3, slope_deg=2.0, uphill_deg=40.0
        ),
        flight=ScenarioFlight(roam_m=10.0),
        gnss=Gnss(steps_per_min=1.0),
        detector=ScenarioDetector(merge_lengths=1.5),
        faults=(ScenarioFault(vehicle=1, kind="spoof", start_s=3.0, other=2),),
    )
    save_scenario(scenario, tmp_path / "s.toml")
    assert load_scenario(tmp_path / "s.toml") == scenario
