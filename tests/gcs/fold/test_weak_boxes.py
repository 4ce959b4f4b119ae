"""Recordings with boxes whose score is too low to count: who uses them, and who does not."""

import csv
from dataclasses import replace

import pytest

from gcs.cli.identify import identify_into
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import ScenarioDetector

OFTEN_MISSED = replace(nominal(5), duration_s=8.0, detector=ScenarioDetector(miss=0.4, miss_run_s=0.6))
HARDLY_SEEN = replace(OFTEN_MISSED, detector=replace(OFTEN_MISSED.detector, weak=1.0, weak_clutter=15.0))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """The same flight without and with weak boxes."""
    made = tmp_path_factory.mktemp("weak")
    for name, scenario in (("missed", OFTEN_MISSED), ("weak", HARDLY_SEEN)):
        write_session(scenario, made / name)
        identify_into(open_session(made / name), made / f"{name}.out")
    return made


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.mark.slow
def test_vehicles_are_followed_through_weak_boxes(folders):
    missed, weak = (rows(folders / f"{name}.out" / "identity.csv") for name in ("missed", "weak"))
    named = [sum(row["system_id"] != "" for row in each) for each in (missed, weak)]
    assert named[1] > 1.3 * named[0]
    tracks = [len({row["track_id"] for row in each}) for each in (missed, weak)]
    assert tracks[1] <= tracks[0]


@pytest.mark.slow
def test_what_no_track_takes_is_shown_only_where_it_counts(folders):
    recorded = rows(folders / "weak" / "detections.csv")
    assert sum(float(row["score"]) < 0.3 for row in recorded) > 0.5 * len(recorded)
    analysis = Analysis(open_session(folders / "weak"))
    shown = [box for snapshot in analysis.snapshots() for box in snapshot.boxes]
    assert all(box.score >= 0.3 for box in shown if not box.track_id)
    assert min(box.score for box in shown if box.track_id) < 0.3


@pytest.mark.slow
def test_the_mission_says_from_which_score_boxes_count(folders, tmp_path):
    session = open_session(folders / "weak")
    assert session.mission is not None
    mission = replace(session.mission, detector=replace(session.mission.detector, score=0.95))
    identify_into(replace(session, mission=mission), tmp_path / "strict")
    assert not rows(tmp_path / "strict" / "identity.csv")
