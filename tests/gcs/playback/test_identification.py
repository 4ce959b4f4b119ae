"""Identification as programs call it: files and a roll call, and not a word printed."""

import json
import math
from dataclasses import replace
from statistics import median

import pytest

from gcs.errors import SessionError
from gcs.mission.mission import load_mission
from gcs.mission.written import save_mission
from gcs.playback.identification import identify_session
from gcs.report.score import score_files
from gcs.session.event_log import VIDEO_AWAITED, append_event, read_events
from gcs.session.session import open_session
from gcs.snapshot import Event
from infra.session_format import EVENTS, IDENTITY_EVIDENCE
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import Scenario, ScenarioDeclared
from tests.support.bundled import CURVED_ROAD, shortened, swarm_session


def test_it_writes_what_the_command_writes_and_prints_nothing(tmp_path, capfd):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))
    done, notes = [], []
    calls = identify_session(
        session, tmp_path / "out", report=lambda now, total: done.append((now, total)), note=notes.append
    )
    assert capfd.readouterr() == ("", "")
    assert done == [(k + 1, 5) for k in range(5)]
    assert calls.named >= 5
    assert all("\n" not in text for text in notes)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"identity.csv", "identity.jsonl", "events.jsonl"}


@pytest.mark.slow
def test_alarms_are_told_in_words(tmp_path):
    flown, notes = Scenario(seed=5, duration_s=14.0, fps=4.0), []
    other = replace(flown, seed=6, ground=replace(flown.ground, kind="curved", speed_mps=8.0, bend_deg=60.0))
    write_session(flown, tmp_path / "flown", film=other)
    identify_session(open_session(tmp_path / "flown"), tmp_path / "out", note=notes.append)
    (told,) = (text for text in notes if text.startswith("alarm at "))
    assert told.endswith(" s: video and telemetry do not match: clock, camera, place or recording")


@pytest.mark.slow
@pytest.mark.parametrize("flight_waited", [False, True])
def test_a_film_that_begins_late_was_waited_for_only_where_the_flight_says_so(tmp_path, flight_waited):
    folder = shortened(CURVED_ROAD, tmp_path / "flown", 5)
    header, *rows = (folder / "frames.csv").read_text().splitlines()
    times = [(index, int(t_us) + 18_000_000) for index, t_us in (row.split(",") for row in rows)]
    (folder / "frames.csv").write_text("\n".join([header, *(f"{index},{t_us}" for index, t_us in times)]))
    if flight_waited:
        waits_us = times[0][1] - 18_000_000
        append_event(folder / EVENTS, Event(t_us=waits_us, level="info", kind="video", text=VIDEO_AWAITED))
    notes = []
    identify_session(open_session(folder), tmp_path / "out", note=notes.append)
    told = [*notes, (tmp_path / "out" / EVENTS).read_text()]
    assert any("no video comes" in text for text in told) == flight_waited, told


@pytest.mark.slow
def test_it_overwrites_nothing(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))
    identify_session(session, tmp_path / "out")
    before = (tmp_path / "out" / "identity.csv").read_bytes()
    with pytest.raises(SessionError, match=r"identity\.csv"):
        identify_session(session, tmp_path / "out")
    assert (tmp_path / "out" / "identity.csv").read_bytes() == before


def test_what_is_broken_off_leaves_nothing(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))

    def fail(now, total):
        assert not (tmp_path / "out" / "identity.csv").exists()
        raise RuntimeError(f"{now} of {total}")

    with pytest.raises(RuntimeError, match="1 of 5"):
        identify_session(session, tmp_path / "out", report=fail)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 5))
    other = tmp_path / "out" / "identity.jsonl"
    with pytest.raises(SessionError, match=r"identity\.jsonl: exists already"):
        identify_session(session, tmp_path / "out", report=lambda *_: other.write_text("another's"))
    assert other.read_text() == "another's"
    assert not (tmp_path / "out" / "identity.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("offset_s", [-3.0, 2.0])
def test_a_film_dated_seconds_wrong_is_named_from_its_first_second_on(tmp_path, offset_s):
    timing = replace(Scenario().timing, video_offset_s=offset_s, declared_offset="zero")
    flown, notes = tmp_path / "flown", []
    write_session(replace(Scenario(seed=5, duration_s=14.0, fps=5.0), timing=timing), flown)
    identify_session(open_session(flown), tmp_path / "out", note=notes.append)
    (found,) = (float(text.split()[4]) for text in notes if text.startswith("the video's clock is "))
    assert found == pytest.approx(abs(offset_s), abs=0.25)
    assert not any("do not match" in text for text in notes), "what the first look said does not hold"
    score = score_files(flown / "truth.csv", tmp_path / "out" / "identity.csv")
    assert score.right > 0.95 and score.precision > 0.99


@pytest.mark.slow
def test_places_are_compared_at_the_time_of_a_film_that_is_late(tmp_path):
    scenario = Scenario(seed=5, duration_s=22.0, fps=5.0)
    timing = replace(scenario.timing, video_offset_s=4.0, declared_offset="zero")
    write_session(replace(scenario, timing=timing), tmp_path / "flown")
    identify_session(open_session(tmp_path / "flown"), tmp_path / "out", hindsight=False)
    events, _ = read_events(tmp_path / "out" / "events.jsonl")
    (found_us,) = {event.t_us for event in events if "the video's clock differs" in event.text}
    accused = [event for event in events if "contradicts" in event.text and event.level == "alarm"]
    assert not [event for event in accused if event.t_us > found_us - 8_000_000]
    rows = map(json.loads, (tmp_path / "out" / IDENTITY_EVIDENCE).read_text().splitlines())
    away_m = [row["residual_m"] for row in rows if row["time_us"] > found_us and row["system_id"]]
    assert len(away_m) > 50 and median(away_m) < 2.0


def test_of_telemetry_alone_it_is_told_what_is_missing(tmp_path):
    log = shortened(CURVED_ROAD, tmp_path / "flown", 20) / "telemetry.tlog"
    (tmp_path / "flight.tlog").write_bytes(log.read_bytes())
    notes = []
    calls = identify_session(open_session(tmp_path / "flight.tlog"), tmp_path / "out", note=notes.append)
    assert calls.named == 0
    assert notes[-1] == (
        "there is neither a video nor boxes seen in one: give the film with --video, its camera with --mission"
    )
    assert not any("detected in the video" in note for note in notes)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("across_deg", "pitch_deg", "yaw_deg", "mount"),
    [(70.0, -50.0, 90.0, "stabilized"), (100.0, -35.0, 180.0, "fixed"), (40.0, -85.0, 0.0, "stabilized")],
)
def test_a_camera_that_nothing_describes_is_found(tmp_path, across_deg, pitch_deg, yaw_deg, mount):
    scenario, flown, notes = Scenario(seed=5, duration_s=16.0, fps=2.0), tmp_path / "flown", []
    focal_px = scenario.camera.width / 2.0 / math.tan(math.radians(across_deg) / 2.0)
    camera = replace(scenario.camera, fx=focal_px, fy=focal_px, pitch_deg=pitch_deg, yaw_deg=yaw_deg, mount=mount)
    attitude = replace(scenario.attitude, gimbal=False)
    write_session(replace(scenario, camera=camera, attitude=attitude), flown)
    session = open_session(flown, frame_size=(camera.width, camera.height))
    identify_session(
        replace(session, mission=replace(session.mission, camera=None)), tmp_path / "out", note=notes.append
    )
    (told,) = (text for text in notes if "nothing describes the camera; by the whole film" in text)
    seen_deg, down_deg = (float(part.split()[-1]) for part in told.split("°")[:2])
    assert seen_deg == pytest.approx(across_deg, rel=0.08) and down_deg == pytest.approx(-pitch_deg, abs=5.0)
    assert ("fixed" in told) == (mount == "fixed")
    score = score_files(flown / "truth.csv", tmp_path / "out" / "identity.csv")
    assert score.right > 0.95 and score.precision > 0.99


@pytest.mark.slow
def test_a_fleet_that_stands_shows_no_camera(tmp_path):
    scenario = Scenario(seed=5, duration_s=16.0, fps=2.0)
    scenario = replace(scenario, ground=replace(scenario.ground, kind="parked"))
    write_session(replace(scenario, attitude=replace(scenario.attitude, gimbal=False)), tmp_path / "flown")
    session = open_session(tmp_path / "flown", frame_size=(scenario.camera.width, scenario.camera.height))
    calls = identify_session(replace(session, mission=replace(session.mission, camera=None)), tmp_path / "out")
    assert calls.named == 0
    events = (tmp_path / "out" / "events.jsonl").read_text()
    assert "nothing describes the camera, and the fleet stands still" in events


@pytest.mark.slow
def test_a_direction_that_is_written_as_nan_is_unknown(tmp_path):
    """A heading of "nan", by numpy and pandas: the row has its box all the same."""
    flown = swarm_session(tmp_path, frames=20)
    path = flown / "detections.csv"
    head, *rows = path.read_text().splitlines()
    assert head.endswith(",heading")
    path.write_text("\n".join([head, *(row.rpartition(",")[0] + ",nan" for row in rows)]))
    calls = identify_session(open_session(flown), tmp_path / "out")
    assert calls.frames == 20 and calls.boxes > 50


@pytest.mark.slow
@pytest.mark.parametrize(("camera", "seconds"), [(True, 8.0), (False, 25.0)], ids=["described", "unknown"])
def test_a_saved_mission_gives_the_same_names_byte_for_byte(camera, seconds, tmp_path):
    scenario = replace(nominal(), duration_s=seconds, fps=5.0, declared=ScenarioDeclared(camera=camera))
    write_session(scenario, flight := tmp_path / "flight")
    saved, _ = save_mission(load_mission(flight / "session.toml"), {"1": "by its heartbeats"}, tmp_path)
    size = scenario.camera.width, scenario.camera.height
    named = identify_session(open_session(flight, frame_size=size), tmp_path / "own", hindsight=False)
    identify_session(open_session(flight, frame_size=size, mission=saved), tmp_path / "saved", hindsight=False)
    assert named.named > 3
    for name in ("identity.csv", "identity.jsonl"):
        assert (tmp_path / "own" / name).read_bytes() == (tmp_path / "saved" / name).read_bytes()


def test_frames_of_unknown_size_are_told_where_nothing_describes_the_camera(tmp_path):
    scenario = replace(nominal(), duration_s=2.0, declared=ScenarioDeclared(camera=False))
    write_session(scenario, tmp_path / "flight")
    size, notes = (scenario.camera.width, scenario.camera.height), list[str]()
    identify_session(open_session(tmp_path / "flight"), tmp_path / "out", note=notes.append)
    assert sum("give --frame-size" in note for note in notes) == 1
    identify_session(open_session(tmp_path / "flight", frame_size=size), tmp_path / "sized", note=notes.append)
    assert sum("give --frame-size" in note for note in notes) == 1
