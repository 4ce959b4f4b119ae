from functools import cache

import cv2
import numpy as np
import pytest

from sim.errors import ScenarioError
from sim.world.boxes import in_image, true_boxes, visible_share
from sim.world.motion import STEP_S
from sim.world.presets import curved_road, nominal
from sim.world.scenario import Scenario, ScenarioCamera, ScenarioFlight, ScenarioGround, Targets
from sim.world.view import OCCLUDER
from sim.world.world import LEAD_S, TAIL_S, World
from tests.support.waiting import calls_of

CROWD = Targets(still=2, moving=1, persons=2, lookalikes=2, parked_lookalikes=1)
KINDS = {
    "straight": ScenarioGround(
        kind="straight", vehicles=10, outside=2, lanes=2, stops_per_min=2.0, lane_changes_per_min=6.0
    ),
    "curved": ScenarioGround(
        kind="curved", vehicles=12, outside=2, lanes=3, stops_per_min=2.0, lane_changes_per_min=6.0
    ),
    "open": ScenarioGround(kind="open", vehicles=10, outside=2),
    "line": ScenarioGround(kind="formation", formation="line", vehicles=5, spacing_m=4.0),
    "column": ScenarioGround(kind="formation", formation="column", vehicles=5, outside=1, spacing_m=5.0),
    "wedge": ScenarioGround(kind="formation", formation="wedge", vehicles=7, spacing_m=5.0),
    "grid": ScenarioGround(kind="formation", formation="grid", vehicles=9, spacing_m=4.0),
    "parked": ScenarioGround(kind="parked", vehicles=8, outside=1, spacing_m=4.0),
}


@cache
def world_of(kind):
    targets = Targets(persons=1, still=1) if KINDS[kind].kind == "formation" else CROWD
    return World(Scenario(seed=5, duration_s=30.0, ground=KINDS[kind], targets=targets))


def overlaps(world, t):
    """Pairs of bodies whose boxes on the ground intersect."""
    state, size = world.at(t), world.roles.size
    boxes = [
        (tuple(xy.tolist()), (float(s[1]), float(s[0])), -float(np.degrees(h)))
        for xy, s, h in zip(state.xy, size, state.heading, strict=True)
    ]
    near = np.linalg.norm(state.xy[:, None] - state.xy, axis=-1) < 6.0
    return [
        (i, j)
        for i, j in np.argwhere(np.triu(near, 1))
        if cv2.rotatedRectangleIntersection(boxes[i], boxes[j])[0] != cv2.INTERSECT_NONE
    ]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("kind", KINDS)
def test_nobody_runs_through_anybody(kind):
    assert [(t, overlaps(world_of(kind), t)) for t in np.arange(0.0, 30.0, 0.5) if overlaps(world_of(kind), t)] == []


@pytest.mark.slow_but_first
@pytest.mark.parametrize("kind", KINDS)
def test_motion_is_that_of_vehicles(kind):
    world = world_of(kind)
    t = np.arange(0.0, 30.0, 0.1)
    states = [world.at(float(s)) for s in t]
    ours = slice(0, world.scenario.fleet_size)
    xy = np.array([s.xy[ours] for s in states])
    heading = np.array([s.heading[ours] for s in states])
    speed = np.array([s.speed[ours] for s in states])
    v = np.array([s.v_enu[ours, :2] for s in states])
    assert np.abs(speed).max() < 2.3 * world.scenario.ground.speed_mps
    assert np.abs(np.diff(xy, axis=0)).max() < 0.1 * 2.3 * world.scenario.ground.speed_mps
    assert np.abs(np.diff(heading, axis=0)).max() / 0.1 < 1.3
    # the nose points where the vehicle goes, or away from it in reverse
    nose = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    sideways = np.abs(nose[..., 0] * v[..., 1] - nose[..., 1] * v[..., 0])
    assert np.quantile(sideways, 0.99) < 0.35
    assert np.median(np.abs(np.sum(nose * v, axis=-1) - speed)) < 0.05
    if kind != "parked":
        assert np.median(np.linalg.norm(v, axis=-1)) > 0.25 * world.scenario.ground.speed_mps


def test_parked_vehicles_stand():
    world = world_of("parked")
    ours = slice(0, world.scenario.fleet_size)
    assert np.array_equal(world.at(0.0).xy[ours], world.at(29.0).xy[ours])
    assert np.array_equal(world.at(0.0).heading[ours], world.at(29.0).heading[ours])


def test_open_ground_has_reverse_legs_and_pivots():
    world = world_of("open")
    states = [world.at(float(t)) for t in np.arange(0.0, 30.0, 0.1)]
    speed = np.array([s.speed[:10] for s in states])
    turn = np.abs(np.gradient(np.array([s.heading[:10] for s in states]), 0.1, axis=0))
    assert (speed < -0.3).any()
    assert ((np.abs(speed) < 0.05) & (turn > 0.5)).any()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_world_and_another_does_not(kind):
    world = world_of(kind)
    again = World(world.scenario)
    assert np.array_equal(world.at(17.3).xy, again.at(17.3).xy)
    assert np.array_equal(world.view(17.3).R_enu_cam, again.view(17.3).R_enu_cam)
    other = World(Scenario(seed=6, duration_s=30.0, ground=KINDS[kind], targets=world.scenario.targets))
    assert not np.array_equal(world.at(17.3).xy, other.at(17.3).xy)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("scenario", [nominal(), curved_road()], ids=lambda s: s.name)
def test_presets_keep_the_filmed_in_the_image_and_the_others_out(scenario):
    world, filmed = World(scenario), scenario.ground.vehicles
    for t in np.arange(0.0, scenario.duration_s, 0.5):
        inside = in_image(world.view(t), true_boxes(world.view(t), world.bodies(t)))
        assert inside[:filmed].all()
        assert not inside[filmed : scenario.fleet_size].any()


def test_curved_road_hides_one_vehicle_once_for_about_two_seconds():
    world = World(curved_road())
    t = np.arange(0.0, 32.0, 0.1)
    hidden = np.array([visible_share(world.view(s), world.bodies(s))[:6] < 0.5 for s in t])
    assert (hidden.sum(axis=0) > 0).sum() == 1
    assert 1.5 <= 0.1 * hidden.sum() <= 3.0
    assert np.abs(np.diff(hidden.any(axis=1).astype(int))).sum() == 2


def test_curved_road_has_one_false_target_that_looks_like_ours():
    world = World(curved_road())
    strangers = np.flatnonzero(world.roles.system_id == 0)
    assert len(strangers) == 1
    assert (world.bodies(0.0).color[strangers[0]] == world.bodies(0.0).color[0]).all()
    seen = [in_image(world.view(t), true_boxes(world.view(t), world.bodies(t)))[strangers[0]] for t in range(32)]
    assert 8 < sum(seen) < 32


def test_bodies_end_with_the_occluders_and_begin_with_ours():
    bodies = World(curved_road()).bodies(3.0)
    assert bodies.kind[-1] == OCCLUDER
    assert (bodies.kind[:7] == 0).all()
    assert {len(getattr(bodies, name)) for name in bodies.__slots__} == {len(bodies.kind)}


def test_the_uav_keeps_an_oblique_camera_on_the_fleet():
    flight = ScenarioFlight(height_m=45.0, yaw_rate_dps=12.0, climb_mps=0.3)
    base = Scenario(duration_s=20.0, ground=ScenarioGround(kind="open", vehicles=5, area_m=(20.0, 12.0)), flight=flight)
    for pitch in (-45.0, -35.0):
        world = World(
            base.__class__(
                duration_s=20.0, ground=base.ground, flight=flight, camera=base.camera.__class__(pitch_deg=pitch)
            )
        )
        for t in np.arange(0.0, 20.0, 1.0):
            assert in_image(world.view(t), true_boxes(world.view(t), world.bodies(t))).all()


@pytest.mark.parametrize("place", [{"kind": "open", "area_m": (120.0, 70.0)}, {"kind": "curved", "lanes": 4}])
def test_fifty_vehicles_are_moved_all_at_once(place):
    def calls(vehicles):
        scenario = Scenario(duration_s=5.0, ground=ScenarioGround(vehicles=vehicles, **place))
        return calls_of(lambda: World(scenario))

    steps = (LEAD_S + 5.0 + TAIL_S) / STEP_S
    assert calls(50) < min(1.5 * calls(25), 300 * steps), "arrays of vehicles, not one after the other"


def test_too_many_for_the_ground_is_refused():
    with pytest.raises(ScenarioError, match=r"do not fit on the ground"):
        World(Scenario(ground=ScenarioGround(kind="parked", vehicles=60, area_m=(20.0, 10.0))))


@pytest.mark.slow
@pytest.mark.parametrize("tau_s", [0.15, 0.4])
def test_a_fixed_camera_wobbles_smoothly_by_what_was_asked(tau_s):
    flight = ScenarioFlight(wobble_deg=2.5, wobble_tau_s=tau_s, tilt_sway_deg=0.0, yaw_sway_deg=0.0)
    world = World(Scenario(duration_s=250.0, ground=ScenarioGround(kind="parked", vehicles=1), flight=flight))
    t = np.arange(0.0, 250.0, 0.02)
    uav = world.at_uav(t)
    for angle, std in ((uav.pitch, 2.5), (uav.roll, 2.5), (uav.yaw, 2.5 / 3.0)):
        assert np.degrees(angle.std()) == pytest.approx(std, rel=0.2)
        # three poles: ρ(Δ) = (1 + Δ/T + (Δ/T)²/3) e^(−Δ/T)
        lag = round(2.0 * tau_s / 0.02)
        expected = (1.0 + 2.0 + 4.0 / 3.0) * np.exp(-2.0)
        assert np.mean(angle[lag:] * angle[:-lag]) / angle.var() == pytest.approx(expected, abs=0.1)
    # smooth: no more than a linear motion's share is new in 20 ms
    assert np.abs(np.diff(uav.pitch, 2)).std() < 0.02 * uav.pitch.std()


def test_without_wobble_the_body_only_sways():
    uav = World(Scenario(duration_s=20.0, flight=ScenarioFlight(tilt_sway_deg=0.0))).at_uav(np.arange(0.0, 20.0, 0.1))
    assert not uav.pitch.any()


def test_a_mirrored_image_is_flipped_left_to_right():
    plain, flipped = (
        World(Scenario(seed=3, camera=ScenarioCamera(mirrored=mirrored, pitch_deg=-50.0))) for mirrored in (False, True)
    )
    straight, mirror = (true_boxes(world.view(2.0), world.bodies(2.0)) for world in (plain, flipped))
    np.testing.assert_allclose(mirror.cx, 1920.0 - straight.cx, atol=1e-6)
    np.testing.assert_allclose(mirror.cy, straight.cy, atol=1e-6)
    np.testing.assert_allclose(np.cos(mirror.angle + straight.angle), -1.0, atol=1e-9)


def test_waves_lift_bodies_and_reports_alike():
    ground = ScenarioGround(kind="open", vehicles=8, area_m=(120.0, 120.0), waves_m=6.0, wavelength_m=90.0)
    world = World(Scenario(seed=3, ground=ground))
    z = world.bodies(4.0).z[:8]
    assert np.ptp(z) > 3.0
    assert np.abs(z).max() <= 6.0
    t = np.array([4.0, 4.01])
    for vehicle in range(8):
        p, v, _ = world.track_enu(vehicle, t)
        assert p[0, 2] == pytest.approx(z[vehicle])
        assert np.diff(p[:, 2])[0] / 0.01 == pytest.approx(v[0, 2], abs=0.05)
