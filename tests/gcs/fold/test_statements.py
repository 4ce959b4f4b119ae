"""What the operator states about boxes, from packets and boxes through the fold."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.fold.statements import Statements
from gcs.report.overlay import label_of
from gcs.session.box_table import box_values, csv_row, json_row
from gcs.session.event_log import event_row
from gcs.snapshot import Statement
from tests.support.alarm_scenes import MISSION, OTHER, UGV, FilmedScene, Vehicle, copied, filmed
from vision.track.track_state import ENOUGH

STRANGER = (0.0, 8.0)


def stated(scene, track, system_id, **change):
    scene.pipeline.state_name(Statement(track_id=track, system_id=system_id, **change))
    return scene


def undone(scene, track=0):
    return stated(scene, track, 0, undone=True)


def texts(scene):
    return [event.text for event in scene.events if event.kind == "operator"]


def made(scene):
    return [event.statement for event in scene.events if event.statement]


def unnamed(scene):
    return next(box for box in scene.last.boxes if not box.system_id)


@copied
def half_silent():
    return FilmedScene(Vehicle(OTHER, sends="ht")).run(3, filmed=True)


@pytest.fixture
def silent():
    """OTHER sends heartbeats alone: its box cannot be named by reports."""
    return half_silent()


@pytest.fixture
def sure():
    """Both are named."""
    return filmed(6)


@pytest.mark.slow
def test_a_vehicle_without_reports_is_named_by_the_operator(silent):
    track = unnamed(silent).track_id
    stated(silent, track, OTHER).run(3, filmed=True)
    box, row = silent.box(OTHER), silent.row(OTHER)
    assert box.track_id == track and box.stated and row.stated and row.standing == "confirmed"
    assert label_of(silent.last, box) == "UGV-12 stated"
    assert json.loads(json_row(silent.last, box))["stated"] is True
    assert "stated" not in json.loads(json_row(silent.last, silent.box(UGV)))
    assert len(csv_row(box_values(silent.last, box)).split(",")) == 13
    assert texts(silent) == [f"stated: track {track} is UGV-12"]


def test_the_event_says_which_box_of_which_frame(silent):
    box = unnamed(silent)
    stated(silent, box.track_id, OTHER).run(0.2, filmed=True)
    event = next(event for event in silent.events if event.statement)
    row = json.loads(event_row(event))
    assert row["kind"] == "operator" and row["system_id"] == OTHER
    said = row["statement"]
    assert (said["track_id"], said["system_id"], said["undone"]) == (box.track_id, OTHER, False)
    assert said["frame"] == silent.frames - 2
    assert abs(said["cx"] - box.cx) < 30 and abs(said["cy"] - box.cy) < 30


def test_one_key_withdraws_it(silent):
    track = unnamed(silent).track_id
    stated(silent, track, OTHER).run(2, filmed=True)
    undone(silent).run(2, filmed=True)
    assert not any(box.stated for box in silent.last.boxes) and unnamed(silent).track_id == track
    assert texts(silent)[-1].endswith("is UGV-12; withdrawn")
    assert [each.undone for each in made(silent)] == [False, True]
    undone(silent).run(0.2, filmed=True)
    assert len(made(silent)) == 2


@pytest.mark.slow
def test_a_wrong_statement_is_contradicted_within_seconds_and_names_are_right_again(sure):
    track = sure.box(UGV).track_id
    stated(sure, track, OTHER)
    sure.kept.clear()
    sure.run(12, filmed=True)
    wrong = [
        snapshot
        for snapshot in sure.kept
        if any(box.system_id not in (0, {track: UGV}.get(box.track_id, OTHER)) for box in snapshot.boxes)
    ]
    assert len(wrong) < 50
    assert sure.box(UGV).track_id == track and sure.box(OTHER).track_id != track
    assert not any(box.stated for box in sure.last.boxes)
    said = next(event for event in sure.events if "contradicted" in event.text)
    assert said.level == "warning" and "by its reports it is UGV-11" in said.text


def test_a_right_statement_confirms_and_is_shown_as_the_operators(sure):
    stated(sure, sure.box(UGV).track_id, UGV).run(4, filmed=True)
    assert sure.box(UGV).stated and sure.row(UGV).stated and not sure.box(OTHER).stated
    assert not any("contradicted" in text for text in texts(sure))


def test_said_twice_it_counts_once(sure):
    track = sure.box(UGV).track_id
    for _ in range(3):
        stated(sure, track, UGV).run(0.3, filmed=True)
    assert len(made(sure)) == 1


@pytest.mark.slow
def test_none_of_ours_is_a_statement_too(sure):
    sure.stranger = STRANGER
    sure.run(2, filmed=True)
    track = unnamed(sure).track_id
    stated(sure, track, 0).run(4, filmed=True)
    box = unnamed(sure)
    assert box.track_id == track and box.stated and label_of(sure.last, box) == "? stated"
    assert json.loads(json_row(sure.last, box))["stated"] is True


@pytest.mark.slow
def test_none_of_ours_about_one_of_ours_is_contradicted(sure):
    track = sure.box(UGV).track_id
    stated(sure, track, 0).run(1.5, filmed=True)
    assert unnamed(sure).track_id == track and unnamed(sure).stated
    sure.run(14, filmed=True)
    assert sure.box(UGV).track_id == track
    assert any("none of ours; contradicted: by its reports it is UGV-11" in text for text in texts(sure))


@pytest.mark.slow
def test_a_statement_ends_with_its_track(silent):
    silent.hidden = {OTHER}
    track = unnamed(silent).track_id
    stated(silent, track, OTHER).run(5, filmed=True)
    assert texts(silent)[-1] == f"stated: track {track} is UGV-12; it ended with the track"
    silent.hidden = set()
    silent.run(2, filmed=True)
    assert unnamed(silent).track_id != track and not unnamed(silent).stated


@pytest.mark.slow
def test_a_track_that_is_not_shown_for_a_moment_ends_no_statement(silent):
    track = unnamed(silent).track_id
    stated(silent, track, OTHER).run(1, filmed=True)
    silent.pipeline._seeing._tracker._state.evidence[:] = ENOUGH - 8.0
    silent.run(0.1, filmed=True)
    assert all(box.track_id != track for box in silent.last.boxes)
    silent.run(3, filmed=True)
    assert silent.box(OTHER).track_id == track and silent.box(OTHER).stated
    assert not any("ended" in text for text in texts(silent))


def test_a_statement_about_a_track_that_is_gone_is_not_used(sure):
    stated(sure, 9999, OTHER).run(0.3, filmed=True)
    assert texts(sure) == ["stated: track 9999 is UGV-12; not used: the track has ended"]
    assert not made(sure)


def test_of_two_statements_about_one_vehicle_the_later_counts(silent):
    silent.stranger = STRANGER
    silent.run(1, filmed=True)
    first, second = sorted(box.track_id for box in silent.last.boxes if not box.system_id)
    stated(silent, second, OTHER).run(1, filmed=True)
    assert silent.box(OTHER).track_id == second
    stated(silent, first, OTHER).run(1, filmed=True)
    assert silent.box(OTHER).track_id == first
    assert [box.track_id for box in silent.last.boxes if box.stated] == [first]
    assert any(text.endswith(f"it ends: that is track {first} now") for text in texts(silent))


@pytest.mark.slow
def test_a_statement_can_be_corrected(silent):
    silent.stranger = STRANGER
    silent.run(1, filmed=True)
    track = unnamed(silent).track_id
    stated(silent, track, OTHER).run(1, filmed=True)
    stated(silent, track, 0).run(1, filmed=True)
    assert next(box for box in silent.last.boxes if box.track_id == track).system_id == 0
    assert not any(box.system_id == OTHER for box in silent.last.boxes)


@pytest.mark.slow
def test_no_name_is_stated_while_several_senders_use_its_id(sure):
    stated(sure, sure.box(UGV).track_id, UGV).run(1, filmed=True)
    sure.vehicles.append(Vehicle(UGV, shift_m=40.0, peer=77))
    sure.run(10, filmed=True)
    assert sure.row(UGV).contested and not any(box.system_id == UGV for box in sure.last.boxes)
    assert not any("contradicted" in text for text in texts(sure))


@pytest.mark.slow
def test_a_statement_outlives_evidence_that_begins_anew(silent):
    stated(silent, unnamed(silent).track_id, OTHER).run(1, filmed=True)
    silent.pipeline._begin_anew()
    silent.run(3, filmed=True)
    assert silent.box(OTHER).stated


def test_only_ground_vehicles_of_the_mission_can_be_stated(sure):
    for system_id in (1, 99):
        with pytest.raises(ValueError, match="no ground vehicle"):
            stated(sure, 1, system_id)


@pytest.mark.slow
def test_a_recorded_statement_finds_its_box_under_another_track(silent):
    """Detected again, or with another mission, a replay may number its tracks otherwise."""
    box = unnamed(silent)
    again = replace(
        Statement(track_id=777, system_id=OTHER), frame=silent.frames + 5, cx=float(box.cx), cy=float(box.cy)
    )
    silent.pipeline.state_name(again)
    silent.run(0.5, filmed=True)
    assert not made(silent)
    silent.run(0.3, filmed=True)
    assert [(each.track_id, each.system_id) for each in made(silent)] == [(box.track_id, OTHER)]
    assert silent.box(OTHER).track_id == box.track_id
    # withdrawn by the number that it was recorded under
    undone(silent, 777).run(1, filmed=True)
    assert made(silent)[-1].undone and not any(box.stated for box in silent.last.boxes)


class Reviewed:
    """One statement, that track 1 is UGV, reviewed frame by frame beside what the reports say."""

    def __init__(self):
        self.statements, self.t_us, self.told = Statements(MISSION), 1_000_000, []
        tracks = SimpleNamespace(track_id=np.array([1]), cx=np.array([9.0]), cy=np.array([9.0]))
        self.identifier = SimpleNamespace(state=lambda *_: None, unstate=lambda *_: None)
        self.statements.make(Statement(track_id=1, system_id=UGV))
        self.statements.apply(self.t_us, 0, tracks, self.identifier)

    def see(self, frames, step_s, confidence):
        """Whether it ends: the reports have it for none of ours, as surely as that."""
        state = SimpleNamespace(contested=())
        found = SimpleNamespace(track_id=np.array([1]), system_id=np.array([0]), confidence=np.array([confidence]))
        for _ in range(frames):
            self.t_us += round(step_s * 1e6)
            self.told += self.statements.review(self.t_us, found, state, self.identifier, {1})
        return bool(self.told)


def test_what_is_not_sure_contradicts_nothing():
    review = Reviewed()
    assert not review.see(100, 0.2, 0.63)
    assert review.see(20, 0.2, 0.95)


def test_a_hole_in_the_video_contradicts_nothing_and_slow_frames_do():
    review = Reviewed()
    assert not review.see(5, 0.2, 0.95)
    assert not review.see(1, 8.0, 0.95) and not review.see(5, 0.2, 0.95)
    slow = Reviewed()
    assert slow.see(6, 2.0, 0.95)
