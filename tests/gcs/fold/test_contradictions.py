"""A vehicle that lies about its place is told as one until its reports fit the picture again, seen or not."""

from types import SimpleNamespace

import numpy as np
import pytest

from gcs.fold.contradictions import Contradictions
from tests.support.alarm_scenes import OTHER, UGV, copied, filmed

KEY = f"conflict {UGV}"
WORDS = "its position contradicts the video"


def on(snapshot):
    return KEY in {alarm.key for alarm in snapshot.alarms}


def played(
    contradictions, frames, residual_m=(), *, first_us=0, step_s=0.2, conflict=(), contested=(), fleet=range(11, 17)
):
    """Frames in which the first vehicles are tracks 1, 2, … so far from where they report to be; when the next is."""
    k, ids = len(residual_m), np.array(fleet)
    empty = np.zeros((k, 0))
    found = SimpleNamespace(
        track_id=np.arange(1, k + 1),
        system_id=ids[:k],
        confidence=np.full(k, 0.95),
        residual_m=np.array(residual_m, float),
        position_age_s=np.full(k, 0.1),
        conflict=list(conflict),
        candidates=SimpleNamespace(system_id=empty.astype(int), distance_m=empty, report_age_s=empty),
    )
    places = np.outer(ids, [100.0, 0.0, 0.0])
    state = SimpleNamespace(system_id=ids, std_m=np.ones(len(ids)), p_enu=places, contested=frozenset(contested))
    step_us = round(step_s * 1e6)
    for t_us in range(first_us, first_us + frames * step_us, step_us):
        contradictions.update(t_us, found, state, seen=found.track_id.tolist(), stated=())
    return first_us + frames * step_us


@pytest.mark.parametrize(("accused", "stands"), [(2, True), (3, False)])
def test_where_most_are_accused_at_once_and_none_fits_it_is_the_camera(accused, stands):
    contradictions, conflict = Contradictions(), range(11, 11 + accused)
    played(contradictions, 10, conflict=conflict)
    assert contradictions.standing == (set(conflict) if stands else set())


def test_frames_that_are_far_apart_accuse_nobody_and_acquit():
    contradictions = Contradictions()
    at_us = played(contradictions, 20, [40.0, 0.3], step_s=3.0, conflict=[11])
    assert not contradictions.standing
    at_us = played(contradictions, 20, [40.0, 0.3], first_us=at_us)
    assert contradictions.standing == {11}
    played(contradictions, 5, [0.3, 0.3], first_us=at_us, step_s=3.0)
    assert not contradictions.standing


@pytest.mark.parametrize("how", [{"residual_m": [40.0, 0.3, 0.3]}, {"residual_m": [0.3, 0.3], "conflict": [11]}])
def test_what_several_send_in_its_name_accuses_nobody(how):
    contradictions = Contradictions()
    at_us = played(contradictions, 20, [0.3, 0.3])
    at_us = played(contradictions, 20, first_us=at_us, contested=[11], **how)
    assert not contradictions.standing and not contradictions.suspected
    played(contradictions, 20, first_us=at_us, **how)
    assert contradictions.standing == {11}


def test_who_leaves_the_fleet_is_accused_no_more():
    contradictions = Contradictions()
    at_us = played(contradictions, 20, [40.0, 0.3])
    assert contradictions.standing == {11}
    at_us = played(contradictions, 2, [0.3], first_us=at_us, fleet=range(12, 17))
    assert not contradictions.standing
    played(contradictions, 2, [0.3, 0.3], first_us=at_us)
    assert not contradictions.standing


@copied
def lying(shift_m):
    """A scene in which one has lied for six seconds, and its snapshots from when that was told."""
    scene = filmed(10)
    assert scene.row(UGV).standing == "confirmed"
    scene.vehicles[1].shift_m = shift_m
    began_us = scene.t_us
    scene.run(6, filmed=True)
    told = next(k for k, snapshot in enumerate(scene.kept) if on(snapshot))
    assert scene.kept[told].t_us - began_us < 4_000_000
    return scene, told


@pytest.mark.slow
@pytest.mark.parametrize("shift_m", [15.0, 40.0])
def test_it_is_over_when_the_report_fits_again_and_not_when_its_box_is_gone(shift_m):
    scene, told = lying(shift_m)
    scene.hidden = {UGV}
    scene.run(6, filmed=True)
    scene.run(3)
    scene.hidden = set()
    scene.run(3, filmed=True)
    assert all(on(snapshot) for snapshot in scene.kept[told:])
    scene.vehicles[1].shift_m = 0.0
    scene.run(11, filmed=True)
    assert not on(scene.last) and scene.row(UGV).standing == "confirmed"
    assert not any(f"conflict {OTHER}" in {alarm.key for alarm in each.alarms} for each in scene.kept)


@pytest.mark.slow
def test_a_name_that_is_lost_by_it_is_not_given_again_and_why_is_told():
    scene, told = lying(40.0)
    scene.run(8, filmed=True)
    names = [UGV in {box.system_id for box in snapshot.boxes} for snapshot in scene.kept[told:]]
    gone = names.index(False)
    assert not any(names[gone:])
    assert scene.lost(UGV)[-1] == WORDS
    candidates = [each for box in scene.last.boxes for each in box.candidates if each.system_id == UGV]
    assert candidates and all(each.against.startswith(WORDS) for each in candidates)
    row = scene.row(UGV)
    assert (row.standing, row.in_view, row.position_state) == ("misplaced", None, "ok")


@pytest.mark.slow
def test_a_name_under_that_alarm_is_never_confirmed():
    scene, told = lying(15.0)
    standings = {row.standing for each in scene.kept[told:] for row in each.vehicles if row.system_id == UGV}
    assert "confirmed" not in standings
    assert scene.row(OTHER).standing == "confirmed"


@pytest.mark.slow
def test_one_that_leaves_the_picture_with_its_position_is_not_accused():
    scene = filmed(10)
    scene.hidden = {UGV}
    scene.run(6, filmed=True)
    scene.hidden = set()
    scene.run(4, filmed=True)
    assert not any(snapshot.conflicts for snapshot in scene.kept)


@pytest.mark.slow
def test_of_two_that_report_one_place_the_one_that_was_there_before_is_not_accused():
    scene = filmed(8)
    copier, copied = scene.vehicles[1], next(each for each in scene.vehicles if each.system_id == OTHER)
    copier.place = copied.place
    scene.run(10, filmed=True)
    assert on(scene.last)
    assert not any(OTHER in snapshot.conflicts for snapshot in scene.kept)
    assert scene.row(OTHER).standing == "confirmed"


@pytest.mark.parametrize(("apart_s", "accused"), [(0.5, {UGV}), (4.0, set())])
def test_frames_that_follow_no_track_accuse_nobody(apart_s, accused):
    columns = ("track_id", "system_id", "confidence", "residual_m", "position_age_s")
    watch, none = Contradictions(), dict.fromkeys(columns, np.empty(0))
    found = SimpleNamespace(**none, candidates=SimpleNamespace(), conflict=(UGV,))
    state = SimpleNamespace(system_id=np.array([UGV]), std_m=np.ones(1), p_enu=np.zeros((1, 3)), contested=frozenset())
    for k in range(4):
        watch.update(round((9 + k * apart_s) * 1e6), found, state, seen=(), stated=())
    assert watch.standing == watch.suspected == accused


@pytest.mark.slow
def test_one_that_reports_to_be_where_a_silent_one_is_gets_not_its_name_and_its_own_box_is_no_stranger():
    scene = filmed(10)
    other = next(each for each in scene.vehicles if each.system_id == OTHER)
    own, others = (scene.box(system_id).track_id for system_id in (UGV, OTHER))
    other.sends = ""
    scene.run(6, filmed=True)
    scene.vehicles[1].place = other.place
    begun = len(scene.kept)
    scene.run(14, filmed=True)
    scene.hidden = {UGV}
    scene.run(6, filmed=True)
    scene.hidden = set()
    scene.run(4, filmed=True)
    assert own not in {box.track_id for box in scene.last.boxes}
    assert all(on(snapshot) for snapshot in scene.kept[begun + 20 :])
    for box in (box for snapshot in scene.kept[begun:] for box in snapshot.boxes):
        assert (box.track_id, box.system_id) != (others, UGV)
        assert box.track_id != own or not box.none_of_ours > 0.5
    assert scene.row(UGV).standing == "misplaced"


@pytest.mark.slow
def test_a_new_track_of_one_that_reports_to_be_out_of_view_is_no_stranger():
    scene, _ = lying(40.0)
    scene.hidden = {UGV}
    scene.run(4, filmed=True)
    scene.hidden = set()
    scene.run(5, filmed=True)
    (box,) = (box for box in scene.last.boxes if box.system_id != OTHER)
    assert (box.system_id, box.doubt) == (0, WORDS) and not box.none_of_ours >= 0.9
