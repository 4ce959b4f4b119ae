import dataclasses

import numpy as np
import pytest

from sim.errors import ScenarioError
from sim.telemetry.detections import DetectorModel, merged_boxes
from sim.telemetry.sensors import Sensors
from sim.world.actors import slots
from sim.world.boxes import true_boxes
from sim.world.presets import nominal
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioCamera,
    ScenarioDetector,
    ScenarioFault,
    ScenarioFlight,
    ScenarioGround,
    Targets,
    Zoom,
)
from sim.world.scenario_file import load_scenario, save_scenario
from sim.world.view import ray_ground
from sim.world.world import World

pytestmark = pytest.mark.usefixtures("moved_once")

T = np.arange(0.0, 20.0, 0.2)


def base(**knobs):
    return dataclasses.replace(nominal(3), **({"duration_s": 20.0} | knobs))


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


def test_a_detector_finds_vehicles_in_two_parts_for_a_share_of_the_time():
    world = World(base(duration_s=60.0, detector=ScenarioDetector(miss=0.0, flip=0.0, pixel_noise=0.1, parts=0.3)))
    model, counts, off = DetectorModel(world), [], []
    for k in range(0, 600, 3):
        rows = model.detect(k / 10)
        assert np.array_equal(world.roles.system_id[rows.body], rows.system_id)
        whole = true_boxes(world.view(k / 10), world.bodies(k / 10))
        for body, count in zip(*np.unique(rows.body[rows.system_id > 0], return_counts=True), strict=True):
            counts.append(count)
            if count == 2:
                front, rear = rows.values[rows.body == body]
                np.testing.assert_allclose([front[2], rear[2]], 0.5 * whole.w[body], atol=1.0)
                off.append(np.hypot(*(0.5 * (front + rear)[:2] - (whole.cx[body], whole.cy[body]))))
    assert set(counts) == {1, 2} and max(off) < 1.0, "both together are where the vehicle is"
    assert 0.15 < np.mean(np.array(counts) == 2) < 0.45


def test_some_vehicles_are_never_found_and_the_others_as_ever():
    missed, whole = (base(detector=ScenarioDetector(miss=0.0, never_found=n)) for n in (2, 0))
    seen = [set(), set()]
    for found, scenario in zip(seen, (missed, whole), strict=True):
        model = DetectorModel(World(scenario))
        for k in range(50):
            found |= set(model.detect(k / 10).system_id.tolist()) - {0}
    assert seen[0] < seen[1] and len(seen[1] - seen[0]) == 2


def test_a_zoom_that_nothing_reports_makes_boxes_larger_from_then_on():
    camera = ScenarioCamera(zooms=(Zoom(at_s=1.0, factor=2.0), Zoom(at_s=2.0, factor=1.0)))
    world, plain = World(base(camera=camera)), World(base())
    for t, factor in ((0.5, 1.0), (1.0, 2.0), (1.9, 2.0), (2.5, 1.0)):
        assert world.view(t).fx == factor * plain.view(t).fx and world.view(t).fy == factor * plain.view(t).fy


def test_parked_in_bays_vehicles_stand_side_by_side_in_two_rows():
    ground = ScenarioGround(kind="bays", vehicles=6, spacing_m=3.0, length_m=4.2, width_m=1.8)
    world = World(base(ground=ground, targets=Targets(lookalikes=4, persons=1)))
    first, last = world.at(0.0), world.at(4.0)
    stand = world.roles.role != "person"
    assert np.array_equal(first.xy[stand], last.xy[stand]) and not np.array_equal(first.xy[~stand], last.xy[~stand])
    rows = np.unique(first.xy[stand, 1].round(6))
    assert len(rows) == 2 and rows[1] - rows[0] == pytest.approx(4.2 + 6.0)
    for row in rows:
        x = np.sort(first.xy[stand & np.isclose(first.xy[:, 1], row), 0])
        steps = np.diff(x) / 3.0
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
        assert (steps > 0.5).all(), "nobody stands in another's bay"


def test_the_new_knobs_are_saved_and_loaded(tmp_path):
    scenario = Scenario(
        ground=ScenarioGround(
            kind="formation", formation="triangle", station_keeping_m=0.3, slope_deg=2.0, uphill_deg=40.0
        ),
        flight=ScenarioFlight(roam_m=10.0),
        camera=ScenarioCamera(zooms=(Zoom(at_s=3.0, factor=2.0),)),
        gnss=Gnss(steps_per_min=1.0),
        detector=ScenarioDetector(merge_lengths=1.5, parts=0.2, never_found=1),
        faults=(ScenarioFault(vehicle=1, kind="spoof", start_s=3.0, other=2),),
    )
    save_scenario(scenario, tmp_path / "s.toml")
    assert load_scenario(tmp_path / "s.toml") == scenario
