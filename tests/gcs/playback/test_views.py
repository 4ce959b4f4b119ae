"""Two cameras over one fleet: each view is named, and shown in a replay."""

import shutil

import pytest

from gcs.errors import SessionError
from gcs.playback.identification import identify_session
from gcs.playback.replay import Replay
from gcs.report.score import score_files
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.scenario import Blackout, Gnss, Scenario, ScenarioFlight, ScenarioGround, ScenarioView
from tests.support.waiting import until

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
    assert (calls.films, other.films) == ("UAV", "UAV-2")
    other.films = calls.films
    assert calls.of(2) is other and calls.of(1) is calls.of(3) is calls
    for folder in ("", "view-2"):
        found = score_files(flight / folder / "truth.csv", out / folder / "identity.csv")
        assert (found.precision, found.wrong_sure_s) == (1.0, 0.0)
        assert found.coverage == 1.0
    with pytest.raises(SessionError, match="exists already"):
        identify_session(open_session(flight), out)


@pytest.mark.slow
def test_names_of_one_view_alone(flight, named, tmp_path):
    out, _ = named
    identify_session(open_session(flight / "view-2"), tmp_path / "out", hindsight=False)
    assert (tmp_path / "out" / "identity.csv").read_bytes() == (out / "view-2" / "identity.csv").read_bytes()


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


def test_a_camera_that_recorded_nothing_is_none(flight, tmp_path):
    shutil.copytree(flight, tmp_path / "flight", ignore=shutil.ignore_patterns("view-2"))
    (tmp_path / "flight" / "view-2").mkdir()
    assert open_session(tmp_path / "flight").other_views == ()
