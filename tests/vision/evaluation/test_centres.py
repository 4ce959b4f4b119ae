"""What is judged by centres alone, what scores are worth, and two detectors beside each other."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.support.films.labelled import found_of, truth_of
from vision.evaluation import LabelledImage, evaluate
from vision.evaluation.apart_sheet import BOX, COLUMNS, LABEL, TILE_PX, TITLE_PX, apart_sheet, disagreements
from vision.evaluation.centres import match_centres
from vision.evaluation.comparison import compare
from vision.evaluation.matching import ASIDE, FALSE_ALARM
from vision.evaluation.reliability import score_for

TURNED = [50.0, 50.0, 40.0, 16.0, 0.8]
AROUND_IT = [50.0, 50.0, 39.0, 40.0, 0.0]
"""The upright label of the same vehicle."""


def test_a_turned_vehicle_in_its_upright_label_is_found_by_its_centre():
    truth = truth_of([[40.0, 50.0, 60.0, 40.0, 0.0]], upright=True)
    found = found_of([[60.0, 50.0, 20.0, 10.0, 0.4]], [0.9])
    judged = evaluate([found], [truth])
    assert judged.recall == 0.0
    assert (judged.centres.recall, judged.centres.precision) == (1.0, 1.0)


def test_an_object_is_found_once_and_by_the_best_score():
    truth = truth_of([AROUND_IT], upright=True)
    found = found_of([TURNED, [55.0, 52.0, 40.0, 16.0, 0.8]], [0.6, 0.9])
    assert match_centres(found, truth).truth[0].tolist() == [FALSE_ALARM, 0]


def test_the_nearest_of_several_labels_is_taken_and_the_other_stays_free():
    truth = truth_of([[50.0, 50.0, 40.0, 40.0, 0.0], [60.0, 50.0, 40.0, 40.0, 0.0]])
    found = found_of([[58.0, 50.0, 20.0, 10.0, 0.0], [57.0, 50.0, 20.0, 10.0, 0.0]], [0.9, 0.8])
    assert match_centres(found, truth).truth[0].tolist() == [1, 0]


def test_turned_labels_are_judged_turned():
    truth = truth_of([[50.0, 50.0, 40.0, 10.0, np.pi / 4]])
    on, beside = [60.0, 60.0, 9.0, 9.0, 0.0], [60.0, 40.0, 9.0, 9.0, 0.0]
    assert match_centres(found_of([on, beside], [0.9, 0.9]), truth).truth[0].tolist() == [0, FALSE_ALARM]


def test_what_does_not_count_excuses_and_is_not_found():
    truth = truth_of([AROUND_IT], counts=[False])
    judged = match_centres(found_of([TURNED, [90.0, 90.0, 9.0, 9.0, 0.0]], [0.9, 0.8]), truth)
    assert judged.truth[0].tolist() == [ASIDE, FALSE_ALARM] and judged.under.tolist() == [0, -1]


@pytest.mark.parametrize(("boxes", "scores"), [([], []), ([TURNED], [0.9])])
def test_an_image_without_objects_has_no_recall(boxes, scores):
    judged = evaluate([found_of(boxes, scores)], [truth_of([])])
    assert np.isnan(judged.centres.recall) and not judged.centres.places


def test_thirds_are_of_each_images_objects():
    truth = truth_of([[50.0, 20.0 * k, 10.0, 10.0, 0.0] for k in range(9)])
    found = found_of([[50.0, 20.0 * k, 10.0, 10.0, 0.0] for k in (0, 3, 4, 6, 7, 8)], [0.9] * 6)
    places = evaluate([found], [truth]).centres.places
    assert [(p.name, p.objects, p.found) for p in places] == [
        ("upper third", 3, 1),
        ("middle third", 3, 2),
        ("lower third", 3, 3),
    ]


def test_scores_are_worth_the_share_that_is_right():
    truth = truth_of([[20.0 * k, 50.0, 10.0, 10.0, 0.0] for k in range(4)])
    hits = [[20.0 * k, 50.0, 10.0, 10.0, 0.0] for k in range(4)]
    misses = [[20.0 * k, 90.0, 60.0, 10.0, 0.0] for k in range(4)]
    found = found_of(hits + misses, [0.9, 0.7, 0.35, 0.35, 0.35, 0.32, 0.07, 0.01])
    bins = {(b.score, b.length_px): (b.detections, b.right) for b in evaluate([found], [truth]).reliability.bins}
    assert bins[(0.8, 1.0), (0.0, 24.0)] == (1, 1) and bins[(0.6, 0.8), (0.0, 24.0)] == (1, 1)
    assert bins[(0.3, 0.4), (0.0, 24.0)] == (2, 2) and bins[(0.3, 0.4), (48.0, np.inf)] == (2, 0)
    assert sum(n for n, _ in bins.values()) == 7, "what is below the lowest class is left out"


def test_equal_scores_cannot_be_told_apart_by_a_threshold():
    truth = truth_of([[20.0 * k, 50.0, 10.0, 10.0, 0.0] for k in range(3)])
    hits = [[20.0 * k, 50.0, 10.0, 10.0, 0.0] for k in range(3)]
    found = found_of([*hits, [300.0, 50.0, 10.0, 10.0, 0.0]], [0.9, 0.8, 0.5, 0.5])
    matches = [match_centres(found, truth)]
    assert score_for(0.8, [found], matches) == 0.8
    assert score_for(0.75, [found], matches) == 0.5
    assert np.isnan(score_for(0.8, [found_of([TURNED], [0.9])], [match_centres(found_of([TURNED], [0.9]), truth)]))


def scene(rng, images=30, each=10, share=0.8):
    """Objects, and a detector that finds a share of them."""
    truth, found = [], []
    for _ in range(images):
        boxes = np.stack([np.arange(each) * 40.0, np.full(each, 50.0), *np.full((2, each), 20.0), np.zeros(each)], 1)
        seen = boxes[rng.random(each) < share]
        truth.append(truth_of(boxes))
        found.append(found_of(seen, rng.uniform(0.4, 0.9, len(seen))))
    return truth, found


def test_a_better_detector_is_surely_better_and_one_is_as_good_as_itself():
    truth, good = scene(np.random.default_rng(1), share=0.9)
    _, poor = scene(np.random.default_rng(2), share=0.6)
    by = {d.name: d for d in compare(good, poor, truth, 0.3)}
    assert set(by) == {f"{f}{o}" for f in ("AP50", "precision", "recall") for o in ("", " of centres")}
    recall = by["recall of centres"]
    assert recall.one == pytest.approx(0.9, abs=0.06) and recall.other == pytest.approx(0.6, abs=0.08)
    assert 0.0 < recall.interval[0] < recall.one - recall.other < recall.interval[1]
    assert by["AP50"].one == pytest.approx(evaluate(good, truth).ap50)
    assert all(d.interval == (0.0, 0.0) for d in compare(good, good, truth, 0.3))


@pytest.mark.slow
def test_the_interval_mostly_holds_the_true_difference():
    held = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        truth, one = scene(rng, images=25, each=5, share=0.8)
        _, other = scene(rng, images=25, each=5, share=0.7)
        low, high = compare(one, other, truth, 0.3)[2].interval
        held += low <= 0.1 <= high
    assert 20 <= held <= 25


def test_one_image_tells_nothing_of_others():
    truth, found = scene(np.random.default_rng(1), images=1)
    assert all(np.isnan(d.interval).all() for d in compare(found, found, truth, 0.3))


def test_what_only_one_finds_is_shown_best_first():
    truth, boxes = truth_of([[60.0, 60.0, 40.0, 20.0, 0.0], [160.0, 60.0, 40.0, 20.0, 0.0]]), []
    one = found_of(
        [[60.0, 60.0, 40.0, 20.0, 0.0], [160.0, 60.0, 40.0, 20.0, 0.0], [60.0, 160.0, 40.0, 20.0, 0.0]], [0.5, 0.8, 0.7]
    )
    other = found_of(boxes, [])
    found, alarms = disagreements([one], [other], [truth], 0.3)
    assert [o.score for o in found] == [0.8, 0.5] and [o.score for o in alarms] == [0.7]
    assert disagreements([other], [one], [truth], 0.3) == ([], [])
    image = LabelledImage(name="a.png", read=lambda: np.full((200, 220, 3), 90, np.uint8), truth=truth)
    sheet = apart_sheet([image], [("only the first finds", found), ("nothing", [])])
    assert sheet.shape == (2 * (TITLE_PX + TILE_PX), COLUMNS * TILE_PX, 3)
    first = sheet[TITLE_PX : TITLE_PX + TILE_PX, :TILE_PX]
    ringed = np.abs(first.astype(int) - BOX).max(axis=2) < 60
    assert cv2.countNonZero(ringed.astype(np.uint8)) > 50
    assert LABEL != BOX


def test_false_alarms_that_both_raise_are_no_difference():
    truth, alarm = truth_of([]), [60.0, 160.0, 40.0, 20.0, 0.0]
    near = [64.0, 163.0, 44.0, 18.0, 0.1]
    assert disagreements([found_of([alarm], [0.7])], [found_of([near], [0.4])], [truth], 0.3) == ([], [])
    assert len(disagreements([found_of([alarm], [0.7])], [found_of([near], [0.2])], [truth], 0.3)[1]) == 1
