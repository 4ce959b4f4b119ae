"""Names by the whole of a recording, from the front door: a fold, its evidence, and what comes of both."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from assoc.whole_flight.naming import segment_names
from gcs.playback.analysis import Analysis
from gcs.playback.hindsight import by_hindsight
from gcs.report.score import match, score
from gcs.session.frame_tables import read_truth
from gcs.session.identity_log import IdentityLog, read_identity
from gcs.session.session import open_session
from gcs.snapshot import Health
from sim.session import write_session
from sim.world.scenario import (
    Gnss,
    Scenario,
    ScenarioAttitude,
    ScenarioDetector,
    ScenarioGround,
    ScenarioTiming,
    Targets,
)
from tests.support.bundled import SWARM, shortened

MESSY = Scenario(
    seed=7,
    duration_s=30.0,
    fps=5.0,
    ground=ScenarioGround(kind="straight", vehicles=6),
    gnss=Gnss(white_m=0.4, bias_m=2.0),
    attitude=ScenarioAttitude(compass_bias_deg=8.0),
    timing=ScenarioTiming(rate_min_hz=1.0, rate_max_hz=2.0),
    detector=ScenarioDetector(miss=0.2, miss_run_s=1.5),
    targets=Targets(lookalikes=3),
)


def folded(folder):
    """A session's snapshots and its evidence."""
    analysis = Analysis(open_session(folder))
    evidence = analysis.keep_evidence()
    try:
        return list(analysis.snapshots(images=False)), analysis.mission, evidence
    finally:
        analysis.close()


def scored(snapshots, folder, out):
    out.mkdir()
    with IdentityLog(out) as log:
        for snapshot in snapshots:
            log.write(snapshot)
    return score(match(read_truth(folder / "truth.csv"), read_identity(out / "identity.csv")))


@pytest.mark.slow
def test_ordinary_errors_together_are_named_better_by_the_whole(tmp_path):
    folder = tmp_path / "messy"
    write_session(MESSY, folder)
    snapshots, mission, evidence = folded(folder)
    alone = scored(by_hindsight(snapshots, mission), folder, tmp_path / "alone")
    whole = scored(by_hindsight(snapshots, mission, evidence), folder, tmp_path / "whole")
    assert whole.precision > 0.99
    assert whole.right > max(0.95, alone.right)
    assert whole.wrong_sure_s == 0.0
    assert whole.ece_all < alone.ece_all
    assert whole.ece < 0.01


@pytest.fixture(scope="module")
def fold(tmp_path_factory):
    return folded(shortened(SWARM, tmp_path_factory.mktemp("recorded") / "flown", 60))


@pytest.fixture
def flown(fold):
    snapshots, mission, evidence = fold
    return snapshots, mission, deepcopy(evidence)


def test_every_frame_comes_once_and_in_order(flown):
    snapshots, mission, evidence = flown
    given = list(by_hindsight(snapshots, mission, evidence))
    assert [s.t_us for s in given] == [s.t_us for s in snapshots]
    assert [len(s.boxes) for s in given] == [len(s.boxes) for s in snapshots]


def test_stretches_join_without_a_seam(flown, monkeypatch):
    """Named in stretches of 3 s, each by what was seen 3 s about it."""
    snapshots, mission, evidence = flown
    whole = [[box.system_id for box in s.boxes] for s in by_hindsight(snapshots, mission, evidence)]
    monkeypatch.setattr("gcs.playback.whole_flight._STRETCH_S", 3.0)
    monkeypatch.setattr("gcs.playback.whole_flight._MARGIN_S", 3.0)
    pieces = [[box.system_id for box in s.boxes] for s in by_hindsight(snapshots, mission, evidence)]
    assert len(pieces) == len(whole)
    assert np.mean([a == b for a, b in zip(whole, pieces, strict=True)]) > 0.95


def test_a_clock_that_is_set_back_loses_no_frame(flown):
    snapshots, mission, evidence = flown
    hour_us = 3_600_000_000
    back = [replace(s, t_us=s.t_us - hour_us, seen_us=s.seen_us and s.seen_us - hour_us) for s in snapshots]
    given = list(by_hindsight([*snapshots, *back], mission, evidence))
    assert [s.t_us for s in given] == [s.t_us for s in [*snapshots, *back]]


@pytest.mark.parametrize("fit", [0.2, float("nan")])
def test_what_film_and_telemetry_do_not_fit_in_is_left_as_it_is(flown, fit):
    snapshots, mission, evidence = flown
    other = [replace(s, health=replace(s.health or Health(), fit=fit)) for s in snapshots]
    alone, whole = by_hindsight(other, mission), by_hindsight(other, mission, evidence)
    assert [s.boxes for s in alone] == [s.boxes for s in whole]


def test_evidence_of_another_fleet_is_not_used(flown):
    snapshots, mission, evidence = flown
    evidence.system_ids = (1, 2)
    alone, whole = by_hindsight(snapshots, mission), by_hindsight(snapshots, mission, evidence)
    assert [s.boxes for s in alone] == [s.boxes for s in whole]


def test_names_stay_where_the_arithmetic_fails(flown, monkeypatch):
    snapshots, mission, evidence = flown

    def fails(*_):
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr("gcs.playback.whole_flight.segment_names", fails)
    alone, whole = by_hindsight(snapshots, mission), by_hindsight(snapshots, mission, evidence)
    assert [s.boxes for s in alone] == [s.boxes for s in whole]


@pytest.mark.parametrize(
    ("alone", "named"), [(0.99, True), (0.95, False)], ids=["known by itself", "not known by itself"]
)
def test_a_track_that_is_known_by_itself_and_nobodys_by_the_whole_has_a_tentative_name(
    flown, monkeypatch, alone, named
):
    snapshots, mission, evidence = flown
    n = len(mission.ugv_ids)
    by_itself = np.full(n + 1, (1.0 - alone) / n)
    by_itself[0] = alone
    monkeypatch.setattr("gcs.playback.hindsight._Course.at", lambda *_: by_itself)
    monkeypatch.setattr(
        "gcs.playback.whole_flight.segment_names",
        lambda *args: replace(names := segment_names(*args), p=np.eye(n + 1)[np.full(len(names.p), n)]),
    )
    monkeypatch.setattr("gcs.playback.whole_flight._MIN_GAIN", -1.0)
    given = [box for s in by_hindsight(snapshots, mission, evidence) for box in s.boxes if not box.coasting]
    told = {box.confidence for box in given if box.system_id == mission.ugv_ids[0]}
    assert bool(told) == named
    assert all(mission.identity.threshold <= confidence < 0.9 for confidence in told)


@pytest.mark.parametrize("gives_names", [True, False])
def test_a_box_that_may_be_a_strangers_has_no_sure_name_in_any_stretch(flown, monkeypatch, gives_names):
    """Also in a stretch in which the whole gives fewer names than the tracks by themselves."""
    snapshots, mission, evidence = flown
    n = len(mission.ugv_ids)

    def doubtful(*args):
        names = segment_names(*args)
        return replace(
            names, also=np.full_like(names.also, n), p=names.p if gives_names else np.full_like(names.p, np.nan)
        )

    def seen_and_named():
        boxes = (box for s in by_hindsight(snapshots, mission, evidence) for box in s.boxes)
        return [box for box in boxes if box.system_id and not box.coasting]

    sure = seen_and_named()
    monkeypatch.setattr("gcs.playback.whole_flight.segment_names", doubtful)
    halved = seen_and_named()
    assert sure
    assert not halved


@pytest.mark.parametrize(("times", "sure"), [(1.6, False), (1.2, True)])
def test_a_box_that_is_longer_than_its_vehicle_has_no_sure_name(flown, monkeypatch, times, sure):
    snapshots, mission, evidence = flown
    usual_m, t0_us, t1_us = 2.0, snapshots[0].t_us, snapshots[-1].t_us

    def is_long(at_us):
        return 0.5 <= (at_us - t0_us) / (t1_us - t0_us) < 0.6

    def with_lengths(*args):
        names = segment_names(*args)
        length_m = {(at_us, track): usual_m * (times if is_long(at_us) else 1.0) for at_us, track in names.segments.of}
        return replace(names, segments=replace(names.segments, length_m=length_m))

    monkeypatch.setattr("gcs.playback.whole_flight.segment_names", with_lengths)
    given = [(s.seen_us, box) for s in by_hindsight(snapshots, mission, evidence) for box in s.boxes if box.system_id]
    long = [box.confidence for at_us, box in given if is_long(at_us) and not box.coasting]
    others = [box.confidence for at_us, box in given if not is_long(at_us) and not box.coasting]
    assert min(len(long), len(others)) > 10 and np.median(others) > 0.95
    assert np.median(long) > 0.95 if sure else max(long) <= 0.75


def test_what_the_operator_stated_stays(flown):
    snapshots, mission, evidence = flown
    track = next(box.track_id for box in snapshots[-1].boxes if box.system_id)
    other = next(i for i in mission.ugv_ids if i != snapshots[-1].boxes[0].system_id)

    def stated(snapshot):
        boxes = (
            replace(box, system_id=other, stated=True, confidence=0.95) if box.track_id == track else box
            for box in snapshot.boxes
        )
        return replace(snapshot, boxes=tuple(boxes))

    for snapshot in by_hindsight(map(stated, snapshots), mission, evidence):
        assert all(box.system_id == other for box in snapshot.boxes if box.track_id == track)
