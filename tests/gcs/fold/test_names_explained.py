"""Who a box may be, since when, where a vehicle should be, and why a name goes: from packets and boxes."""

from __future__ import annotations

import math
import re

import pytest

from gcs.fold.since import Since
from tests.support.alarm_scenes import (
    FOCAL_PX,
    OTHER,
    SIZE,
    STEP_US,
    UAV,
    UGV,
    UP_M,
    Scene,
    Vehicle,
    filmed,
    filter_status,
)
from tests.support.flights import S


@pytest.fixture
def scene():
    """Both vehicles are named."""
    return filmed(6)


def test_a_standing_says_since_when_and_a_missed_box_does_not_begin_it_anew(scene):
    since = scene.row(UGV).standing_since_us
    assert scene.row(UGV).standing == "confirmed" and 0 < since < scene.t_us - 3 * S
    scene.hidden = {UGV}
    scene.run(0.4, filmed=True)
    assert scene.row(UGV).standing == "coasting" and scene.row(UGV).standing_since_us > since
    scene.hidden = set()
    scene.run(0.4, filmed=True)
    assert scene.row(UGV).standing == "confirmed" and scene.row(UGV).standing_since_us == since
    assert scene.box(UGV).since_us > 0 and scene.box(UGV).since_us <= since


def test_an_interruption_that_lasts_begins_anew():
    since = Since()
    assert [since.update(t, "a", value) for t, value in ((1, "x"), (S, "x"), (2 * S, "y"), (3 * S, "x"))] == [
        *(1, 1, 2 * S, 3 * S)
    ]
    assert since.update(3 * S + 1, "b", "x") == 3 * S + 1


def test_the_candidates_of_a_box_are_the_fleet_with_what_speaks_against_each(scene):
    box = scene.box(UGV)
    first, second = box.candidates
    assert (first.system_id, second.system_id) == (UGV, OTHER)
    assert first.confidence == box.confidence and first.distance_m < 3.0 and not first.against
    assert second.distance_m > 8.0
    far, better = second.against.split(", ")
    assert better == "another box has its name (99%)"
    usual_m = float(re.fullmatch(r"too far: up to (\d+\.\d) m is usual", far)[1])
    assert 0.3 < usual_m < second.distance_m
    assert box.none_of_ours < 0.05


def test_a_box_that_is_nobody_has_candidates_too(scene):
    scene.stranger = (0.0, 8.0)
    scene.run(3, filmed=True)
    box = next(box for box in scene.last.boxes if not box.system_id)
    assert {each.system_id for each in box.candidates} == {UGV, OTHER}
    assert box.none_of_ours == box.confidence > 0.5
    assert all("too far" in each.against for each in box.candidates)
    assert box.since_us > scene.t_us - 4 * S


@pytest.mark.slow
def test_an_old_report_speaks_against_a_vehicle_and_a_lost_position_leaves_its_place_open(scene):
    silent = next(vehicle for vehicle in scene.vehicles if vehicle.system_id == UGV)
    silent.sends = "ha"
    scene.hidden = {UGV}
    scene.stranger = (0.0, 8.0)
    scene.run(5, filmed=True)
    box = next(box for box in scene.last.boxes if not box.system_id)
    candidate = next(each for each in box.candidates if each.system_id == UGV)
    assert "no position for" in candidate.against
    # from where it was long ago any box is far
    assert math.isnan(candidate.distance_m) and "too far" not in candidate.against
    scene.run(3, filmed=True)
    assert scene.row(UGV).position_state == "lost" and scene.row(UGV).in_view is None


def test_a_vehicle_says_where_the_picture_should_show_it(scene):
    (east, north), _ = Vehicle(UGV).place(scene.t_us - STEP_US)
    x, y = scene.row(UGV).expected_px
    assert math.hypot(x - 640 - FOCAL_PX / UP_M * east, y - 360 + FOCAL_PX / UP_M * north) < 40.0
    assert scene.row(UGV).in_view is True and scene.row(UAV).expected_px is None


@pytest.mark.slow
def test_without_a_camera_pose_nobody_is_said_to_be_out_of_view(scene):
    next(vehicle for vehicle in scene.vehicles if vehicle.system_id == UAV).sends = "h"
    scene.run(6, filmed=True)
    assert scene.last.pose == "unknown"
    assert scene.row(UGV).in_view is None and scene.row(UGV).expected_px is None
    assert scene.lost(UGV) == scene.lost(OTHER) == ["the UAV's position is lost"]


@pytest.mark.slow
def test_a_name_that_goes_with_its_track_is_an_event(scene):
    scene.hidden = {UGV}
    scene.run(4, filmed=True)
    assert scene.lost(UGV) == ["the track was lost"] and scene.lost(OTHER) == []


def test_a_name_that_leaves_the_picture_is_an_event(scene):
    for _ in range(60):
        scene.pushed_px += 12.0
        scene.run(0.1, filmed=True)
        if not any(box.cx < SIZE[0] - 30 and box.system_id == UGV for box in scene.last.boxes):
            scene.hidden = {UGV}
    assert "it left the picture" in scene.lost(UGV)


@pytest.mark.slow
def test_a_name_whose_id_two_senders_use_goes_with_that_reason(scene):
    scene.vehicles.append(Vehicle(UGV, shift_m=40.0, peer=77))
    scene.run(8, filmed=True)
    assert scene.row(UGV).contested
    assert scene.lost(UGV)[0] == "several senders use its id"


def test_certainties_in_events_are_as_everywhere(scene):
    given = [event.text for event in scene.events if event.kind == "identity" and " is UGV" in event.text]
    assert given and all("100%" not in text for text in given)


def test_nobody_says_that_one_is_out_of_view_that_doubts_where_it_is():
    glitch = filter_status(flags=0x833F, position=27.0)
    scene = Scene(Vehicle(UGV, shift_m=200.0, extra=glitch), Vehicle(OTHER, shift_m=200.0)).run(5)
    snapshot = scene.pipeline.between_frames(scene.t_us)
    _, doubting, other = snapshot.vehicles
    assert (doubting.standing, doubting.in_view) == ("misplaced", None)
    assert (other.standing, other.in_view) == ("out of view", False)
