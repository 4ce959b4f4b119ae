"""YOLO-OBB networks in images of unknown ground resolution, by one that sees white rectangles of some lengths."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vision.detect.scale_finder import SEARCH_US, ScaleFinder
from vision.detect.yolo_detector import FILM_TILES, YoloDetector

CANVAS = 320
SEEN_PX = (14.0, 80.0)
CAR = (40, 18)
FRAME_US = 100_000


class Session:
    """An end-to-end model: the rectangles that are neither too small nor too large on its canvas."""

    def __init__(self, shape=(1, 3, CANVAS, CANVAS)):
        self.shape, self.runs = list(shape), 0

    def get_modelmeta(self):
        notes = {"names": "{0: 'car'}", "end2end": "True", "imgsz": f"[{CANVAS}, {CANVAS}]"}
        return type("Meta", (), {"custom_metadata_map": notes})

    def get_inputs(self):
        return [type("Input", (), {"name": "images", "type": "tensor(float)", "shape": self.shape})]

    def get_outputs(self):
        return [type("Output", (), {"name": "output0", "type": "tensor(float)", "shape": [1, 300, 7]})]

    def run(self, _names, feed):
        (image,) = feed["images"]
        self.runs += 1
        white = (image[0] > 0.7).astype(np.uint8)
        _, _, stats, centres = cv2.connectedComponentsWithStats(white)
        out = np.zeros((1, 300, 7), np.float32)
        for k, ((*_, w, h, _area), (x, y)) in enumerate(zip(stats[1:], centres[1:], strict=True)):
            score = 0.8 if SEEN_PX[0] <= max(w, h) <= SEEN_PX[1] else 0.0
            out[0, k] = (x + 0.5, y + 0.5, w, h, score, 0, 0.0)
        return [out]


@pytest.fixture
def session():
    return Session()


def detector_of(session, **options):
    detector = YoloDetector(session, "a fake", score=0.3, **options)
    session.runs = 0
    return detector


def street(cars, size=(1600, 900), car=CAR):
    """Cars on a grid, none at a border."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    for k in range(cars):
        x, y = 60 + 150 * (k % 10), 60 + 90 * (k // 10)
        image[y : y + car[1], x : x + car[0]] = 255
    return image


def seen(finder, images, start_us=0):
    return [finder.gsd_m(image, start_us + k * FRAME_US, None) for k, image in enumerate(images)]


@pytest.mark.parametrize("shape", [(1, 3, CANVAS, CANVAS), ("b", 3, "h", "w")])
def test_small_vehicles_of_a_large_still_are_found(shape):
    """Fitted into the canvas they are 8 px long, which this network does not see."""
    assert len(detector_of(Session(shape)).detect(street(40))) == 40
    assert len(detector_of(Session(shape), tiled=False).detect(street(40))) == 0


def test_a_still_whose_vehicles_are_large_enough_is_seen_as_a_whole(session):
    detector = detector_of(session)
    image = street(8, car=(140, 70))
    found = detector.detect(image)
    assert len(found) == 8
    session.runs = 0
    np.testing.assert_array_equal(detector_of(session, tiled=False).detect(image).boxes, found.boxes)
    assert session.runs == 1


def test_what_fits_into_the_canvas_is_looked_at_once(session):
    detector_of(session).detect(street(3, size=(CANVAS, 200)))
    assert session.runs == 1


def test_a_film_finds_its_scale_one_canvas_a_frame(session):
    detector = detector_of(session)
    finder, image = ScaleFinder(detector), street(40)
    for k in range(10):
        session.runs = 0
        gsd_m = finder.gsd_m(image, k * FRAME_US, None)
        assert session.runs <= 1
    assert finder.length_px == pytest.approx(CAR[0], rel=0.1)
    assert "vehicles are about" in finder.news()
    session.runs = 0
    assert len(detector.detect(image, gsd_m=gsd_m)) == 40
    assert 1 < session.runs <= FILM_TILES


def test_frames_of_a_film_have_few_tiles_however_small_its_vehicles(session):
    detector = detector_of(session)
    for size in ((1600, 900), (3840, 2160), (640, 3000)):
        image = street(0, size=size)
        for length_px in (2.0, 8.0, 40.0, 300.0):
            session.runs = 0
            detector.detect(image, gsd_m=detector.film_gsd_m(image, length_px))
            assert session.runs <= FILM_TILES


def test_a_film_without_vehicles_is_seen_as_a_whole(session):
    detector = detector_of(session)
    finder, image = ScaleFinder(detector), street(0)
    asked = seen(finder, [image] * 8) + seen(finder, [image] * 8, SEARCH_US)
    assert finder.length_px is None
    session.runs = 0
    detector.detect(image, gsd_m=asked[-1])
    assert session.runs == 1


def test_without_tiles_no_scale_is_looked_for(session):
    detector = detector_of(session, tiled=False)
    finder, image = ScaleFinder(detector), street(40)
    asked = seen(finder, [image] * 8)
    assert finder.length_px is None
    assert session.runs == 0
    detector.detect(image, gsd_m=asked[-1])
    assert session.runs == 1
