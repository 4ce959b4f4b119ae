from __future__ import annotations

import numpy as np
import pytest

from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.view import OTHER_VEHICLE, PERSON, Bodies, CameraView, Road, Scene
from vision.detect.apparent_length import common_length, examine, finish
from vision.detect.detections import Detections
from vision.detect.detector import open_detector
from vision.detect.scale_finder import SEARCH_US, WATCH_US, ScaleFinder

CAR_M = 4.5
FOCAL = 1000.0
FRAME_US = 100_000


@pytest.fixture(scope="module")
def renderer():
    line = np.stack([np.linspace(-150, 150, 201), np.zeros(201)], axis=1)
    return Renderer(
        Scene(roads=(Road(centre=line, width=12.0, lanes=3),)), Style(ground=GroundStyle(side_px=2048)), seed=5
    )


@pytest.fixture(scope="module")
def detector():
    return open_detector()


def camera(height, size=(1280, 720)):
    return CameraView(
        width=size[0],
        height=size[1],
        fx=FOCAL,
        fy=FOCAL,
        cx=size[0] / 2,
        cy=size[1] / 2,
        distortion=np.zeros(5),
        R_enu_cam=np.diag([1.0, -1.0, -1.0]),
        p_enu=np.array([0.0, 0.0, height]),
    )


def traffic(cars, lorries=0, persons=0):
    """Cars on a grid about the middle, lorries beside it, persons between them."""
    rng = np.random.default_rng(3)
    places = sorted(((x, y) for x in range(-56, 57, 8) for y in (-9, -3, 3, 9)), key=lambda p: p[0] ** 2 + p[1] ** 2)
    rows = [(OTHER_VEHICLE, *p, rng.choice([0.5, 1.5]) * np.pi, CAR_M, 1.8, 1.5) for p in places[:cars]]
    rows += [(OTHER_VEHICLE, x, 16.0, 0.5 * np.pi, 12.0, 2.5, 3.2) for x in np.linspace(-10, 10, lorries)]
    rows += [(PERSON, x, -14.0, 0.0, 0.5, 0.5, 1.75) for x in np.linspace(-10, 10, persons)]
    kind, x, y, heading, length, width, height = np.array(rows, dtype=float).reshape(-1, 7).T
    color = rng.choice(np.array([[60, 140, 60], [200, 205, 210], [40, 50, 170]], np.uint8), len(rows))
    return Bodies(
        kind=kind.astype(np.int8), x=x, y=y, heading=heading, length=length, width=width, height=height, color=color
    )


def car_px(height):
    return CAR_M * FOCAL / height


@pytest.mark.slow_but_first
@pytest.mark.parametrize("height", [30.0, 60.0, 110.0, 180.0])
def test_the_length_of_cars_is_found_at_any_height(renderer, detector, height):
    image = renderer.draw(camera(height), traffic(12, persons=5), 1)
    found = finish(detector.examine(image))
    assert found is not None
    assert 1 / 1.4 < found.px / car_px(height) < 1.4


def test_a_lorry_among_cars_does_not_move_it(renderer, detector):
    image = renderer.draw(camera(60.0), traffic(8, lorries=1), 2)
    found = finish(detector.examine(image))
    assert found is not None
    assert 1 / 1.2 < found.px / car_px(60.0) < 1.2


@pytest.mark.slow
def test_empty_ground_tells_nothing(renderer, detector):
    for height in (30.0, 110.0):
        assert finish(detector.examine(renderer.draw(camera(height), traffic(0, persons=6), 3))) is None


@pytest.mark.slow
def test_a_still_of_unknown_ground_resolution_is_seen_as_well_as_one_that_is_known(renderer, detector):
    height = 190.0
    image = renderer.draw(camera(height), traffic(20), 4)
    known = detector.detect(image, gsd_m=height / FOCAL)
    unknown = detector.detect(image)
    assert len(known) >= 18
    assert len(unknown) >= len(known) - 1


def seen(finder, images, start_us=0):
    """What the finder asks for, frame by frame."""
    return [finder.gsd_m(image, start_us + k * FRAME_US, None) for k, image in enumerate(images)]


@pytest.mark.slow
def test_a_film_keeps_its_scale_over_empty_ground_and_follows_a_zoom(renderer, detector):
    near, far, empty = (
        renderer.draw(camera(height), traffic(cars), 5) for height, cars in ((50.0, 8), (120.0, 12), (50.0, 0))
    )
    finder = ScaleFinder(detector)
    seen(finder, [empty] * 8)
    assert finder.length_px is None
    assert not finder.news()
    seen(finder, [near] * 8, SEARCH_US + FRAME_US)
    assert finder.length_px == pytest.approx(car_px(50.0), rel=0.2)
    assert "vehicles are about" in finder.news()
    assert not finder.news()
    later_us = 3 * WATCH_US
    seen(finder, [empty] * 8, later_us)
    assert finder.length_px == pytest.approx(car_px(50.0), rel=0.2)
    # once may be an error, twice is a zoom
    seen(finder, [far] * 8, 2 * later_us)
    assert finder.length_px == pytest.approx(car_px(50.0), rel=0.2)
    seen(finder, [far] * 8, 2 * later_us + SEARCH_US + FRAME_US)
    assert finder.length_px == pytest.approx(car_px(120.0), rel=0.2)
    assert "before" in finder.news()


def test_known_ground_resolution_is_passed_on_and_nothing_is_examined(detector):
    class Untouchable:
        shape = (720, 1280, 3)

    finder = ScaleFinder(detector)
    assert finder.gsd_m(Untouchable(), 0, 0.05) == 0.05  # type: ignore[arg-type]
    assert ScaleFinder(None).gsd_m(Untouchable(), 0, None) is None  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_same_frames_give_the_same_scales(renderer, detector):
    film = [renderer.draw(camera(80.0), traffic(8), 7)] * 6 + [renderer.draw(camera(40.0), traffic(8), 8)] * 3
    assert seen(ScaleFinder(detector), film) == seen(ScaleFinder(detector), film)


def boxes(length, score=0.8, at=50.0, width=None):
    length = np.atleast_1d(np.asarray(length, dtype=float))
    n = len(length)
    return Detections(
        cx=np.full(n, at) + 200.0 * np.arange(n),
        cy=np.full(n, 50.0),
        w=length,
        h=0.45 * length if width is None else np.full(n, width),
        angle=np.zeros(n),
        score=np.full(n, score),
        heading=np.full(n, np.nan),
    )


def test_what_has_another_length_at_each_scale_is_no_evidence():
    image = np.zeros((720, 1280, 3), np.uint8)

    def look(part, scale):
        return boxes([20.0 / scale] * 5)

    assert finish(examine(image, look, finest=2.0, most_px=1e9)) is None
    found = finish(examine(image, lambda part, scale: boxes([40.0] * 2), finest=2.0, most_px=1e9))
    assert found is not None
    assert found.px == pytest.approx(40.0, rel=0.05)


def test_large_images_are_looked_at_in_the_part_where_most_is():
    image = np.zeros((1000, 2000, 3), np.uint8)
    image[:, 1500:] = 255
    parts = []

    def look(part, scale):
        parts.append((scale, part.shape[:2], float(part.mean())))
        right = part.shape[1] - 100.0
        return boxes([60.0], at=right) if part.max() else boxes([])

    finish(examine(image, look, finest=2.0, most_px=300_000))
    assert [scale for scale, _, _ in parts] == [0.125, 0.25, 0.5, 1.0, 2.0]
    assert all(shape[0] * shape[1] * scale**2 <= 300_000 * 1.01 for scale, shape, _ in parts)
    assert parts[-1][2] > 200.0


def test_evidence_is_dense_where_most_vehicles_are():
    length = np.array([50.0, 52.0, 48.0, 51.0, 130.0, 20.0])
    found = common_length(length, np.array([0.5, 0.5, 0.5, 0.5, 0.9, 0.3]), 2.0)
    assert found is not None
    assert found.px == pytest.approx(50.0, rel=0.05)
    assert common_length(length[:1], np.array([0.3]), 2.0) is None
    assert common_length(np.empty(0), np.empty(0), 2.0) is None


def test_small_boxes_need_more_evidence():
    weight = np.array([0.5])
    assert common_length(np.array([30.0]), weight, 2.0) is not None
    assert common_length(np.array([10.0]), weight, 2.0) is None


def test_in_a_depot_the_width_of_buses_tells():
    image = np.zeros((720, 1280, 3), np.uint8)
    found = finish(examine(image, lambda part, scale: boxes([120.0] * 5, width=25.0), finest=2.0, most_px=1e9))
    assert found is not None
    assert found.px == pytest.approx(62.5, rel=0.05)
