"""Names are held through a gap of the video for as long as they can be believed, and no clock goes back."""

import csv
from dataclasses import replace
from itertools import pairwise

import pytest

from gcs.fold.showing import HELD_US
from sim.world.presets import nominal
from sim.world.scenario import ScenarioGround
from tests.support.scripted import InjectedFaults, fly

SCENARIO = replace(nominal(3), ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0), duration_s=12.5)
HOLE = InjectedFaults(no_video=((7.0, 11.0),))
FAILS = InjectedFaults(detector_fails=(7.0, 11.0))
LATE = InjectedFaults(late_stamp_s=-0.9, no_video=((9.0, 10.0),))


def flown(folder, fps, faults=HOLE, **change):
    """Every snapshot that a screen could show."""
    shown = []
    path = fly(folder, replace(SCENARIO, fps=fps, **change), faults, shown.append)
    return path, shown


def boxed(snapshot):
    return {row.system_id: (row.standing, row.track_id) for row in snapshot.vehicles if row.track_id}


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "faults"), [(2.0, HOLE), (1.0, HOLE), (5.0, HOLE), (10.0, HOLE), (5.0, FAILS)])
def test_names_do_not_strobe(tmp_path, fps, faults):
    _, shown = flown(tmp_path, fps, faults)
    looked = None
    held = lapsed = 0
    for now in shown:
        if not now.held:
            looked = now
        elif now.boxes_age_s <= HELD_US * 1e-6:
            assert boxed(now) == boxed(looked), "a gap changes no name"
            assert [(box.cx, box.system_id) for box in now.boxes] == [(box.cx, box.system_id) for box in looked.boxes]
            held += bool(boxed(now))
        else:
            assert not now.boxes
            standings = {row.standing for row in now.vehicles if row.role == "ugv"}
            unknown = "no new frame" if faults is HOLE else "unidentified"
            assert unknown in standings and standings <= {unknown, "out of view", "no position"}
            lapsed += 1
    assert held > 5 and lapsed > 5
    assert {row.standing for row in shown[-1].vehicles if row.track_id} == {"confirmed"}


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "faults"), [(2.0, HOLE), (5.0, LATE), (10.0, InjectedFaults(step=(7.0, 3600.0)))])
def test_no_clock_goes_back(tmp_path, fps, faults):
    _, shown = flown(tmp_path, fps, faults)
    assert len(shown) > 20
    assert all(before.now_us <= now.now_us for before, now in pairwise(shown))


@pytest.mark.slow
def test_time_between_frames_is_not_ahead_of_the_next_frame(tmp_path):
    """By more than transports delay one frame more than another; frames are dated half a second before they come."""
    _, shown = flown(tmp_path, 2.0, InjectedFaults(late_stamp_s=-0.5))
    shown = [snapshot for snapshot in shown if snapshot.seen_us]
    assert sum(snapshot.held for snapshot in shown) > 10
    assert all(before.t_us - now.t_us < 0.08e6 for before, now in pairwise(shown))


@pytest.mark.slow
def test_a_clock_that_was_set_back_is_followed(tmp_path):
    _, shown = flown(tmp_path, 5.0, InjectedFaults(step=(7.0, -3600.0), no_video=((6.0, 9.0),)), duration_s=9.0)
    assert shown[-1].now_us < shown[0].now_us


@pytest.mark.slow
@pytest.mark.parametrize("faults", [HOLE, FAILS])
def test_held_boxes_are_logged_once(tmp_path, faults):
    folder, shown = flown(tmp_path, 5.0, faults)
    rows = list(csv.DictReader((folder / "identity.csv").read_text().splitlines()))
    seen = [(str(now.t_us), str(now.frame)) for now in shown for box in now.boxes if not (now.held or box.coasting)]
    assert [(row["time_us"], row["frame"]) for row in rows] == seen


@pytest.mark.slow
def test_the_name_of_a_vehicle_that_is_contested_meanwhile_is_not_held(tmp_path):
    _, shown = flown(tmp_path, 5.0, InjectedFaults(no_video=((7.0, 11.0),), impostor=(6.5, 13.0)))
    contested = [now for now in shown if any(row.contested for row in now.vehicles)]
    assert contested
    for now in contested:
        doubted = {row.system_id for row in now.vehicles if row.contested}
        assert not doubted & {box.system_id for box in now.boxes}


@pytest.mark.slow
def test_alarms_neither_come_nor_go_by_holding(tmp_path):
    _, shown = flown(tmp_path, 2.0, InjectedFaults())
    raised = {alarm.key for now in shown for alarm in now.alarms}
    assert raised <= {"no keys", "video clock"}
