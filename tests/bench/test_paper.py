"""The published experiments: flights, windows, methods against their literal peers, tables."""

from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from assoc.methods.belief import fuse, masses
from assoc.methods.topology import associate_by_topology, topology_angles, topology_cost
from bench.latency import literal
from bench.latency.measure import MethodTiming, crowd, snap, timed
from bench.paper import figures
from bench.paper.experiments import CONTINUOUS, Condition, Count, conditions, evaluate
from bench.paper.films import dense_road, false_box_road, field, film, paper_road
from bench.paper.methods import METHODS, ConditionNoise
from bench.paper.occlusion import KEEPERS, ByteTrack, Kept, hidden_at_turns, walk
from bench.paper.projection import associate_by_projection
from bench.paper.tables import percent, pooled, published_at, write_tables
from bench.paper.tts import associate_by_tts_once, tts_similarity
from bench.paper.windows import windows
from bench.rows import read, write
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


def test_dense_windows_keep_within_their_span():
    found = windows(film(short(dense_road("straight", 1))), 12, 1, boxes=9, visible=9, span_m=28.0)
    for window in found:
        p = window.p_enu[..., :2]
        assert np.linalg.norm(p[:, :, None] - p[:, None], axis=-1).max() <= 28.0


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
@pytest.mark.parametrize("name", ["projection", "TTS", "mean residual", "identifier", "least squares, true places"])
def test_without_noise_everybody_is_found(cut, name):
    right = sum(np.sum(METHODS[name](w, QUIET).vehicle == w.vehicle) for w in cut)
    assert right >= 11


@pytest.mark.slow
def test_the_identifier_does_without_yaw_and_headings_and_stands_noise(cut):
    noise = ConditionNoise(position_m=2.0, topology=2.0, report_every=2)
    for name in ("identifier, yaw unknown", "identifier, no headings"):
        assert np.sum(METHODS[name](cut[0], noise).vehicle == cut[0].vehicle) >= 5


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


@pytest.mark.parametrize("size", [(4, 3), (5, 4), (5, 5)])
def test_projection_is_that_of_the_loops_written_out(size):
    for seed in range(2):
        s = snap(*size, seed)
        ours = associate_by_projection(s.x, s.y).vehicle.tolist()
        assert literal.projection(s.x, s.y).tolist() == ours
        assert literal.projection_array_loop(s.x, s.y).tolist() == ours


def test_surplus_boxes_are_left_out_as_in_the_loops():
    s = snap(4, 4, 1)
    x = s.x[:, :3]
    ours = associate_by_projection(x, s.y).vehicle.tolist()
    assert ours.count(-1) == 1
    assert literal.projection(x, s.y).tolist() == literal.projection_array_loop(x, s.y).tolist() == ours


def test_topology_and_fusion_are_those_of_the_loops_written_out():
    s = snap(7, 6, 3)
    image, world = s.y[-1] * (1.0, -1.0), s.x[-1, :, :2]
    cost, answer = literal.topology(image, s.front, world, s.heading, 0.4)
    ours = topology_cost(topology_angles(image, s.front), topology_angles(world, s.heading, 0.4))
    np.testing.assert_allclose(ours, cost, atol=1e-9)
    assert associate_by_topology(ours).tolist() == answer.tolist()
    np.testing.assert_allclose(fuse(masses(s.errors), masses(s.cost)), literal.fusion(s.errors, s.cost), atol=1e-12)


@pytest.mark.parametrize("size", [(4, 4), (9, 6), (5, 9)])
def test_triangular_sequences_are_compared_as_in_the_loops(size):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        image, world = (
            10.0 * rng.permutation(np.argwhere(np.ones((6, 6))))[:n] + rng.uniform(-3, 3, (n, 2)) for n in size
        )
        similarity, answer = literal.tts(image, world)
        np.testing.assert_allclose(tts_similarity(image, world), similarity, atol=1e-9)
        assert associate_by_tts_once(similarity).tolist() == answer.tolist()


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
def test_a_condition_counts_boxes_and_lists_what_was_missed():
    condition = Condition(
        experiment="false box",
        case="look-alike",
        noise=ConditionNoise(position_m=6.0, topology=6.0),
        methods=("projection", "TTS", "identifier"),
        flights=(short(false_box_road("look-alike", 1)),),
        boxes=7,
        most=2,
    )
    counts, misses = evaluate(condition)
    assert [c.method for c in counts] == ["projection", "TTS", "identifier"]
    assert all((c.frames, c.ours, c.false) == (24, 12, 2) for c in counts)
    assert counts[0].named == 12
    wrong = 14 - counts[2].right - counts[2].excluded
    assert len(misses) == wrong


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
    (total,), _ = evaluate(condition)
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


def test_rows_come_back_from_their_file(tmp_path):
    rows = [count(), count(sigma_m=0.25, case="straight")]
    write(tmp_path / "rows.csv", Count, rows)
    assert read(tmp_path / "rows.csv", Count) == rows


def test_tables_show_published_theirs_and_ours_side_by_side(tmp_path):
    ours = count(method="identifier", named=11, right=11)
    kept = [Kept(keeper="ByteTrack", seed=1, frames=10, hidden=2, switches=2, taken=0)]
    write_tables(tmp_path, [count(), ours], kept, quick=True)
    line = next(x for x in (tmp_path / "figure_7.md").read_text().splitlines() if x.startswith("| 1 | 73.32"))
    assert line == "| 1 | 73.32 | 75.00 | 100.00 / 91.67 |"
    assert "| projection | 99.07 / 100.00 |" not in (tmp_path / "table_2.md").read_text()
    assert "| ByteTrack | 10 | 2 | 2 | 0 |" in (tmp_path / "occlusion.md").read_text()


def test_measured_times_stand_beside_the_published_ones(tmp_path):
    (tmp_path / "latency").mkdir()
    timing = MethodTiming.of("projection", "ours", (7, 6), [0.004], [0.004])
    write(tmp_path / "latency" / "latency.csv", MethodTiming, [timing])
    (tmp_path / "paper").mkdir()
    write_tables(tmp_path / "paper", [], [], quick=False)
    text = (tmp_path / "paper" / "table_1.md").read_text()
    assert "| projection | 148.49 | ours 4.00 |" in text and "| TTS | 22.52 | not measured yet" in text


def test_figures_are_left_out_where_they_cannot_be_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "find_spec", lambda name: None)
    assert figures.draw(tmp_path) is False
    assert "pip install matplotlib" in figures.MATPLOTLIB_MISSING


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


def test_times_are_of_single_calls():
    cpu, wall, results = timed(lambda k: np.array([k]), 3)
    assert len(cpu) == len(wall) == 3 and [int(r[0]) for r in results] == [0, 1, 2]
    timing = MethodTiming.of("x", "y", (7, 6), [0.001, 0.003, 0.002], [0.1, 0.1, 0.1])
    assert timing.cpu_median_ms == pytest.approx(2.0) and timing.wall_p95_ms == pytest.approx(100.0)


def test_a_crowd_is_wholly_in_the_image():
    assert film(crowd(20, 1.0)).seen.all()
