"""Two cameras over one fleet: each view is named, and shown in a replay."""

import shutil
from itertools import islice

import pytest

from gcs.errors import SessionError
from gcs.fold.view_exchange import ViewExchange
from gcs.playback.analysis import Analysis
from gcs.playback.identification import identify_session
from gcs.playback.in_step import _heard_in
from gcs.playback.replay import Replay
from gcs.report.score import score_files
from gcs.session.frame_tables import read_times
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.scenario import Blackout, Gnss, Scenario, ScenarioFlight, ScenarioGround, ScenarioView
from tests.support.waiting import until
from vision.errors import VideoError

FLIGHT = Scenario(
    duration_s=10.0,
    fps=5.0,
    gnss=Gnss(bias_m=1.5),
    ground=ScenarioGround(kind="formation", vehicles=4, spacing_m=9.0),
    views=(
        ScenarioView(
            flight=ScenarioFlight(yaw_deg=70.0, height_m=30.0), blackouts=(Blackout(start_s=-1.0, stop_s=6.0),)
        ),
    ),
)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("views") / "flight"
    write_session(FLIGHT, folder)
    return folder


@pytest.fixture(scope="module")
def named(flight):
    out = flight.parent / "out"
    return out, identify_session(open_session(flight), out, hindsight=False)


@pytest.mark.slow
def test_both_views_are_named(flight, named):
    out, calls = named
    (other,) = calls.other_views
    assert (calls.uav_name, other.uav_name) == ("UAV", "UAV-2")
    other.uav_name = calls.uav_name
    assert calls.of(2) is other and calls.of(1) is calls.of(3) is calls
    for folder in ("", "view-2"):
        found = score_files(flight / folder / "truth.csv", out / folder / "identity.csv")
        assert (found.precision, found.wrong_sure_s) == (1.0, 0.0)
        assert found.coverage == 1.0
    with pytest.raises(SessionError, match="exists already"):
        identify_session(open_session(flight), out)


def test_a_mission_of_one_camera_says_which_recordings_it_leaves_aside(flight, tmp_path):
    text = (flight / "session.toml").read_text()
    (alone := tmp_path / "alone.toml").write_text(text[: text.index("[[view]]")])
    session = open_session(flight, mission=alone)
    assert (session.unnamed_views, session.other_views) == (("view-2",), ())
    assert open_session(flight).unnamed_views == open_session(flight / "view-2").unnamed_views == ()
    analysis = Analysis(session)
    analysis.close()
    told = [line for line in analysis.warnings if "left aside" in line]
    assert told == ["view-2: left aside, since the mission has no [[view]] for what is recorded there"]


@pytest.mark.slow
def test_each_view_hears_what_the_others_took_before(flight, monkeypatch):
    heard, told = [], ViewExchange.frames_of_others

    def noted(self, uav_id, frame):
        left = told(self, uav_id, frame)
        heard.append((uav_id, frame, {other: each[-1].frame for other, each in left.items()}))
        return left

    monkeypatch.setattr(ViewExchange, "frames_of_others", noted)
    analysis = Analysis(open_session(flight))
    try:
        list(islice(analysis.snapshots(images=False), 40))
    finally:
        analysis.close()
    views = (flight, flight / "view-2")
    taken_us = {k: read_times(view / "frames.csv").times_us for k, view in enumerate(views, 1)}
    assert {uav_id for uav_id, _, _ in heard} == {1, 2} and any(of for _, _, of in heard)
    for uav_id, frame, of in heard:
        for other, last in of.items():
            assert taken_us[other][last] < taken_us[uav_id][frame] <= taken_us[other][last + 1]


def test_another_camera_that_breaks_off_costs_no_name(flight, monkeypatch):
    fold = Analysis.folded

    def broken(self, exchange, flown=()):
        yield from islice(fold(self, exchange, flown), 5)
        raise VideoError("view-2: torn")

    monkeypatch.setattr(Analysis, "folded", broken)
    analysis = Analysis(open_session(flight))
    try:
        texts = [e.text for now in islice(analysis.snapshots(images=False), 12) for e in now.events]
    finally:
        analysis.close()
    assert "what another camera saw does not count from here on: view-2: torn" in texts


@pytest.mark.slow
def test_names_of_one_view_alone(flight, named, tmp_path):
    out, _ = named
    identify_session(open_session(flight / "view-2"), tmp_path / "out", hindsight=False)
    assert (tmp_path / "out" / "identity.csv").read_bytes() == (out / "view-2" / "identity.csv").read_bytes()


@pytest.mark.slow
def test_a_replay_goes_from_camera_to_camera(flight):
    first = Replay(open_session(flight))
    try:
        first.seek(first.start_us + 8_000_000)
        first.set_speed(0.1)
        assert until(lambda: (now := first.latest()) and any(row.elsewhere == ("UAV-2",) for row in now.vehicles))
        assert [row.role for row in first.latest().vehicles][:3] == ["uav", "uav", "ugv"]
        assert len(first.latest().footprints_elsewhere) == 1
        second = first.next_view()
        assert second is not first and (second.playing, first.playing, second.speed) == (True, False, 0.1)
        assert abs(second.now_us - first.now_us) < 2_000_000
        assert [view.title.split(" (")[0] for view in (first, second)] == ["flight from UAV", "flight from UAV-2"]
        assert second.next_view() is first and first.next_view() is second
    finally:
        first.stop()
    assert not any(thread.is_alive() for view in (first, second) for thread in view._threads)


@pytest.mark.parametrize(
    ("text", "heard", "told"),
    [
        (None, {}, ""),
        ("frame,camera,of_frame\n3,2,4\n3,256,5\n4,2,4\n", {3: {2: 4, 256: 5}, 4: {2: 4}}, ""),
        ("frame,camera,of_frame\n3,2,4\nx,2,4\n4,900,4\n", {3: {2: 4}}, "elsewhere.csv: 2 rows could not be read"),
        ("frame,of\n3,2\n", None, "column 'camera' is missing"),
        ("", None, "is missing"),
    ],
)
def test_what_a_camera_heard_in_flight_may_be_damaged(text, heard, told, tmp_path):
    if text is not None:
        (tmp_path / "elsewhere.csv").write_text(text)
    found, trouble = _heard_in(tmp_path)
    assert found == heard and told in trouble and bool(told) == bool(trouble)


def test_another_mission_is_that_of_all_cameras(flight, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text((flight / "session.toml").read_text().replace('"UGV-11"', '"Alpha"', 1))
    session = open_session(flight, mission=own)
    assert [each.mission.name_of(11) for each in (session, *session.other_views)] == ["Alpha", "Alpha"]


def test_a_camera_that_recorded_nothing_is_none(flight, tmp_path):
    shutil.copytree(flight, tmp_path / "flight", ignore=shutil.ignore_patterns("view-2"))
    (tmp_path / "flight" / "view-2").mkdir()
    assert open_session(tmp_path / "flight").other_views == ()
