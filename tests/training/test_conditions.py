from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from training.conditions import HeldOut, by_condition, detect, read_held_out
from training.rendered.crops import write_shard
from vision.detect.detections import Detections
from vision.detect.detector import BUNDLED


def found(rows):
    """Detections with the given cx, cy, length, width, heading, score."""
    cx, cy, w, h, heading, score = np.array(rows, dtype=float).reshape(-1, 6).T
    return Detections(cx=cx, cy=cy, w=w, h=h, angle=heading - np.pi / 2, score=score, heading=heading)


SMALL, LARGE, HALF_HIDDEN = (
    (40.0, 40.0, 12.0, 6.0, 0.3, 1.0),
    (120.0, 60.0, 60.0, 24.0, 1.0, 1.0),
    (200.0, 90.0, 30.0, 14.0, 2.0, 0.6),
)


def held_out(*truth, tilt=(0.0,), streets=(1.0,)):
    about = np.array([(t, 50.0, 0.5, 1.0, s) for t, s in zip(tilt, streets, strict=True)], np.float32)
    images = np.zeros((len(truth), 256, 256, 3), np.uint8)
    return HeldOut(images=images, truth=[np.array(t).reshape(-1, 6) for t in truth], about=about)


def figures(detections, p):
    return dict(by_condition(detections, p))


def test_each_size_is_judged_by_its_own_vehicles():
    """The small one is missed, the large one found: no size pays for another's mistake."""
    q = figures([found([(*LARGE[:5], 0.9)])], held_out([SMALL, LARGE]))
    assert (q["length 10 to 16 px"].recall, q["length 10 to 16 px"].ap50) == (0.0, 0.0)
    assert (q["length 48 to 120 px"].recall, q["length 48 to 120 px"].precision) == (1.0, 1.0)
    assert q["all"].recall == 0.5


def test_a_false_alarm_counts_under_the_size_that_it_claims():
    alarm = (20.0, 200.0, 13.0, 6.0, 0.0, 0.8)
    q = figures([found([(*SMALL[:5], 0.9), (*LARGE[:5], 0.9), alarm])], held_out([SMALL, LARGE]))
    assert q["length 10 to 16 px"].precision == 0.5
    assert q["length 48 to 120 px"].precision == 1.0


def test_a_box_of_the_wrong_size_on_a_vehicle_is_still_its_box():
    """Told 17 px long, it lies on a vehicle of 15: found, though its own length is of the next class."""
    real = (40.0, 40.0, 15.0, 6.0, 0.3, 1.0)
    q = figures([found([(40.0, 40.0, 17.0, 6.5, 0.3, 0.9)])], held_out([real]))
    assert q["length 10 to 16 px"].recall == 1.0


def test_tilt_and_ground_are_those_of_the_image():
    p = held_out([LARGE], [LARGE], tilt=(0.05, 0.9), streets=(1.0, 0.0))
    q = figures([found([(*LARGE[:5], 0.9)]), Detections.empty()], p)
    assert (q["tilt below 10°"].recall, q["tilt 30° to 62°"].recall) == (1.0, 0.0)
    assert (q["streets and car parks"].recall, q["open ground"].recall) == (1.0, 0.0)


def test_half_hidden_vehicles_are_told_apart():
    q = figures([found([(*LARGE[:5], 0.9)])], held_out([LARGE, HALF_HIDDEN]))
    assert (q["wholly in sight"].recall, q["half to nine tenths in sight"].recall) == (1.0, 0.0)


def test_a_folder_without_images_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"python -m training\.rendered\.crops"):
        read_held_out(tmp_path)


@pytest.mark.slow
def test_the_bundled_model_on_images_never_trained_on(tmp_path):
    """Seeds from 950000 on are kept for tests; the full figures are in the model card."""
    write_shard(tmp_path, 950_007, 24)
    p = read_held_out(tmp_path)
    q = figures(detect(BUNDLED, p), p)
    assert q["length 24 to 48 px"].ap50 > 0.5
    assert q["length 24 to 48 px"].heading_deg < 4.0


def test_the_model_card_names_this_very_file():
    card = Path("docs/model_card.md").read_text()
    assert hashlib.sha256(BUNDLED.read_bytes()).hexdigest() in card
