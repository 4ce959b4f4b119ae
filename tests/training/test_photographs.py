"""Photographs as training samples: labels stay on what they name, and what is unknown teaches nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from training.cuts import SIDE, Known, cut, rendered_sample
from training.photographs import OPEN, PART_SIDE, label_rows, mine, open_photographs, part
from vision.detect.boxes import corners, hull
from vision.detect.detections import Detections
from vision.errors import LabelError
from vision.evaluation import LabelledImage, Truth

WIDTH, HEIGHT = 1200, 800
CAR = (600.0, 400.0, 52.0, 24.0, 0.5)


def truth_of(*boxes, heading=np.nan, counts=True, upright=False, name="car"):
    rows = np.array(boxes, dtype=float).reshape(-1, 5)
    n = len(rows)
    return Truth(
        boxes=rows,
        heading=np.full(n, heading),
        name=np.full(n, name),
        counts=np.full(n, counts),
        hidden=np.full(n, -1),
        upright=upright,
    )


def picture(truth, value=255):
    """Grey, with every labelled box filled."""
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    for ring in corners(truth.boxes):
        cv2.fillConvexPoly(image, np.rint(ring - 0.5).astype(np.int32), (value, value, value))
    return image


def labelled(truth, name="a", gsd_m=np.nan):
    return LabelledImage(name=name, read=lambda: picture(truth), truth=truth, gsd_m=gsd_m)


class Finding:
    """A detector that returns the given boxes, rows cx, cy, w, h, score."""

    def __init__(self, *rows):
        self.rows = np.array(rows, dtype=float).reshape(-1, 5)

    def detect(self, image, *, gsd_m=None):
        self.gsd_m = gsd_m
        cx, cy, w, h, score = self.rows.T
        zero = np.zeros(len(cx))
        return Detections(cx=cx, cy=cy, w=w, h=h, angle=zero, score=score, heading=zero + np.nan)


def only(source):
    (one,) = source.photographs
    return one


@pytest.mark.parametrize("heading", [0.5 + np.pi / 2, 0.5 - np.pi / 2])
def test_a_front_is_known_whichever_way_the_box_is_written(heading):
    swapped = (*CAR[:2], CAR[3], CAR[2], CAR[4] - np.pi / 2)
    for box in (CAR, swapped):
        rows, known = label_rows(truth_of(box, heading=heading))
        assert known.tolist() == [Known.FRONT]
        assert rows[0].tolist() == pytest.approx([*CAR[:4], heading, 1.0])


def test_an_oriented_label_without_front_knows_the_axis():
    rows, known = label_rows(truth_of((*CAR[:2], CAR[3], CAR[2], 0.2)))
    assert known.tolist() == [Known.BOX]
    assert rows[0, 2:4].tolist() == [52.0, 24.0]
    assert np.cos(2.0 * (rows[0, 4] - (0.2 + np.pi))) == pytest.approx(1.0)


@pytest.mark.parametrize("angle", np.linspace(0.0, np.pi, 7))
def test_an_upright_label_knows_its_centre_and_roughly_its_size(angle):
    x0, y0, x1, y1 = hull(np.array([[*CAR[:4], angle]]))[0]
    upright = (0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0, 0.0)
    rows, known = label_rows(truth_of(upright, upright=True))
    assert known.tolist() == [Known.CENTRE]
    assert rows[0, :2].tolist() == pytest.approx(CAR[:2], abs=1e-3)
    assert 0.9 * 24.0 <= rows[0, 3] <= 1.5 * 24.0
    assert 0.8 * 52.0 <= rows[0, 2] <= 1.2 * 52.0


def test_labels_stay_on_their_vehicles_through_part_and_cut():
    truth = truth_of(CAR, (500.0, 380.0, 52.0, 24.0, 1.3), (700.0, 450.0, 104.0, 26.0, 2.0))
    one = only(open_photographs([labelled(truth)], Finding(), 0))
    seen = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sample = part(one, picture(truth), rng)
        assert sample.image.shape == (PART_SIDE, PART_SIDE, 3)
        sample = cut(sample, rng)
        grey = sample.image.mean(axis=2)
        for cx, cy, length, _, heading, weight in sample.boxes:
            if weight < 0.95:
                continue
            seen += 1
            # just within each end of the vehicle, and just beyond
            for reach, inside in ((-0.4, True), (0.0, True), (0.4, True), (-0.65, False), (0.65, False)):
                u, v = cx + reach * length * np.sin(heading), cy - reach * length * np.cos(heading)
                if 0 <= int(u) < SIDE and 0 <= int(v) < SIDE:
                    assert (grey[int(v), int(u)] > 170) == inside
    assert seen > 20


@pytest.mark.parametrize(("gsd_m", "car_px"), [(np.nan, 40.0), (0.1, 45.0)])
def test_scale_comes_from_the_ground_resolution_or_from_the_labels(gsd_m, car_px):
    detector = Finding()
    truth = truth_of((600.0, 400.0, 40.0, 18.0, 0.0))
    one = only(open_photographs([labelled(truth, gsd_m=gsd_m)], detector, 0))
    assert one.car_px == pytest.approx(car_px)
    assert detector.gsd_m == pytest.approx(4.5 / car_px)
    lengths = [part(one, picture(truth), np.random.default_rng(k)).boxes[0, 2] for k in range(60)]
    nominal = 52.0 * 40.0 / car_px
    assert 0.34 * nominal < min(lengths) < 0.5 * nominal
    assert 1.1 * nominal < max(lengths) < 1.32 * nominal


def test_false_alarms_are_mined_and_overlooked_vehicles_are_not():
    truth = truth_of(CAR)
    alarm, car, bus = (100.0, 100.0, 20.0, 9.0, 0.6), (300.0, 100.0, 50.0, 22.0, 0.6), (500.0, 100.0, 130.0, 30.0, 0.2)
    faint_car, on_label = (700.0, 100.0, 50.0, 22.0, 0.2), (*CAR[:2], 40.0, 20.0, 0.9)
    detector = Finding(alarm, car, bus, faint_car, on_label)
    one = mine(only(open_photographs([labelled(truth)], Finding(), 0)), truth, detector, picture(truth))
    assert one.hard.tolist() == [[100.0, 100.0], [700.0, 100.0]]
    assert one.unjudged.mean(axis=1).tolist() == [[300.0, 100.0], [500.0, 100.0]]


def test_what_does_not_count_is_unjudged_and_no_vehicle():
    aside = truth_of((200.0, 200.0, 300.0, 100.0, 0.0), counts=False, name="ignored regions")
    one = only(open_photographs([labelled(aside)], Finding((210.0, 190.0, 20.0, 9.0, 0.9)), 0))
    assert len(one.boxes) == 0
    assert len(one.hard) == 0
    assert one.unjudged.tolist() == corners(aside.boxes).tolist()
    sample = part(one, picture(aside), np.random.default_rng(0))
    assert len(sample.unjudged) == 1 + 4  # the region, and the photograph's four edges


def test_the_samples_of_a_step_depend_on_the_step_alone():
    images = [labelled(truth_of(CAR), name=str(k)) for k in range(OPEN + 5)]
    one, other = (open_photographs(images, Finding(), 3) for _ in range(2))
    other.samples(40, 2, np.random.default_rng(0))
    for step in (0, 7):
        a, b = (source.samples(step, 3, np.random.default_rng(step)) for source in (one, other))
        assert all(np.array_equal(x.boxes, y.boxes) for x, y in zip(a, b, strict=True))


def test_an_unreadable_photograph_is_left_out(caplog):
    def broken():
        raise LabelError("b.jpg: cannot be read as an image")

    bad = LabelledImage(name="b", read=broken, truth=truth_of(CAR))
    source = open_photographs([labelled(truth_of(CAR)), bad], Finding(), 0)
    assert [p.name for p in source.photographs] == ["a"]
    assert "b.jpg" in caplog.text
    with pytest.raises(LabelError, match="none of 1"):
        open_photographs([bad], Finding(), 0)


def test_what_is_seen_of_a_vehicle_whose_middle_is_cut_off_counts_neither_way():
    boxes = np.array([[192.0, 192.0, 52.0, 24.0, 0.0, 1.0]], np.float32)
    sample = rendered_sample(np.zeros((384, 384, 3), np.uint8), boxes)
    made = np.concatenate([cut(sample, np.random.default_rng(seed)).boxes for seed in range(300)])
    outside = ((made[:, :2] <= 0.0) | (made[:, :2] >= SIDE)).any(axis=1)
    assert 3 < outside.sum() < 150
    assert (made[outside, 5] == 0.0).all()


@pytest.mark.parametrize(("tilt_deg", "stays"), [(20.0, False), (60.0, True)])
def test_what_is_seen_from_the_side_stays_upright(tilt_deg, stays):
    boxes = np.array([[192.0, 192.0, 52.0, 24.0, 0.0, 1.0]], np.float32)
    sample = rendered_sample(np.zeros((384, 384, 3), np.uint8), boxes, np.radians(tilt_deg))
    rng = np.random.default_rng(0)
    turns = np.concatenate([cut(sample, rng).boxes[:, 4] for _ in range(100)])
    assert len(turns) > 50
    # a camera's roll: nearly always below 60°
    assert ((np.cos(turns) > 0.5).mean() > 0.95) == stays
