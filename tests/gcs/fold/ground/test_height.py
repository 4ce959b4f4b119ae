"""The height of the ground: from the fleet's altitudes where they say more than the UAV's take-off."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.fold.ground.height import GroundHeight
from mavlink.geodesy import R_ENU_NED, rotation_from_euler
from tests.support.flights import World

S = 1_000_000
STD_M = 3.0


def fleet_at(n):
    """A state of a copter and n rovers, of which the tests replace what they need."""
    world = World(rovers=n)
    return world.fleet.at(world.run(2))


def follow(
    up, *, height=60.0, home=0.0, seconds=10.0, step_s=0.1, drive=5.0, rise=None, events=None, relief=None, **uav
):
    """The ground after some seconds in which n rovers drove east, side by side.

    Args:
        up: (n,) errors of their altitudes, NaN none.
        height: of the UAV above its home, which is at the height ``home``.
        rise: height of the ground at places (n, 2), 0 everywhere by default.
        events: takes what is to be known.
        relief: of a terrain file.
        uav: more of its state.
    """
    n = len(up)
    state, heights = fleet_at(n), GroundHeight()
    uav = replace(state.uav, p_enu=np.array([0.0, 0.0, home + height]), height_m=height, **uav)
    up = np.asarray(up, float)
    for k, t_s in enumerate(np.arange(0.0, seconds, step_s)):
        p = np.column_stack([np.full(n, drive * t_s), 12.0 * np.arange(n)])
        z = (rise(p) if rise else 0.0) + np.where(np.isfinite(up), up, 0.0)
        moment = replace(
            state,
            t_us=state.t_us + round(k * step_s * S),
            uav=uav,
            p_enu=np.column_stack([p, z]),
            up_std_m=np.where(np.isfinite(up), STD_M, np.nan),
            valid=np.ones(n, bool),
        )
        said = heights.update(moment, relief)
        if events is not None:
            events += said
    return heights.ground


@pytest.mark.slow_but_first
@pytest.mark.parametrize("home", [-40.0, -20.0, 30.0, 40.0])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_take_off_from_a_hill_or_a_valley_is_seen_in_the_vehicles_altitudes(home, n):
    ground = follow(np.zeros(n), home=home)
    assert abs(ground.z) < 2.5 and 2.0 < ground.std_m < 7.0


def test_on_the_field_of_the_take_off_it_is_known_as_well_as_the_barometer():
    rng = np.random.default_rng(1)
    for _ in range(5):
        ground = follow(rng.normal(0.0, 3.0, 6) + 2.0)
        assert abs(ground.z) < 1.5 and ground.std_m < 3.0


def test_without_any_altitude_it_is_the_home_plane_and_doubtful():
    ground = follow([np.nan, np.nan, np.nan], home=7.0)
    assert ground.z == pytest.approx(7.0) and ground.std_m == 6.0 and not ground.slope.any()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("wrong", [100.0, -100.0, 40.0])
@pytest.mark.parametrize("home", [0.0, 30.0])
def test_one_wrong_altitude_costs_nothing(wrong, home):
    right = follow([1.0, -2.0, 0.5, 1.5], home=home)
    with_wrong = follow([1.0, -2.0, 0.5, 1.5, wrong], home=home)
    assert with_wrong.z == pytest.approx(right.z, abs=1.0)


def test_of_two_that_contradict_each_other_the_one_near_home_is_right():
    assert abs(follow([0.0, 120.0], home=-8.0).z) < 8.0


@pytest.mark.parametrize("slope", [(0.08, 0.0), (-0.1, 0.0), (-0.06, 0.03)])
def test_vehicles_that_drive_show_the_slope(slope):
    rng = np.random.default_rng(2)
    ground = follow(rng.normal(0.0, 1.0, 7), seconds=20.0, rise=lambda p: p @ np.array(slope))
    assert ground.slope == pytest.approx(slope, abs=0.03)
    rise = ground.height_at(np.array([[100.0, 36.0], [0.0, 36.0]]))
    assert rise[0] - rise[1] == pytest.approx(100.0 * slope[0], abs=1.0)


def test_a_vehicle_that_begins_to_report_moves_the_ground_smoothly():
    heights, state = GroundHeight(), fleet_at(4)
    uav = replace(state.uav, p_enu=np.array([0.0, 0.0, 60.0]), height_m=90.0)
    z = []
    for k in range(200):
        up = np.array([0.0, 0.5, 1.0, 9.0])
        known = np.array([True, True, True, k > 100])
        std_m = np.where(known, STD_M, np.nan)
        p = np.column_stack([0.5 * k * np.ones(4), 10.0 * np.arange(4), up])
        heights.update(replace(state, t_us=state.t_us + k * S // 10, uav=uav, p_enu=p, up_std_m=std_m))
        z.append(heights.ground.z)
    assert 1.0 < z[-1] - z[99] < 4.0 and np.abs(np.diff(z)).max() < 0.2


def test_the_same_moment_twice_counts_once_whatever_the_frame_rate():
    often, seldom = follow([2.0, -1.0], home=20.0, step_s=0.02), follow([2.0, -1.0], home=20.0, step_s=0.5)
    assert often.z == pytest.approx(seldom.z, abs=0.3) and often.std_m == pytest.approx(seldom.std_m, abs=0.3)


def tilted(degrees):
    """Rotation of a body whose nose is down by so much."""
    return R_ENU_NED @ rotation_from_euler(0.0, np.radians(-degrees), 0.0)


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_a_rangefinder_knows_the_height_better_than_altitudes_do(degrees):
    above = 45.0
    range_m = above / np.cos(np.radians(degrees))
    ground = follow([5.0, 6.0], home=0.0, height=above + 15.0, range_m=range_m, R_enu_body=tilted(degrees))
    assert ground.z == pytest.approx(15.0, abs=2.0) and ground.std_m < 3.0


def test_the_autopilots_map_helps_where_vehicles_have_no_altitude():
    ground = follow([np.nan, np.nan], home=0.0, height=60.0, terrain_height_m=40.0)
    assert ground.z == pytest.approx(20.0, abs=3.0) and 3.0 < ground.std_m < 7.0


def test_a_range_to_a_roof_is_left_out_where_all_else_agrees():
    events = []
    ground = follow([0.0, 1.0, -1.0], height=60.0, range_m=25.0, R_enu_body=tilted(0.0), events=events)
    assert abs(ground.z) < 1.0
    (event,) = events
    assert "the rangefinder 25 m" in event.text and event.text.endswith("60 m is used")


def test_sources_that_disagree_are_told_once_with_what_each_says():
    events = []
    follow([0.5, -0.5, 1.0], home=20.0, height=60.0, seconds=30.0, events=events)
    (event,) = events
    assert event.level == "warning" and event.system_id == 1
    assert event.text == (
        "sources of the height above ground disagree: the vehicles' altitudes 80 m, the take-off 60 m; 78 m is used"
    )


def test_sources_that_agree_are_nothing_to_tell():
    events = []
    rng = np.random.default_rng(3)
    follow(rng.normal(0.0, 3.0, 5), seconds=20.0, range_m=58.0, R_enu_body=tilted(0.0), events=events)
    assert events == []


class Hillside:
    """A terrain file's heights that rise to the east, in a datum of its own."""

    def __init__(self, datum=0.0, edge=np.inf):
        self.datum, self.edge = datum, edge

    def heights(self, p_enu):
        z = 0.002 * np.square(p_enu[:, 0]) + 0.1 * p_enu[:, 1]
        return np.where(p_enu[:, 0] > self.edge, np.nan, z + self.datum)


@pytest.mark.parametrize("datum", [0.0, 48.0, -30.0])
def test_a_terrain_file_gives_the_grounds_shape_whatever_its_datum(datum):
    hill, truth = Hillside(datum), Hillside()
    ground = follow([2.0, -1.0, 1.5, -2.0, 0.0], home=30.0, rise=truth.heights, relief=hill)
    places = np.array([[60.0, 5.0], [20.0, 30.0], [70.0, -10.0]])
    gap = ground.height_at(places) - truth.heights(places)
    assert np.ptp(gap) < 0.8 and abs(gap.mean()) < 4.0


def test_where_it_took_off_the_file_tells_the_height_above_everything_else():
    hill, heights, state = Hillside(20.0), GroundHeight(), fleet_at(2)
    for k in range(200):
        uav_en = np.array([100.0 - 0.5 * k, 0.0])
        height = min(0.5 * k, 60.0)
        uav = replace(state.uav, p_enu=np.array([*uav_en, 20.0 + height]), height_m=height)
        moment = replace(
            state, t_us=state.t_us + k * S // 10, uav=uav, p_enu=np.zeros((2, 3)), up_std_m=np.full(2, np.nan)
        )
        heights.update(moment, hill)
    assert heights.ground.height_at(np.zeros((1, 2)))[0] == pytest.approx(0.0, abs=2.0)


def test_where_the_file_has_no_heights_it_is_not_used_and_that_is_told_once():
    events = []
    ground = follow([0.0, 1.0], home=0.0, relief=Hillside(edge=20.0), events=events)
    assert abs(ground.z) < 1.5 and ground.relief is None
    assert [event.text for event in events] == [
        "the terrain file has no heights where the fleet is: it is not used there"
    ]


class Witnesses:
    """A UAV above its take-off at height 0, and rovers that drive up a slope, whose altitudes are off."""

    def __init__(self, up, height=60.0, slope=0.0, takeoff_known=True, **uav):
        self.heights, self.state, self.events = GroundHeight(takeoff_known=takeoff_known), fleet_at(len(up)), []
        self.uav = replace(self.state.uav, p_enu=np.array([0.0, 0.0, height]), height_m=height, **uav)
        self.up, self.slope, self.t_us = np.asarray(up, float), slope, self.state.t_us

    def run(self, seconds):
        for _ in range(round(seconds * 10)):
            self.t_us += S // 10
            east = 10.0 * np.arange(len(self.up)) + 5e-6 * (self.t_us - self.state.t_us)
            p = np.column_stack([east, np.zeros(len(self.up)), self.up + self.slope * east])
            moment = replace(self.state, t_us=self.t_us, uav=self.uav, p_enu=p, up_std_m=np.full(len(self.up), STD_M))
            self.events += self.heights.update(moment)
        return self

    def texts(self):
        return [event.text for event in self.events]


@pytest.mark.parametrize("off_m", [48.0, -35.0])
def test_altitudes_that_the_film_contradicts_are_left_out_at_once(off_m):
    seen = Witnesses(np.full(5, off_m) + np.linspace(-1.0, 1.0, 5)).run(1.0)
    used = seen.heights.ground.z
    assert abs(used - off_m) < 3.0 and any(abs(m - off_m) < 3.0 for m in seen.heights.ground.other_heights_m)
    seen.heights.compare_with_film(used, 1.0)
    seen.run(0.1)
    assert seen.heights.ground.z == pytest.approx(0.0, abs=1.0) == used + seen.heights.step_m
    assert seen.heights.ground.other_heights_m == ()
    side = "high" if off_m > 0 else "low"
    (text,) = seen.texts()
    assert text == f"the vehicles' altitudes are {abs(off_m):.0f} m too {side} by the film: another datum? " + (
        "Their level is not used"
    )
    seen.run(10.0)
    assert len(seen.texts()) == 1 and seen.heights.step_m == 0.0


def test_the_slope_is_still_that_of_altitudes_whose_level_is_wrong():
    seen = Witnesses(np.full(5, 48.0), slope=0.04).run(3.0)
    seen.heights.compare_with_film(seen.heights.ground.z, 1.0)
    ground = seen.run(5.0).heights.ground
    assert ground.slope[0] == pytest.approx(0.04, abs=0.015)
    assert all(abs(m) < 0.5 for m in ground.bumps.values())


def test_a_take_off_that_the_film_contradicts_is_left_out():
    seen = Witnesses([-30.0, -31.0, -29.0], range_m=90.0).run(1.0)
    z = seen.heights.ground.z
    seen.heights.compare_with_film(z + 30.0, 1.0)
    seen.run(0.1)
    assert seen.texts()[-1] == "the take-off is 30 m too high by the film: it is not used for the height of the ground"
    assert seen.heights.ground.z == pytest.approx(-30.0, abs=1.0)


def test_where_the_film_contradicts_all_it_tells_the_height_itself():
    seen = Witnesses(np.full(4, -70.0)).run(1.0)
    seen.heights.compare_with_film(seen.heights.ground.z + 20.0, 1.0)
    seen.run(5.0)
    assert seen.heights.ground.z == pytest.approx(-20.0, abs=0.5) and 1.5 < seen.heights.ground.std_m < 4.0
    assert len(seen.texts()) == 2


def test_a_film_that_agrees_changes_nothing():
    seen, alone = Witnesses([1.0, 2.0, 0.0]).run(1.0), Witnesses([1.0, 2.0, 0.0]).run(1.0)
    seen.heights.compare_with_film(1.5, 1.0)
    assert seen.run(1.0).heights.ground.z == alone.run(1.0).heights.ground.z and not seen.texts()


@pytest.mark.parametrize("flies_m", [45.0, 5.0])
def test_ground_above_a_uav_that_flies_is_no_ground(flies_m):
    seen = Witnesses(np.full(4, flies_m + 3.0), height=flies_m).run(1.0)
    if flies_m > 10.0:
        assert abs(seen.heights.ground.z) < 1.0
        assert seen.texts()[0].startswith("the vehicles' altitudes are 48 m too high by the take-off: another datum?")
    else:
        assert not seen.texts(), "it may stand on a table"


def test_altitudes_without_a_majority_are_not_used():
    seen = Witnesses([-140.0, 80.0, 20.0, -60.0, 140.0, 110.0]).run(1.0)
    assert abs(seen.heights.ground.z) < 0.5 and seen.texts() == [
        "the vehicles' altitudes contradict each other: they are not used for the height of the ground"
    ]
    most = Witnesses([-20.0, -21.0, -19.0, -20.5, 60.0, 110.0]).run(1.0)
    assert most.heights.ground.z == pytest.approx(-20.0, abs=1.5)


@pytest.mark.parametrize("height_m, takeoff_known", [(60.0, False), (np.nan, True)])
def test_altitudes_alone_may_count_from_another_level_until_the_film_tells(height_m, takeoff_known):
    seen = Witnesses(np.full(4, 30.0), takeoff_known=takeoff_known)
    seen.uav = replace(seen.uav, height_m=height_m)
    ground = seen.run(1.0).heights.ground
    assert ground.z == pytest.approx(30.0, abs=0.5) and ground.other_heights_m == (36.0,)
    assert ground.is_doubtful_below(60.0)
    seen.heights.compare_with_film(30.0, 1.0)
    ground = seen.run(0.1).heights.ground
    assert ground.z == pytest.approx(0.0, abs=0.5) and ground.other_heights_m == ()
    assert not ground.is_doubtful_below(100.0)
    assert seen.texts() == [
        "the vehicles' altitudes are 30 m too high by the film: another datum? Their level is not used"
    ]


def test_altitudes_that_put_the_uav_into_the_ground_give_way_to_a_guess():
    seen = Witnesses(np.full(4, 80.0), takeoff_known=False).run(1.0)
    ground = seen.heights.ground
    assert (ground.z, ground.std_m) == (10.0, 25.0) and ground.is_doubtful_below(60.0)
    (text,) = seen.texts()
    assert text.startswith("the vehicles' altitudes put the UAV into the ground: another datum?")
    nothing = Witnesses(np.full(2, np.nan), takeoff_known=False).run(1.0)
    assert nothing.heights.ground.z == nothing.heights.below(nothing.uav).z == 10.0 and not nothing.texts()
