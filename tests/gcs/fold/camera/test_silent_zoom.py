"""A zoom that nothing reports is found by its boxes; what boxes do otherwise is no zoom."""

import numpy as np
import pytest

from gcs.fold.camera.frame_camera import FrameCamera
from gcs.fold.camera.optics import Optics
from gcs.fold.camera.silent_zoom import SilentZoom, magnified
from gcs.fold.ground.surface import GroundSurface
from gcs.mission.mission import Camera
from mavlink.state import CameraReport
from vision.camera.camera import CameraPose
from vision.camera.intrinsics import Intrinsics
from vision.detect.detections import Detections

HEIGHT_M, STEP_US = 60.0, 100_000
NUMBERS = {"width": 1920, "height": 1080, "fx": 1400.0, "fy": 1400.0, "cx": 960.0, "cy": 540.0}
VIEW = FrameCamera(
    intrinsics=Intrinsics(**NUMBERS),
    pose=CameraPose(R_enu_cam=np.diag([1.0, -1.0, -1.0]), p_enu=np.array([0.0, 0.0, HEIGHT_M])),
    ground=GroundSurface(at=np.zeros(2), z=0.0, slope=np.zeros(2), std_m=1.0),
    attitude_known=True,
    position_sure=True,
)
START = np.array([(-12.0, -6.0), (-4.0, 5.0), (3.0, -7.0), (9.0, 4.0), (14.0, -2.0), (-9.0, 8.0)])
DRIFT = np.array([(0.8, 0.1), (0.9, -0.2), (0.7, 0.0), (1.0, 0.2), (0.8, -0.1), (0.9, 0.1)])


def report(hfov_deg):
    return CameraReport(width=0, height=0, hfov=np.radians(hfov_deg), vfov=np.nan, source="CAMERA_FOV_STATUS")


def texts(optics):
    return [event.text for event in optics.take_events()]


def frame(t, zoom, rng, *, size_noise=0.05, missed=0.0, sizes=1.0, apart=lambda t: 1.0):
    """Boxes of six vehicles that drive on, in a picture that is magnified by so much, and their rows."""
    scale = VIEW.intrinsics.fx * zoom / HEIGHT_M
    place = START * apart(t) + DRIFT * t
    rows = np.flatnonzero(rng.random(6) >= missed)
    grown = np.exp(rng.normal(0.0, size_noise, 6)) * sizes
    boxes = Detections(
        cx=960.0 + scale * place[rows, 0] + rng.normal(0.0, 1.0, len(rows)),
        cy=540.0 - scale * place[rows, 1] + rng.normal(0.0, 1.0, len(rows)),
        w=(4.5 * scale * grown)[rows],
        h=(1.9 * scale * grown)[rows],
        angle=np.zeros(len(rows)),
        score=np.full(len(rows), 0.9),
        heading=np.full(len(rows), np.nan),
    )
    return boxes, rows


def change(watch, t_us, view, boxes, track_id):
    return watch.change(t_us, view, boxes, track_id, view.intrinsics.rays(boxes.centre))


def followed(zoom_at, seconds=12.0, seed=1, *, lost_by_jump=False, **more):
    """Magnification that is found by the end, and the largest factor by which it was wrong in the last two seconds."""
    watch, found, rng, worst = SilentZoom(), 1.0, np.random.default_rng(seed), 1.0
    for k in range(round(seconds * 10)):
        t, t_us = k / 10, k * STEP_US
        zoom = zoom_at(t)
        boxes, rows = frame(t, zoom, rng, **more)
        found *= watch.jump(t_us, magnified(VIEW, found), boxes)
        # a tracker loses what leaps away, unless it was told of the zoom
        late = 1000 if lost_by_jump and t >= 6.0 else 0
        found *= change(watch, t_us, magnified(VIEW, found), boxes, rows + 1 + late)
        if t > seconds - 2.0:
            worst = max(worst, found / zoom, zoom / found)
    return found, worst


@pytest.mark.slow_but_first
@pytest.mark.parametrize("factor", [0.5, 0.75, 1.4, 2.0])
@pytest.mark.parametrize("over_s", [0.5, 2.0])
def test_a_zoom_that_takes_a_while_is_followed(factor, over_s):
    _, worst = followed(lambda t: factor ** float(np.clip((t - 5.0) / over_s, 0.0, 1.0)))
    assert worst < 1.1


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_zoom_from_one_frame_to_the_next_is_found_though_tracks_are_lost(factor):
    _, worst = followed(lambda t: factor if t >= 6.0 else 1.0, lost_by_jump=True, missed=0.1)
    assert worst < 1.1


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(6))
def test_boxes_that_vary_and_are_missed_are_no_zoom(seed):
    found, _ = followed(lambda t: 1.0, 30.0, seed, size_noise=0.12, missed=0.35)
    assert found == 1.0


@pytest.mark.slow_but_first
def test_vehicles_that_drive_apart_while_their_boxes_vary_are_no_zoom():
    for seed in range(6):
        found, _ = followed(lambda t: 1.0, 20.0, seed, size_noise=0.15, apart=lambda t: 1.3 - 0.3 * np.cos(0.6 * t))
        assert found == 1.0


@pytest.mark.slow
def test_vehicles_of_different_sizes_that_come_and_go_are_no_zoom():
    sizes = np.array([0.4, 0.5, 1.0, 1.0, 2.0, 2.5])
    for seed in range(6):
        found, _ = followed(lambda t: 1.0, 20.0, seed, sizes=sizes, missed=0.4)
        assert found == 1.0


def test_a_detector_whose_boxes_grow_without_the_places_is_no_zoom():
    watch, rng = SilentZoom(), np.random.default_rng(3)
    for k in range(80):
        boxes, rows = frame(k / 10, 1.0, rng)
        if k > 40:
            boxes = Detections(
                **{name: getattr(boxes, name) for name in ("cx", "cy", "angle", "score", "heading")},
                w=boxes.w * 1.3,
                h=boxes.h * 1.3,
            )
        assert watch.jump(k * STEP_US, VIEW, boxes) == 1.0
        assert change(watch, k * STEP_US, VIEW, boxes, rows + 1) == 1.0


def test_one_or_two_tracks_show_no_zoom():
    watch, rng = SilentZoom(), np.random.default_rng(3)
    for k in range(80):
        boxes, rows = frame(k / 10, 1.0 + 0.02 * k, rng)
        pair = boxes.select(np.arange(2))
        found = watch.jump(k * STEP_US, VIEW, pair), change(watch, k * STEP_US, VIEW, pair, rows[:2] + 1)
        assert found == (1.0, 1.0)


def test_a_found_zoom_is_told_once_it_has_ended_and_a_report_takes_over():
    optics = Optics(Camera(**NUMBERS, name="nadir.toml"))
    optics.intrinsics(0, report(60.0), (1920, 1080))
    texts(optics)
    for k in range(10):
        optics.magnify(k * STEP_US, 2.0**0.1)
        optics.intrinsics(k * STEP_US, report(60.0), None)
    assert texts(optics) == []
    now = optics.intrinsics(3_000_000, report(60.0), None)
    assert texts(optics) == ["the camera zoomed 2.0 times, which it does not report"]
    assert now.fx == pytest.approx(2.0 * NUMBERS["fx"])
    # the camera tells it at last: what was found counts no more
    told = optics.intrinsics(4_000_000, report(2 * np.degrees(np.arctan(np.tan(np.radians(30.0)) / 2.0))), None)
    assert told.fx == pytest.approx(2.0 * NUMBERS["fx"], rel=1e-6)
