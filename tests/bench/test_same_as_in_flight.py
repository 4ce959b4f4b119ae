"""A flight that is identified again says the same of every box, whatever went wrong in it."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tests.support.scripted as scripted
from gcs.cli.identify import identify_into
from gcs.errors import SessionError
from gcs.fold.pipeline import Pipeline
from gcs.playback.analysis import Analysis
from gcs.playback.as_flown import FlownReports
from gcs.playback.opened_session import OpenedSession
from gcs.session.event_log import read_events
from gcs.session.fold_order import FoldOrder
from gcs.session.session import open_session
from gcs.snapshot import FleetChange, Statement
from sim.world.presets import nominal
from sim.world.scenario import ScenarioDetector, ScenarioGround
from tests.support.scripted import CAMERA, SECRET, InjectedFaults, fly

SCENARIO = replace(nominal(3), ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0), duration_s=10.0)
HARDLY_SEEN = replace(SCENARIO, detector=ScenarioDetector(miss=0.1, weak=0.7, weak_clutter=4.0))

FLIGHTS = {
    "another size, a second link, an impostor, processes killed": InjectedFaults(
        resized_s=6.0, second_link_s=1.2, impostor=(4.0, 7.0), killed_s=(3.0, 8.0)
    ),
    "switched off and on, no frames, late stamps, nothing seen": InjectedFaults(
        restart=(3.0, 5.5), no_video=((3.5, 6.5),), late_stamp_s=0.361, no_detections=(8.5, 9.2)
    ),
    "signed and forged, the clock set ahead, no telemetry, a broken detector": InjectedFaults(
        signed=True, step=(5.0, 3600.0), no_telemetry=(2.0, 3.5), detector_fails=(7.0, 7.5)
    ),
    "the clock set back, too much to keep up with, the station speaks": InjectedFaults(
        step=(7.0, -0.4), ring_bytes=8192, fold_stalled=(3.0, 5.0), station_sends=True
    ),
}


FIRST, *MORE = FLIGHTS


@pytest.fixture(scope="module", params=[FIRST, *(pytest.param(name, marks=pytest.mark.slow) for name in MORE)])
def flown(request, tmp_path_factory):
    """A session folder and the faults in it."""
    faults = FLIGHTS[request.param]
    return fly(tmp_path_factory.mktemp("flown"), HARDLY_SEEN, faults), faults


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def complaints(capsys):
    return capsys.readouterr().err


@pytest.mark.slow
def test_every_row_is_the_same_again(flown, tmp_path):
    folder, _ = flown
    identify_into(open_session(folder), tmp_path / "again")
    for name in ("identity.csv", "identity.jsonl"):
        live, again = ((place / name).read_text().splitlines() for place in (folder, tmp_path / "again"))
        assert again == live
    named = sum(row["system_id"] != "" for row in rows(folder / "identity.csv"))
    assert named > 80, "a flight that names nobody is no test"


class InTurns(scripted.ScriptedDetector):
    """Sees the script's boxes in the parts that it is asked for, of pictures too large to be looked at as a whole."""

    frame_px, part_price = 400_000.0, 1.0

    def scale(self, gsd_m):
        return 4.0

    def detect_in(self, image, parts, *, gsd_m):
        kept = replace(self.boxes, looked=np.array([part.kept for part in parts]))
        return self.boxes.select(kept.looked_at(kept.centre))


@pytest.mark.slow
def test_a_flight_that_looks_in_turns_is_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setattr(scripted, "ScriptedDetector", InTurns)
    folder = fly(tmp_path / "flown", replace(SCENARIO, duration_s=6.0), InjectedFaults())
    identify_into(open_session(folder), tmp_path / "again")
    live, again = ((place / "identity.csv").read_text() for place in (folder, tmp_path / "again"))
    assert again == live and sum(row["system_id"] != "" for row in rows(folder / "identity.csv")) > 40
    assert len(rows(folder / "looks.csv")) > len({row["frame"] for row in rows(folder / "frames.csv")}) / 2


def test_the_troubles_came(flown):
    folder, faults = flown
    assert (folder / "clock.csv").exists() == (faults.step is not None)
    assert (folder / "refused.csv").exists() == faults.signed
    assert (folder / "unfolded.csv").exists() == faults.station_sends
    assert len(list(folder.glob("telemetry*.tlog"))) == 1 + len(faults.killed_s)
    turns = FoldOrder.read(folder).turns
    frames = len(rows(folder / "frames.csv"))
    assert sum(turn.frame >= 0 for turn in turns) < frames, "frames are skipped"
    half = (CAMERA.width // 2, CAMERA.height // 2)
    assert (half in {turn.size for turn in turns}) == (faults.resized_s is not None)
    said = (folder / "events.jsonl").read_text()
    assert ("two senders use system id" in said) == (faults.impostor is not None)
    assert ("has rebooted" in said) == (faults.restart is not None)
    assert (folder / "faults.txt").exists() == (faults.detector_fails is not None)


def test_what_was_reported_lies_within_the_flight(flown):
    opened = OpenedSession.open(open_session(flown[0]))
    first_us, last_us = opened.known_us.min() - 1_000_000, opened.known_us.max() + 1_000_000
    assert all(first_us <= event.t_us <= last_us for event in FlownReports.of(opened)[0].flown)


def test_every_frame_has_one_snapshot(flown):
    folder, _ = flown
    analysis = Analysis(open_session(folder))
    shown = list(analysis.snapshots())
    assert [snapshot.frame for snapshot in shown] == list(range(len(analysis.times_us)))
    looked = {turn.frame for turn in FoldOrder.read(folder).turns}
    assert not any(snapshot.new_boxes for snapshot in shown if snapshot.frame not in looked)
    assert all(len(snapshot.vehicles) == 1 + len(SCENARIO.ugv_ids) for snapshot in shown)


@pytest.mark.slow
def test_who_signed_in_flight_has_signed_in_a_replay(tmp_path):
    folder = fly(tmp_path / "flown", replace(SCENARIO, duration_s=2.0), InjectedFaults(signed=True))
    *_, last = Analysis(open_session(folder)).snapshots()
    assert all(row.signed > 0 and not row.unsigned for row in last.vehicles)
    assert last.vehicles[1].bad_signature > 0


@pytest.mark.slow
def test_a_packet_that_cannot_be_worked_on_costs_no_replay(tmp_path, monkeypatch):
    def feed(self, packet):
        if packet.message_id == 0:
            raise ValueError("odd")
        heard(self, packet)

    heard = Pipeline.add_packet
    monkeypatch.setattr(Pipeline, "add_packet", feed)
    folder = fly(tmp_path / "flown", replace(SCENARIO, duration_s=3.0), InjectedFaults())
    for name in ("flown", "by time"):
        if name == "by time":
            (folder / "folds.csv").unlink()
        analysis = Analysis(open_session(folder, frame_size=(CAMERA.width, CAMERA.height)))
        events = [event.text for snapshot in analysis.snapshots() for event in snapshot.events]
        assert analysis.faults > 10
        assert sum("a fault of this program was passed over" in text for text in events) == 1


@pytest.mark.slow
def test_after_a_restart_the_fleet_is_named_again(tmp_path):
    """Also where the recording keeps no order and frames are missing in between."""
    folder = fly(tmp_path / "flown", SCENARIO, InjectedFaults(restart=(3.0, 5.5), no_video=((3.0, 6.0),)))
    for order in ("kept", "lost"):
        if order == "lost":
            (folder / "folds.csv").unlink()
        flown = open_session(folder, frame_size=(CAMERA.width, CAMERA.height))
        identify_into(flown, tmp_path / order, hindsight=False)
        last = [row for row in rows(tmp_path / order / "identity.csv") if int(row["frame"]) > 40]
        assert len(last) > 10
        # a UAV that has moved on meanwhile at 9 m/s takes some frames to be placed again
        assert sum(row["system_id"] != "" for row in last) > 0.6 * len(last)


@pytest.fixture(scope="module")
def sizeless(tmp_path_factory):
    """A recording that does not say how large its frames were."""
    folder = fly(tmp_path_factory.mktemp("sizeless"), SCENARIO, InjectedFaults())
    (folder / "folds.csv").unlink()
    return folder


@pytest.fixture
def old(sizeless, tmp_path):
    return Path(shutil.copytree(sizeless, tmp_path / "old"))


@pytest.mark.slow
def test_frames_of_unknown_size_are_measured_by_the_reports(old, tmp_path, capsys):
    named = identify_into(open_session(old), tmp_path / "again").named
    said = complaints(capsys)
    assert "how large the frames were is not recorded: 640×360 is taken" in said
    assert "folds.csv is missing" in said
    live = {(row["frame"], row["cx"], row["cy"]): row["system_id"] for row in rows(old / "identity.csv")}
    again = {
        (row["frame"], row["cx"], row["cy"]): row["system_id"] for row in rows(tmp_path / "again" / "identity.csv")
    }
    assert named and sum(again.get(box) == name for box, name in live.items()) > 0.97 * len(live)


@pytest.mark.slow
def test_boxes_that_fit_no_size_are_of_another_flight(old, tmp_path, capsys):
    boxes = rows(old / "detections.csv")
    for row in boxes:
        # as another film might show them, along an edge of the picture where no vehicle reports to be
        row["cx"] = f"{40 + float(row['cx']) / 16:.2f}"
    with (old / "detections.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, boxes[0])
        table.writeheader()
        table.writerows(boxes)
    calls = identify_into(open_session(old), tmp_path / "again")
    assert not calls.named and calls.boxes
    assert "boxes and reports fit no size" in complaints(capsys)
    assert "video and telemetry do not match" in (tmp_path / "again" / "events.jsonl").read_text()


@pytest.mark.slow
def test_where_nothing_tells_the_size_nobody_is_named(old, tmp_path, capsys):
    detections = old / "detections.csv"
    header, *boxes = detections.read_text().splitlines(keepends=True)
    detections.write_text(header + "".join(row for row in boxes if int(row.split(",")[0]) < 15))
    calls = identify_into(open_session(old), tmp_path / "again")
    assert not calls.named and calls.boxes
    assert "nothing is named; give --frame-size" in complaints(capsys)
    assert "nothing can be named" in (tmp_path / "again" / "events.jsonl").read_text()
    assert identify_into(open_session(old, frame_size=(640, 360)), tmp_path / "told").named


@pytest.mark.slow
def test_a_size_that_cannot_be_is_refused(old, tmp_path):
    with pytest.raises(SessionError, match="outside frames of 320×180"):
        identify_into(open_session(old, frame_size=(320, 180)), tmp_path / "again")


def test_a_size_against_the_recordings_own_is_refused(flown, tmp_path):
    folder, _ = flown
    with pytest.raises(SessionError, match="leave --frame-size out"):
        identify_into(open_session(folder, frame_size=(800, 450)), tmp_path / "again")


@pytest.mark.slow
def test_what_a_recording_lacks_is_said(tmp_path, capsys):
    folder = fly(tmp_path / "flown", replace(SCENARIO, duration_s=4.0), InjectedFaults(signed=True))
    identify_into(open_session(folder), tmp_path / "whole")
    whole = complaints(capsys)
    assert not any(word in whole for word in ("is missing", "lacks records", "has not the boxes", "recorded by"))
    notes = open_session(folder).notes
    assert set(notes.keys) == {str(i) for i in (1, *SCENARIO.ugv_ids)}
    assert SECRET.hex() not in (folder / "session.toml").read_text()
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    lines = (copy / "detections.csv").read_text().splitlines(keepends=True)
    (copy / "detections.csv").write_text("".join(lines[:-5]))
    (copy / "senders.csv").unlink()
    toml = (copy / "session.toml").read_text()
    (copy / "session.toml").write_text(toml.replace('program = "rollcall-gcs', 'program = "rollcall-gcs 0.0.0 or'))
    refused = (copy / "refused.csv").read_text().splitlines(keepends=True)
    (copy / "refused.csv").write_text("".join(refused[:-5]))
    identify_into(open_session(copy), tmp_path / "lacking")
    said = complaints(capsys)
    assert "it has not the boxes that the flight found" in said
    assert "senders.csv is missing" in said
    assert "recorded by rollcall-gcs 0.0.0" in said
    assert f"the flight rejected {len(refused) - 1} records" in said


@pytest.mark.slow
def test_what_the_operator_stated_is_stated_again_at_the_same_frame(tmp_path, monkeypatch):
    """A wrong name, none of ours, a name confirmed and one withdrawn."""

    class OperatedPipeline(Pipeline):
        last = None

        def add_frame(self, index, t_us, **given):
            boxes = [box for box in self.last.boxes if box.system_id] if self.last else []
            self.count = getattr(self, "count", -1) + 1
            if self.count in STATEMENTS:
                self.state_name(STATEMENTS[self.count](boxes))
            self.last = super().add_frame(index, t_us, **given)
            return self.last

    monkeypatch.setattr("tests.support.scripted.Pipeline", OperatedPipeline)
    folder = fly(tmp_path / "flown", SCENARIO, InjectedFaults(no_video=((6.0, 6.6),)))
    identify_into(open_session(folder), tmp_path / "again")
    for name in ("identity.csv", "identity.jsonl"):
        live, again = ((place / name).read_text().splitlines() for place in (folder, tmp_path / "again"))
        assert again == live
    said, again = (
        [event for event in read_events(place / "events.jsonl")[0] if event.kind == "operator"]
        for place in (folder, tmp_path / "again")
    )
    assert again == said and [event.statement.undone for event in said if event.statement] == [False] * 3 + [True]
    stated = [row for row in (folder / "identity.jsonl").read_text().splitlines() if '"stated":true' in row]
    assert len(stated) > 20


@pytest.mark.slow
def test_a_fleet_that_was_changed_in_flight_is_changed_again_at_the_same_turn(tmp_path, monkeypatch):
    """Taken in, renamed, left out, taken in again; frames come late, and there is a hole in the video."""
    first, *others, last = SCENARIO.ugv_ids
    changes = {
        20: FleetChange(what="added", system_id=last),
        28: FleetChange(what="renamed", system_id=others[0], name="[b]Alpha"),
        34: FleetChange(what="left out", system_id=first),
        35: FleetChange(what="left out", system_id=first),
        60: FleetChange(what="added", system_id=first),
    }

    def with_three(*about):
        mission = whole(*about)
        return replace(mission, ugv=mission.ugv[:-1])

    def change(flight, frame):
        flight.turns = getattr(flight, "turns", -1) + 1
        if flight.turns in changes:
            flight.pipeline.change_fleet(changes[flight.turns])

    whole, flown = scripted._mission, []
    monkeypatch.setattr(scripted, "_mission", with_three)
    folder = fly(tmp_path / "flown", SCENARIO, InjectedFaults(no_video=((6.0, 6.6),)), flown.append, change)
    session = open_session(folder)
    identify_into(session, tmp_path / "again")
    for name in ("identity.csv", "identity.jsonl"):
        live, again = ((place / name).read_text().splitlines() for place in (folder, tmp_path / "again"))
        assert again == live
    said, again = (
        [event for event in read_events(place / "events.jsonl")[0] if event.change]
        for place in (folder, tmp_path / "again")
    )
    assert again == said and [event.change.what for event in said] == ["added", "renamed", "left out", "added"]
    told = [event.text for shown in flown for event in shown.events]
    assert told.count("the fleet is not changed: UGV-11 is not in the fleet") == 1
    assert session.began.ugv_ids == SCENARIO.ugv_ids[:-1] and set(session.mission.ugv_ids) == set(SCENARIO.ugv_ids)
    assert {row.name for row in flown[-1].vehicles} == {"UAV", "UGV-11", "[b]Alpha", "UGV-13", "UGV-14"}
    names = [{box.system_id for box in shown.new_boxes} - {0} for shown in flown if shown.new_boxes]
    was = [{row.system_id for row in shown.vehicles if row.role == "ugv"} for shown in flown if shown.new_boxes]
    assert all(named <= fleet for named, fleet in zip(names, was, strict=True))
    assert all(named >= {*others} for named in names[1:]), "who stays is named on"
    assert names[-1] == {*SCENARIO.ugv_ids}


STATEMENTS = {
    16: lambda boxes: Statement(track_id=boxes[0].track_id, system_id=boxes[1].system_id),
    44: lambda boxes: Statement(track_id=boxes[1].track_id, system_id=boxes[1].system_id),
    52: lambda boxes: Statement(track_id=boxes[2].track_id, system_id=0),
    64: lambda boxes: Statement(track_id=0, system_id=0, undone=True),
}
"""By the turn of the fold before which the operator makes them."""
