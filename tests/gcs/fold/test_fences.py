"""Fences: read from the mission, placed about the origin, and compared with where vehicles report to be."""

import math

import numpy as np
import pytest

from gcs.errors import ConfigError
from gcs.fold.fences import Fences, distance_inside
from gcs.mission.mission import parse_mission
from gcs.session.metadata import mission_table
from gcs.snapshot import VehicleRow
from infra.toml_tables import parse_toml
from tests.support.alarm_scenes import Scene
from tests.support.flights import FIELD

VEHICLES = {"uav": {"system_id": 1}, "ugv": [{"system_id": 11}, {"system_id": 12}]}


def places(*enu):
    """ENU metres as latitudes and longitudes."""
    return [[float(a) for a in FIELD.to_geodetic([east, north, 0.0])[:2]] for east, north in enu]


def row(system_id, east, north):
    return VehicleRow(system_id=system_id, name="", role="ugv", p_enu=np.array([east, north, 0.0]))


def compared(fence, *rows):
    fences = Fences(parse_mission(VEHICLES | {"fence": fence}, "mission"))
    fences.set_origin(FIELD)
    return [(each.fence, each.fence_m) for each in fences.compare(rows)]


FIELD_CORNERS = places((-50, -20), (50, -20), (50, 20), (-50, 20))


@pytest.mark.parametrize(
    ("p", "inside_m"),
    [((1.0, 1.0), 1.0), ((5.0, -3.0), -3.0), ((-3.0, -4.0), -5.0), ((5.0, 5.0), -1.0), ((math.nan, 1.0), math.nan)],
)
def test_the_distance_to_a_polygon_that_is_not_convex(p, inside_m):
    shape = np.array(
        [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [6.0, 10.0], [6.0, 2.0], [4.0, 2.0], [4.0, 10.0], [0.0, 10.0]]
    )
    assert distance_inside(shape + 1e5, np.array(p) + 1e5) == pytest.approx(inside_m, abs=1e-3, nan_ok=True)


def test_a_vehicle_is_inside_or_outside_of_a_polygon_by_so_many_metres():
    found = compared({"name": "field", "polygon": FIELD_CORNERS}, row(11, 10, 15), row(12, 60, 0), row(1, 0, 0))
    assert found == [
        ("field", pytest.approx(5, abs=0.01)),
        ("field", pytest.approx(-10, abs=0.01)),
        ("", pytest.approx(math.nan, nan_ok=True)),
    ]


def test_a_circle_may_be_forbidden_and_hold_for_some_vehicles_only():
    pond = {"name": "pond", "keep": "out", "centre": places((0, 30))[0], "radius_m": 10, "vehicles": [12, 1]}
    found = compared(pond, row(11, 0, 30), row(12, 0, 22), row(1, 0, 5))
    assert found == [
        ("", pytest.approx(math.nan, nan_ok=True)),
        ("pond", pytest.approx(-2, abs=0.01)),
        ("pond", pytest.approx(15, abs=0.01)),
    ]


def test_of_several_fences_that_counts_which_is_nearest_to_be_broken():
    pond = {"name": "pond", "keep": "out", "centre": places((0, 0))[0], "radius_m": 5}
    found = compared(
        [{"name": "field", "polygon": FIELD_CORNERS}, pond], row(11, 8, 0), row(12, 40, 0), row(11, math.nan, 0)
    )
    assert found[:2] == [("pond", pytest.approx(3, abs=0.01)), ("field", pytest.approx(10, abs=0.01))]
    assert math.isnan(found[2][1])


def test_the_snapshot_has_the_outlines_about_its_origin():
    mission = parse_mission(VEHICLES | {"fence": {"polygon": FIELD_CORNERS}}, "mission")
    snapshots = []
    scene = Scene(mission=mission)
    scene.keep = snapshots.append
    scene.run(1)
    (outline,) = snapshots[-1].fence_enu
    assert np.allclose(np.ptp(outline, axis=0), (100, 40), atol=0.1)
    assert snapshots[-1].vehicles[1].fence_m == pytest.approx(
        distance_inside(outline, snapshots[-1].vehicles[1].p_enu[:2])
    )


def test_limits_and_fences_are_in_the_session_as_they_flew():
    pond = {"name": "pond", "keep": "out", "centre": [1.5, 2.5], "radius_m": 10, "vehicles": [12]}
    mission = parse_mission(
        VEHICLES | {"limits": {"separation_m": 5, "loss": 0.3}, "fence": [{"polygon": FIELD_CORNERS}, pond]}, "mission"
    )
    again = parse_mission(parse_toml(mission_table(mission, {}).encode(), "session"), "session")
    assert (again.limits, again.fence) == (mission.limits, mission.fence)
    assert (again.limits.separation_m, again.fence[1].radius_m) == (5.0, 10.0)


@pytest.mark.parametrize(
    ("fence", "message"),
    [
        ({}, "give polygon"),
        ({"polygon": FIELD_CORNERS[:2]}, "fewer than 3 corners"),
        ({"polygon": FIELD_CORNERS, "radius_m": 5}, "leave it out"),
        ({"centre": [1.0, 2.0]}, "needs radius_m"),
        ({"centre": [1.0, 2.0], "radius_m": -1}, "radius_m is -1"),
        ({"centre": [120.0, 2.0], "radius_m": 1}, "latitude comes first"),
        ({"polygon": [[math.nan, 2.0], [1.0, 2.0], [1.0, 3.0]]}, "no place"),
        ({"polygon": [[1.0], [1.0, 2.0], [1.0, 3.0]]}, "each \\[latitude, longitude\\]"),
        ({"polygon": 5}, "each \\[latitude, longitude\\]"),
        ({"keep": "near", "centre": [1.0, 2.0], "radius_m": 1}, "'in' or 'out'"),
        ({"centre": [1.0, 2.0], "radius_m": 1, "vehicles": [99]}, "99, which is no vehicle of this mission"),
    ],
)
def test_a_fence_that_is_none_is_refused_with_the_reason(fence, message):
    with pytest.raises(ConfigError, match=message) as found:
        parse_mission(VEHICLES | {"fence": fence}, "mission.toml")
    assert "\n" not in str(found.value)
