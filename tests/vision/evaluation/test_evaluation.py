"""Figures of detectors: average precision by hand and by another way, overlap by throwing darts, what never changes."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.films.labelled import found_of, truth_of
from training.quality import measure
from vision.detect.boxes import corners, rotated_iou
from vision.evaluation import LabelledImage, average_precision, choose, evaluate, match, shard_truth
from vision.evaluation.matching import ASIDE, FALSE_ALARM, overlap
from vision.evaluation.precision import balanced_score
from vision.evaluation.report import as_json, as_markdown
from vision.evaluation.sheet import TILE_PX, worst, worst_sheet
from vision.evaluation.truth import choose_classes

MODEST = settings(max_examples=25, deadline=None)
SIDE_PX = 400.0


def row(cx, cy=50.0, w=40.0, h=20.0, angle=0.3):
    return [cx, cy, w, h, angle]


def exact_ap(score, hit, objects):
    """Average precision in fractions: at each distinct recall, the best precision at that recall or more."""
    points = []
    for threshold in sorted(set(score), reverse=True):
        kept = [h for s, h in zip(score, hit, strict=True) if s >= threshold]
        points.append((Fraction(sum(kept), objects), Fraction(sum(kept), len(kept))))
    area, before = Fraction(0), Fraction(0)
    for recall in sorted({r for r, _ in points}):
        area += (recall - before) * max(p for r, p in points if r >= recall)
        before = recall
    return area


def darts(a, b, rng, n=200_000):
    """Intersection over union by throwing darts at the square around both."""
    rings = corners(np.array([a, b]))
    low, high = rings.min(axis=(0, 1)), rings.max(axis=(0, 1))
    dart = rng.uniform(low, high, (n, 2))
    inside = []
    for ring in rings:
        edge, way = np.roll(ring, -1, axis=0) - ring, dart[:, None] - ring
        inside.append((edge[:, 0] * way[..., 1] - edge[:, 1] * way[..., 0] >= 0.0).all(axis=1))
    return (inside[0] & inside[1]).sum() / max((inside[0] | inside[1]).sum(), 1)


@st.composite
def scenes(draw, most=6):
    """Objects on a lattice, so that none hides another, and detections that hit, miss or are nothing."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(1, most))
    place = rng.permutation(16)[:n]
    boxes = np.column_stack(
        [60.0 + 90.0 * (place % 4), 60.0 + 90.0 * (place // 4), rng.uniform(24, 44, n), rng.uniform(12, 20, n),
         rng.uniform(-3, 3, n)]
    )  # fmt: skip
    heading = np.mod(boxes[:, 4] + 0.5 * np.pi, 2.0 * np.pi)
    truth = truth_of(boxes, heading=heading, counts=rng.random(n) < 0.8)
    moved = boxes + rng.normal(0.0, 1.0, (n, 5)) * (3.0, 3.0, 2.0, 2.0, 0.1)
    stray = np.column_stack(
        [rng.uniform(0, SIDE_PX, (3, 2)), np.full((3, 1), 30.0), np.full((3, 1), 14.0), np.zeros(3)]
    )
    every = np.concatenate([moved[rng.random(n) < 0.8], stray[: rng.integers(4)]])
    return found_of(every, rng.permutation(len(every)) / 10.0 + 0.05), truth


@pytest.mark.parametrize(
    ("hit", "objects", "wanted"),
    [
        ((1, 1, 0, 0), 2, 0.8),  # both found before any false alarm
        ((1, 0, 1, 1), 3, 0.5),  # worth a false alarm
        ((1, 0, 0, 0), 9, 0.9),
        ((0, 0, 0, 0), 2, math.nan),
    ],
)
def test_the_balanced_score_by_hand(hit, objects, wanted):
    shuffled = [2, 0, 3, 1]
    score, right = np.array([0.9, 0.8, 0.6, 0.5]), np.array(hit, bool)
    assert balanced_score(score[shuffled], right[shuffled], objects) == pytest.approx(wanted, nan_ok=True)


def test_the_balanced_score_takes_boxes_of_one_score_together():
    score, hit = np.array([0.9, 0.8, 0.8, 0.8, 0.8]), np.array([1, 1, 0, 0, 0], bool)
    # F1 from 0.9 on is 2/3, from 0.8 on 4/7; a cut after the second box, 4/4, cannot be made
    assert balanced_score(score, hit, 2) == 0.9


def test_the_balanced_score_may_be_lower_where_it_costs_little():
    score, hit = np.array([0.9, 0.8, 0.6, 0.5]), np.array([1, 1, 0, 1], bool)
    # F1 at each: 2/5, 4/6, 4/7, 6/8 of 4 objects; with 2 there is none to win below 0.8
    assert balanced_score(score, hit, 4) == 0.5
    assert balanced_score(score[:3], hit[:3], 2) == 0.8
    assert balanced_score(score[:3], hit[:3], 2, slack=0.1) == 0.8
    assert balanced_score(score[:3], hit[:3], 2, slack=0.25) == 0.6


def test_average_precision_by_hand():
    # 0.9 right, 0.8 wrong, 0.7 right, of three objects: 1/3 · 1 + 1/3 · 2/3
    assert average_precision(np.array([0.9, 0.8, 0.7]), np.array([1, 0, 1], bool), 3) == pytest.approx(5 / 9)
    assert average_precision(np.array([0.7, 0.9, 0.8]), np.array([1, 1, 0], bool), 3) == pytest.approx(5 / 9)
    assert average_precision(np.array([0.9]), np.array([False]), 2) == 0.0
    assert average_precision(np.empty(0), np.empty(0, bool), 2) == 0.0
    assert math.isnan(average_precision(np.array([0.9]), np.array([False]), 0))
    # equal scores have no order: one right and one wrong at once is a precision of one half
    assert average_precision(np.array([0.5, 0.5]), np.array([0, 1], bool), 1) == 0.5
    assert average_precision(np.array([0.5, 0.5]), np.array([1, 0], bool), 1) == 0.5


@MODEST
@given(st.lists(st.tuples(st.integers(0, 8), st.booleans()), min_size=1, max_size=25), st.integers(0, 4))
def test_average_precision_equals_its_definition_in_fractions(rows, missed):
    score, hit = [s / 10 for s, _ in rows], [h for _, h in rows]
    objects = sum(hit) + missed
    if objects:
        got = average_precision(np.array(score), np.array(hit), objects)
        assert got == pytest.approx(float(exact_ap(score, hit, objects)), abs=1e-12)


def test_rotated_overlap_agrees_with_darts():
    rng = np.random.default_rng(3)
    for _ in range(12):
        a = [*rng.uniform(0, 20, 2), *rng.uniform(10, 60, 2), rng.uniform(-4, 4)]
        b = [*rng.uniform(0, 20, 2), *rng.uniform(10, 60, 2), rng.uniform(-4, 4)]
        assert rotated_iou([a], [b])[0, 0] == pytest.approx(darts(a, b, rng), abs=0.01)


def test_share_inside_is_that_of_the_detection():
    iou, inside = overlap(found_of([row(50, w=20, h=10)], [0.9]), truth_of([row(50, w=40, h=20)]))
    assert iou[0, 0] == pytest.approx(0.25)
    assert inside[0, 0] == pytest.approx(1.0)


def test_each_object_is_taken_once_by_the_best():
    truth = truth_of([row(50), row(150)])
    found = found_of([row(52), row(50), row(300)], [0.6, 0.9, 0.8])
    assert match(found, truth).truth[0].tolist() == [FALSE_ALARM, 0, FALSE_ALARM]
    result = evaluate([found], [truth], score=0.3)
    assert (result.precision, result.recall) == (pytest.approx(1 / 3), 0.5)
    assert result.ap50 == 0.5
    assert evaluate([found], [truth], score=0.85).precision == 1.0


def test_overlap_must_reach_the_threshold():
    # moved along its width of 40 by d: IoU = (40 − d) / (40 + d); 40/3 gives exactly one half
    truth = truth_of([row(50, angle=0.0)])
    for d, hits in ((13.0, 1), (14.0, 0), (4.0, 7), (0.5, 10)):
        got = match(found_of([row(50 + d, angle=0.0)], [0.9]), truth).truth[:, 0]
        assert (got == 0).sum() == hits, d


@MODEST
@given(scenes())
def test_perfect_detections_are_perfect(scene):
    _, truth = scene
    found = found_of(truth.boxes, np.linspace(0.4, 0.9, len(truth)), truth.heading)
    result = evaluate([found], [truth])
    if result.objects:
        assert result.ap50 == result.ap50_95 == result.precision == result.recall == 1.0
        assert result.directions.heading_deg == pytest.approx(0.0, abs=1e-6)
        assert result.directions.turned_about == 0.0
        assert result.centre_px == 0.0
    assert sum(s.objects for s in result.sizes) == sum(s.found for s in result.sizes) == result.objects


@pytest.mark.slow
@MODEST
@given(st.lists(scenes(), min_size=1, max_size=4), st.randoms(use_true_random=False))
def test_order_of_images_detections_and_objects_says_nothing(images, random):
    def shuffled(pair):
        found, truth = pair
        mask = np.array(random.sample(range(len(truth)), len(truth)))
        return found.select(np.array(random.sample(range(len(found)), len(found)), int)), truth.select(mask)

    # scores differ between images, so that no two detections tie
    spread = [(replace_score(f, 0.001 * k), t) for k, (f, t) in enumerate(images)]
    mixed = [shuffled(pair) for pair in random.sample(spread, len(spread))]
    a, b = (as_json(evaluate(*zip(*pairs, strict=True)), {}) for pairs in (spread, mixed))
    assert a == b


def replace_score(found, more):
    return replace(found, score=found.score + more)


@MODEST
@given(scenes())
def test_what_does_not_count_changes_nothing(scene):
    found, truth = scene
    before = evaluate([found], [truth])
    area = [SIDE_PX + 200.0, 200.0, 150.0, 150.0, 0.0]
    more = truth_of([*truth.boxes, area], counts=[*truth.counts, False], heading=[*truth.heading, np.nan])
    extra = [[SIDE_PX + 180.0, 200.0, 30.0, 14.0, 0.4], [SIDE_PX + 220.0, 220.0, 30.0, 14.0, 0.4]]
    on_it = found_of([*found.boxes, *extra], [*found.score, 0.97, 0.98])
    after = evaluate([on_it], [more])
    for key in ("ap50", "ap50_95", "precision", "recall"):
        assert getattr(after, key) == pytest.approx(getattr(before, key), nan_ok=True)
    assert (match(on_it, more).truth[:, -2:] == ASIDE).all()
    assert after.aside == before.aside + 1


@MODEST
@given(scenes())
def test_bounds_and_order_of_figures(scene):
    result = evaluate([scene[0]], [scene[1]])
    if result.objects:
        assert 0.0 <= result.ap50_95 <= result.ap50 <= 1.0
        assert list(result.ap) == sorted(result.ap, reverse=True)
        assert result.ap50 <= 1.0 and 0.0 <= result.recall <= 1.0


def test_agrees_with_the_measure_of_training():
    rng = np.random.default_rng(5)
    found, rows = [], []
    for _ in range(20):
        n = 5
        true = np.column_stack(
            [
                40.0 + 70.0 * np.arange(n),
                np.full(n, 100.0),
                rng.uniform(30, 40, n),
                np.full(n, 16.0),
                rng.uniform(0, 6, n),
                np.ones(n),
            ]
        )
        near = true[:, :5] + rng.normal(0.0, 1.0, (n, 5)) * (3, 3, 1, 1, 0.15)
        near[:, 4] += np.pi * (rng.random(n) < 0.2)
        heading = np.mod(near[:, 4], 2.0 * np.pi)
        found.append(found_of(np.column_stack([near[:, :4], heading - 0.5 * np.pi]), rng.random(n), heading))
        rows.append(true)
    ours, theirs = evaluate(found, [shard_truth(r) for r in rows]), measure(found, rows)
    assert (ours.ap50, ours.recall, ours.precision) == pytest.approx((theirs.ap50, theirs.recall, theirs.precision))
    assert ours.centre_px == pytest.approx(theirs.centre_px)
    assert ours.directions.turned_about == pytest.approx(theirs.flips)
    assert 0.1 < ours.ap50 < 0.99


def test_headings_are_judged_where_both_tell_them():
    boxes = [row(50), row(150), row(250), row(350)]
    truth = truth_of(boxes, heading=[0.1, 1.0, 2.0, np.nan])
    found = found_of(boxes, [0.9, 0.8, 0.7, 0.6], np.array([0.1 + np.radians(8.0), 1.0 + np.pi, np.nan, 3.0]))
    d = evaluate([found], [truth]).directions
    assert (d.given, d.missing, d.turned_about) == (2, 1, 0.5)
    assert d.heading_deg == pytest.approx((8.0 + 180.0) / 2)
    assert d.axis_deg == pytest.approx(0.0, abs=1e-6)


def test_upright_labels_are_compared_with_the_hull():
    # a box at 45° of 20 √2 × 10 √2 has a hull of 30 × 30
    found = found_of([[100, 100, 20 * math.sqrt(2), 10 * math.sqrt(2), math.pi / 4]], [0.9])
    assert evaluate([found], [truth_of([[100, 100, 30, 30, 0]], upright=True)]).ap50_95 == 1.0
    assert evaluate([found], [truth_of([[100, 100, 30, 30, 0]])]).ap50 == 0.0


def test_classes_sizes_and_hiding_are_told_apart():
    truth = truth_of(
        [row(50), row(150), row(250, w=90.0), row(350, w=10.0, h=8.0)],
        name=["car", "car", "bus", "van"],
        hidden=[0, 2, 2, 0],
        counts=[1, 1, 1, 0],
    )
    result = evaluate([found_of(truth.boxes[[0, 2, 3]], [0.9, 0.8, 0.7])], [truth])
    assert {s.name: (s.objects, s.found, s.ap50) for s in result.classes} == {"car": (2, 1, 0.5), "bus": (1, 1, 1.0)}
    assert {s.name: (s.objects, s.found) for s in result.sizes} == {"32–48": (2, 1), "64–96": (1, 1)}
    hidden = {s.name: (s.objects, s.found) for s in result.hidden}
    assert hidden == {"in full sight": (1, 1), "mostly hidden": (2, 1), "do not count": (1, 1)}


def test_classes_are_chosen_by_name():
    truth = truth_of([row(50), row(150), row(250)], name=["car", "tricycle", "pedestrian"])
    kept = choose(truth, choose_classes(truth.name))
    assert (kept.name.tolist(), kept.counts.tolist()) == (["car", "tricycle"], [True, False])
    kept = choose(truth, choose_classes(truth.name, ["tricycle"], ["car"]))
    assert (kept.name.tolist(), kept.counts.tolist()) == (["car", "tricycle"], [False, True])
    assert choose_classes(["0", "1"]).counts == {"0", "1"}


def test_nothing_found_and_nothing_to_find():
    none, empty = found_of(np.empty((0, 5)), []), truth_of(np.empty((0, 5)))
    nothing = evaluate([none], [empty])
    assert math.isnan(nothing.ap50) and math.isnan(nothing.precision) and math.isnan(nothing.recall)
    assert evaluate([none], [truth_of([row(50)])]).ap50 == 0.0
    assert evaluate([found_of([row(50)], [0.9])], [empty]).precision == 0.0
    assert "NaN" not in as_json(nothing, {})
    assert "| AP50 | – |" in as_markdown(nothing, {"model": "m"})


def test_truth_of_unequal_lengths_is_refused():
    with pytest.raises(ValueError, match=r"boxes of shape \(1, 5\)"):
        replace(truth_of([row(50)]), boxes=np.zeros((2, 5)))


def test_worst_frames_come_first_in_their_colours():
    image = np.full((300, 400, 3), 90, np.uint8)
    good = LabelledImage(name="good", read=lambda: image, truth=truth_of([row(50)]))
    bad = LabelledImage(name="bad", read=lambda: image, truth=truth_of([row(100, 100), row(300, 100)]))
    found = [found_of([row(50)], [0.9]), found_of([row(300, 100), row(200, 250)], [0.9, 0.8])]
    assert worst([good, bad], found, 0.3) == [(1, 1, 1)]
    sheet = worst_sheet([good, bad], found, 0.3)
    assert sheet.shape[1] == TILE_PX

    def color(wanted):
        return int((np.abs(sheet.astype(int) - wanted).max(axis=-1) < 30).sum())

    assert min(color((60, 60, 240)), color((40, 220, 250)), color((90, 220, 90))) > 100
    assert worst_sheet([good], found[:1], 0.3).shape[1] == TILE_PX
