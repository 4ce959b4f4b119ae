"""The published experiments: flights, windows, methods against their literal peers, tables."""

import csv
from dataclasses import fields, replace
from math import isnan

import numpy as np
import pytest

from bench.command_line import write_rows
from bench.latency import PartTiming, crowd, text_of
from bench.paper.experiments import CONTINUOUS, Condition, Count, conditions, evaluate
from bench.paper.films import false_box_road, field, film, paper_road, windows
from bench.paper.methods import METHODS, ConditionNoise, MethodTime, times
from bench.paper.occlusion import KEEPERS, ByteTrack, Kept, hidden_at_turns, walk
from bench.paper.tables import PUBLISHED_MS, percent, pooled, published_at, write_tables
from vision.detect.detections import Detections

QUIET = ConditionNoise(position_m=0.0, topology=0.0)


def short(scenario, seconds=2.4):
    return replace(scenario, duration_s=seconds)


@pytest.fixture(scope="module")
def cut():
    """Two windows on a curved road, the view turned by a quarter."""
    return windows(film(short(paper_road("curved", 90.0, 1))), 12, 1, boxes=6, visible=6)


def count(**changes):
    values = dict(
        experiment="figure 7", case="curved", rotation_deg=0.0, sigma_m=1.0, sigma_topology=1.0, method="projection",
        frames=24, ours=12, named=12, right=9, false=0, excluded=0,
    )  # fmt: skip
    return Count(**(values | changes))


# flights and windows


def test_six_vehicles_are_seen_and_the_seventh_only_reports():
    seen = film(short(paper_road("straight", 0.0, 2)))
    assert seen.seen[:, :6].all() and not seen.seen[:, 6].any()
    assert seen.vehicle.tolist() == list(range(7))
    assert seen.speed.min() > 1.0


def test_reports_have_no_error_but_the_one_that_is_asked_for():
    assert not film(short(paper_road("straight", 0.0, 2))).report_error.any()
    assert np.abs(film(short(field(1))).report_error).mean() > 0.3


def test_turning_the_view_turns_the_image():
    plain, turned = (film(short(paper_road("curved", yaw, 1))) for yaw in (0.0, 90.0))
    away = [f.uv[0, :6] - f.uv[0, :6].mean(axis=0) for f in (plain, turned)]
    # the UAV turns clockwise by 90°, the image anticlockwise: (u, v) → (v, −u)
    np.testing.assert_allclose(away[1], away[0][:, ::-1] * [1.0, -1.0], atol=25.0)


def test_false_boxes_belong_to_nobody():
    seen = film(short(false_box_road("look-alike", 1)))
    assert seen.vehicle.tolist() == [0, 1, 2, 3, 4, 5, -1]
    assert seen.seen.all()


def test_windows_follow_one_another_and_are_shuffled(cut):
    assert [w.start for w in cut] == [0, 12]
    assert all(sorted(w.vehicle.tolist()) == list(range(6)) for w in cut)
    assert cut[0].vehicle.tolist() != cut[1].vehicle.tolist()


def test_every_noise_level_scales_the_same_draws(cut):
    one, four = (cut[0].positions(s) - cut[0].p_enu for s in (1.0, 4.0))
    np.testing.assert_allclose(four, 4.0 * one)
    assert one.std() == pytest.approx(1.0, abs=0.25)
    assert np.abs(cut[0].positions(1.0, second=True) - cut[0].positions(1.0)).max() > 0.5


def test_windows_in_which_boxes_come_or_go_are_left_out():
    seen = film(short(paper_road("straight", 0.0, 2)))
    hole = replace(seen, seen=seen.seen.copy())
    hole.seen[15, 3] = False
    assert [w.start for w in windows(hole, 12, 1, boxes=6, visible=6)] == [0]


# methods


@pytest.mark.slow
@pytest.mark.parametrize("name", ["projection", "TTS", "mean residual", "identifier"])
def test_without_noise_everybody_is_found(cut, name):
    right = sum(np.sum(METHODS[name](w, QUIET).vehicle == w.vehicle) for w in cut)
    assert right >= 11


@pytest.mark.slow
def test_who_the_reports_come_from_is_what_decides(cut):
    w, order = cut[0], np.array([1, 2, 3, 4, 5, 0, 6])
    swapped = replace(w, p_enu=w.p_enu[:, order], heading=w.heading[:, order])
    said = METHODS["identifier"](swapped, QUIET).vehicle
    assert order[said].tolist() == w.vehicle.tolist()


@pytest.mark.slow
def test_fusion_names_every_box_with_a_mass(cut):
    answer = METHODS["fusion"](cut[0], ConditionNoise(position_m=1.0, topology=1.0))
    assert (answer.vehicle >= 0).all() and (answer.confidence > 1.0 / 7.0).all()


# experiments and tables


def test_every_condition_asks_methods_that_exist_about_more_than_a_thousand_frames():
    plan = conditions(quick=False)
    assert {m for c in plan for m in c.methods} <= {*METHODS, CONTINUOUS}
    roads = [c for c in plan if c.experiment.startswith("figure")]
    assert all(c.most * c.frames > 1000 for c in roads)
    assert sorted({c.noise.position_m for c in plan if c.experiment == "figure 7"}) == np.arange(0, 4.1, 0.25).tolist()
    assert sorted({c.noise.topology for c in plan if c.experiment == "figure 8"}) == list(range(11))
    nine = {(c.noise.position_m, c.noise.topology) for c in plan if c.experiment == "figure 9"}
    assert (0.25, 0.75) in nine and (4.0, 4.5) in nine
    assert len(conditions(quick=True)) < len(plan) / 3


@pytest.mark.slow
def test_a_condition_counts_boxes():
    condition = Condition(
        experiment="false box",
        case="look-alike",
        noise=ConditionNoise(position_m=6.0, topology=6.0),
        methods=("projection", "TTS", "identifier"),
        flights=(short(false_box_road("look-alike", 1)),),
        boxes=7,
        most=2,
    )
    counts = evaluate(condition)
    assert [c.method for c in counts] == ["projection", "TTS", "identifier"]
    assert all((c.frames, c.ours, c.false) == (24, 12, 2) for c in counts)
    assert counts[0].named == 12


@pytest.mark.slow
def test_the_continuous_identifier_is_asked_on_every_frame():
    noise, flights = ConditionNoise(position_m=0.0, topology=0.0), (short(field(1)),)
    condition = Condition(
        experiment="field",
        case="flights",
        noise=noise,
        methods=(CONTINUOUS,),
        flights=flights,
        frames=24,
        boxes=4,
        visible=3,
        most=9,
        wander=True,
    )
    (total,) = evaluate(condition)
    assert (total.ours, total.false) == (72, 24)


def test_shares_are_percentages_and_unknown_without_cases():
    c = count(named=10, right=9, ours=12, false=4, excluded=3)
    assert (c.precision, c.recall, c.fper) == (90.0, 75.0, 75.0)
    assert isnan(count().fper) and percent(count().fper) == "–"


def test_counts_are_added_up_over_what_is_left_open():
    some = [count(rotation_deg=0.0), count(rotation_deg=90.0, right=12), count(method="TTS")]
    both = pooled(some, "figure 7", "projection")
    assert (both.ours, both.right, both.frames) == (24, 21, 48)
    assert pooled(some, "figure 7", "projection", rotation_deg=90.0).right == 12
    assert pooled(some, "figure 8", "projection") is None


def test_published_lines_end_where_the_text_has_them():
    assert published_at("figure 7", "straight", 4.0) == pytest.approx(60.0, abs=2.0)
    assert published_at("figure 7", "curved", 4.0) == pytest.approx(50.0, abs=4.0)


def test_rows_are_written_with_their_names(tmp_path):
    write_rows(tmp_path / "rows.csv", Count, [count(), count(sigma_m=0.123456789, case="straight")])
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [each.name for each in fields(Count)]
    assert [(row["sigma_m"], row["case"]) for row in rows] == [
        (f"{count().sigma_m:g}", count().case),
        ("0.123457", "straight"),
    ]


def test_tables_show_published_theirs_and_ours_side_by_side(tmp_path):
    ours = count(method="identifier", named=11, right=11)
    kept = [Kept(keeper="ByteTrack", seed=1, frames=10, hidden=2, switches=2, taken=0)]
    write_tables(tmp_path, [count(), ours], kept, [MethodTime(method="TTS", cpu_ms=0.5)], quick=True)
    line = next(x for x in (tmp_path / "figure_7.md").read_text().splitlines() if x.startswith("| 1 | 73.32"))
    assert line == "| 1 | 73.32 | 75.00 | 100.00 / 91.67 |"
    assert "| projection | 99.07 / 100.00 |" not in (tmp_path / "table_2.md").read_text()
    assert "| ByteTrack | 10 | 2 | 2 | 0 |" in (tmp_path / "occlusion.md").read_text()
    assert "| TTS | 22.52 | 0.50 |" in (tmp_path / "table_1.md").read_text()


@pytest.mark.slow
def test_every_published_time_has_one_of_ours():
    assert all(one.cpu_ms > 0.0 for one in times(2))
    assert [one.method for one in times(1)] == list(PUBLISHED_MS)


# occlusion


def boxes(*centres):
    x = np.array(centres, float).reshape(-1, 2)
    same = np.ones(len(x))
    return Detections(
        cx=x[:, 0], cy=x[:, 1], w=40 * same, h=24 * same, angle=0 * same, score=0.9 * same, heading=np.nan * same
    )


def test_bytetrack_follows_and_loses_after_a_turn_in_hiding():
    tracker = ByteTrack()
    for k in range(6):
        assert tracker.update(boxes((100 + 5 * k, 100), (300, 300))).track_id.tolist() == [1, 2]
    for _ in range(12):
        tracker.update(boxes((300, 300)))
    seen = [tracker.update(boxes((130, 160), (300, 300))).track_id.tolist() for _ in range(2)]
    assert seen == [[2], [2, 3]]


def test_bytetrack_takes_up_a_lost_track_when_told():
    tracker = ByteTrack()
    for _ in range(3):
        tracker.update(boxes((100, 100)))
    tracker.update(boxes())
    again = tracker.update(boxes((160, 160)), lambda lost, centres: np.array([[0, 0]]))
    assert again.track_id.tolist() == [1] and again.cx.tolist() == [160.0]


def test_vehicles_are_hidden_where_they_turn():
    heading = np.zeros((280, 1))
    heading[140:150] = np.linspace(0, 1.5, 10)[:, None]
    heading[150:] = 1.5
    hidden = hidden_at_turns(heading, 10.0, np.random.default_rng(1))
    assert hidden[145, 0] and 10 <= hidden.sum() <= 24


@pytest.mark.slow
def test_every_keeper_follows_a_flight():
    what = walk(short(paper_road("curved", 0.0, 1), 2.0))
    for track, make in KEEPERS.values():
        keeper = make(what)
        step = track(what, keeper)
        for frame in range(len(what.detections)):
            tracks = step(frame)
            keeper.observe(frame, tracks)
        assert len(tracks) == 6


# latency


def test_times_are_those_of_single_frames():
    timing = PartTiming.of("tracker", 7, [0.001, 0.003, 0.002], [0.1, 0.1, 0.1])
    assert timing.cpu_median_ms == pytest.approx(2.0) and timing.wall_p95_ms == pytest.approx(100.0)
    assert "| tracker | 7 | 3 | 2.000 | 2.000 | 2.900 | 100.000 | 100.000 |" in text_of([timing])


def test_a_crowd_is_wholly_in_the_image():
    assert film(crowd(20, 1.0)).seen.all()
