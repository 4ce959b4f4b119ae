"""Names by hindsight: what a track turns out to be, from its first box on."""

from dataclasses import replace

import pytest

from gcs.playback.hindsight import AHEAD_S, by_hindsight
from gcs.playback.identification import identify_session
from gcs.report.score import score_files
from gcs.session.session import open_session
from gcs.snapshot import Candidate, Health
from sim.session import write_session
from sim.world.scenario import Scenario
from tests.support.bundled import CURVED_ROAD, shortened
from tests.support.snapshots import TWO_UGVS, box, snapshot

IDS = (2, 3)
FIT = Health(fit=1.0)


def told(track_id, p, **change):
    """A box of a track with the probability of each vehicle of ``IDS``, named where one is 0.7."""
    name = next((i for i, share in zip(IDS, p, strict=True) if share >= 0.7), 0)
    none = 1.0 - sum(p)
    candidates = tuple(
        Candidate(system_id=i, confidence=share, distance_m=float(i), against="why")
        for i, share in sorted(zip(IDS, p, strict=True), key=lambda pair: -pair[1])
    )
    sure = {"confidence": max(p) if name else none, "none_of_ours": none, "candidates": candidates, "residual_m": 0.5}
    return replace(box(track_id, name), **sure | change)


def film(*frames, health=FIT):
    """A snapshot for each list of boxes, ten a second; None is a frame that is missing."""
    return [
        replace(snapshot(k, boxes=boxes), health=health, seen_us=snapshot(k).t_us)
        for k, boxes in enumerate(frames)
        if boxes is not None
    ]


def names(snapshots):
    return [[box.system_id for box in snapshot.boxes] for snapshot in by_hindsight(snapshots, TWO_UGVS)]


def test_a_name_that_comes_late_was_there_from_the_first():
    late = film(*[[told(1, (0.3, 0.2))]] * 5, *[[told(1, (0.99, 0.0))]] * 50)
    assert names(late) == [[2]] * 55


def test_a_name_that_is_taken_back_was_never_known():
    taken_back = film(*[[told(1, (0.99, 0.0))]] * 30, *[[told(1, (0.0, 0.0))]] * 100)
    assert names(taken_back) == [[0]] * 130
    mended = film(*[[told(1, (0.03, 0.95))]] * 5, *[[told(1, (0.99, 0.0))]] * 100)
    assert names(mended) == [[2]] * 105


def test_a_doubt_for_a_while_is_none_and_a_track_that_changes_vehicles_changes_names():
    doubt = film(*[[told(1, (0.97, 0.02))]] * 30, *[[told(1, (0.4, 0.3))]] * 60, *[[told(1, (0.97, 0.02))]] * 30)
    assert names(doubt) == [[2]] * 120
    changed = film(*[[told(1, (1.0, 0.0))]] * 100, *[[told(1, (0.0, 1.0))]] * 300)
    assert names(changed)[:90] == [[2]] * 90
    assert names(changed)[100:] == [[3]] * 300


def test_what_comes_too_late_does_not_count():
    ahead = round(10 * AHEAD_S)
    late = film(*[[told(1, (0.0, 0.0))]] * (2 * ahead), *[[told(1, (0.99, 0.0))]] * ahead)
    given = names(late)
    assert given[:ahead] == [[0]] * ahead
    assert given[-ahead:] == [[2]] * ahead


@pytest.mark.parametrize(("missing", "same"), [(5, True), (8, False)])
def test_a_track_that_was_out_of_sight_for_long_may_be_another_vehicle(missing, same):
    before, after = [[told(1, (0.95, 0.04))]] * 20, [[told(1, (0.0, 0.99))]] * 60
    given = names(film(*before, *[[]] * missing, *after))
    assert given[0] == ([3] if same else [2])
    assert given[-1] == [3]


def test_few_frames_a_second_are_no_gaps():
    slow = [replace(s, t_us=10 * s.t_us, seen_us=10 * s.t_us) for s in film(*[[told(1, (0.3, 0.2))]] * 2)]
    slow += [
        replace(s, t_us=10 * s.t_us, seen_us=10 * s.t_us) for s in film(None, None, *[[told(1, (0.99, 0.0))]] * 10)
    ]
    assert names(slow) == [[2]] * 12


def test_frames_before_film_and_telemetry_fit_tell_nothing():
    unfit = film(*[[told(1, (0.0, 0.0))]] * 60, health=Health(fit=0.1))
    fit = film(*[None] * 60, *[[told(1, (0.9, 0.0))]] * 60)
    assert names(unfit + fit) == [[2]] * 120
    assert names(unfit) == [[0]] * 60


def test_what_the_operator_stated_stays():
    stated = film(*[[told(1, (0.99, 0.0), stated=True)]] * 5, *[[told(1, (0.0, 0.99))]] * 60)
    given = list(by_hindsight(stated, TWO_UGVS))
    assert [s.boxes[0].system_id for s in given] == [2] * 5 + [3] * 60
    assert given[0].boxes[0].stated


def test_one_name_for_one_box():
    both = film(*[[told(1, (0.8, 0.0)), told(2, (0.95, 0.0))]] * 3)
    (given, *_) = by_hindsight(both, TWO_UGVS)
    assert [box.system_id for box in given.boxes] == [0, 2]
    assert given.boxes[0].confidence == pytest.approx(0.2, abs=2e-3)
    assert {row.system_id: (row.track_id, row.standing) for row in given.vehicles[1:]} == {
        2: (2, "confirmed"),
        3: (0, "no position"),
    }


def test_evidence_is_that_of_the_name():
    (first, *_) = by_hindsight(film([told(1, (0.2, 0.7))], *[[told(1, (0.99, 0.0))]] * 40), TWO_UGVS)
    (told_box,) = first.boxes
    assert (told_box.system_id, told_box.residual_m) == (2, 2.0)
    assert [c.system_id for c in told_box.candidates] == [2, 3]
    assert told_box.candidates[0].confidence == pytest.approx(told_box.confidence)
    assert {c.against for c in told_box.candidates} == {""}
    (kept,) = next(by_hindsight(film([told(1, (0.9, 0.0))]), TWO_UGVS)).boxes
    assert kept.residual_m == 0.5


def test_both_parts_of_a_vehicle_have_its_name():
    parts = film(
        *[[told(1, (0.1, 0.8)), replace(told(1, (0.1, 0.8)), track_id=0)]] * 2,
        *[[told(1, (0.99, 0.0)), replace(told(1, (0.99, 0.0)), track_id=0)]] * 30,
    )
    assert names(parts) == [[2, 2]] * 32


def test_a_mission_that_asks_for_more_gets_fewer_names():
    careful = replace(TWO_UGVS, identity=replace(TWO_UGVS.identity, threshold=0.95))
    frames = film(*[[told(1, (0.85, 0.0))]] * 30)
    assert [s.boxes[0].system_id for s in by_hindsight(frames, TWO_UGVS)] == [2] * 30
    assert [s.boxes[0].system_id for s in by_hindsight(frames, careful)] == [0] * 30


@pytest.mark.parametrize("back_us", [300_000, 3_600_000_000])
def test_a_clock_that_is_set_back_begins_anew(back_us):
    frames = film(*[[told(1, (1.0, 0.0))]] * 20)
    later = film(*[None] * 20, *[[told(1, (0.0, 1.0))]] * 20)
    frames += [replace(s, t_us=s.t_us - back_us, seen_us=s.t_us - back_us) for s in later]
    kept, total = by_hindsight(iter(frames), TWO_UGVS), 0
    for given, asked in zip(kept, frames, strict=True):
        assert given.t_us == asked.t_us
        assert given.boxes[0].system_id == asked.boxes[0].system_id
        assert given.boxes[0].confidence <= 1.0
        total += 1
    assert total == 40


def test_every_frame_comes_once_and_in_order():
    frames = film(*[[told(1, (0.99, 0.0))] if k % 3 else [] for k in range(400)])
    assert [s.t_us for s in by_hindsight(frames, TWO_UGVS)] == [s.t_us for s in frames]


@pytest.mark.slow
def test_recordings_that_no_flight_of_ours_kept_are_named_by_hindsight(tmp_path):
    session = open_session(shortened(CURVED_ROAD, tmp_path / "flown", 60))
    for name, wish in (("rule", None), ("hindsight", True), ("seen", False)):
        identify_session(session, tmp_path / name, hindsight=wish)
    table = {name: (tmp_path / name / "identity.csv").read_bytes() for name in ("rule", "hindsight", "seen")}
    assert table["rule"] == table["hindsight"] != table["seen"]
    score = {name: score_files(CURVED_ROAD / "truth.csv", tmp_path / name / "identity.csv") for name in table}
    assert score["hindsight"].right >= score["seen"].right > 0.0
    assert score["hindsight"].precision == 1.0
    assert score["hindsight"].ece < score["seen"].ece


@pytest.mark.slow
def test_a_film_of_another_fleet_gets_no_sure_name(tmp_path):
    """On a screen the first seconds can look alike; afterwards it is known that they were not."""
    for name, seed in (("one", 3), ("other", 4)):
        write_session(Scenario(seed=seed, duration_s=20.0, fps=5.0), tmp_path / name)
    for part in ("frames.csv", "detections.csv", "truth.csv"):
        (tmp_path / "one" / part).write_bytes((tmp_path / "other" / part).read_bytes())
    identify_session(open_session(tmp_path / "one"), tmp_path / "out")
    rows = (tmp_path / "out" / "identity.csv").read_text().splitlines()[1:]
    named = [float(cells[4]) for cells in (row.split(",") for row in rows) if cells[3]]
    assert len(rows) > 100
    assert max(named, default=0.0) < 0.9
