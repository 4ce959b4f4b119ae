"""The scale of a film without ground resolution: a flight and a later look at its video find it alike, and tell it."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.frame_loop import FrameLoop
from gcs.fold.detector_factory import open_mission_detector
from gcs.fold.pipeline import WAIT_US, Pipeline
from gcs.health.faults import Faults
from gcs.playback.looked_frames import look_again
from gcs.session.frame_tables import read_detections
from gcs.session.recorder import Recorder
from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.view import OTHER_VEHICLE, Bodies, CameraView, Scene
from tests.support.flights import T0
from tests.support.snapshots import ONE_UGV
from vision.video.video import Frame

FRAME_US, FRAMES = 200_000, 8
HEIGHT_M, FOCAL, CAR_M = 170.0, 800.0, 4.5


@pytest.fixture(scope="module")
def film():
    """Cars on a field from 170 m, the same picture again and again."""
    view = CameraView(
        width=640,
        height=360,
        fx=FOCAL,
        fy=FOCAL,
        cx=320.0,
        cy=180.0,
        distortion=np.zeros(5),
        R_enu_cam=np.diag([1.0, -1.0, -1.0]),
        p_enu=np.array([0.0, 0.0, HEIGHT_M]),
    )
    n = 8
    cars = Bodies(
        kind=np.full(n, OTHER_VEHICLE, np.int8),
        x=np.linspace(-28.0, 28.0, n),
        y=np.tile([-6.0, 6.0], n // 2),
        heading=np.linspace(0.0, 6.0, n),
        length=np.full(n, CAR_M),
        width=np.full(n, 1.8),
        height=np.full(n, 1.5),
        color=np.tile(np.array([[200, 205, 210], [40, 50, 170]], np.uint8), (n // 2, 1)),
    )
    image = Renderer(Scene(roads=()), Style(ground=GroundStyle(side_px=1024)), seed=9).draw(view, cars, 1)
    return [Frame(index=k, t_us=T0 + k * FRAME_US, image=image) for k in range(FRAMES)]


class FilmedFrames:
    """Frames as a video gives them."""

    def __init__(self, frames):
        self._frames = frames

    def frames(self, first=0):
        return iter(self._frames[first:])


@pytest.mark.slow
def test_a_flight_and_a_later_look_at_its_video_find_the_same_boxes_and_tell_the_scale(film, tmp_path):
    detector, now_us, shown = open_mission_detector(ONE_UGV.detector), [T0], []
    recorder = Recorder(tmp_path, ONE_UGV, video=True)
    faults = Faults(recorder.folder / "faults.txt")
    loop = FrameLoop(Pipeline(ONE_UGV), detector, recorder, faults, shown.append, lambda: now_us[0])
    for frame in film:
        now_us[0] = frame.t_us
        loop.run_once(frame)
        now_us[0] += WAIT_US
        loop.run_once(None)
    loop.close()
    recorder.close()
    (told,) = [event.text for snapshot in shown for event in snapshot.events if event.kind == "video"]
    px = CAR_M * FOCAL / HEIGHT_M
    length_px = float(told.split(" px")[0].split()[-1])
    assert 1 / 1.3 < length_px / px < 1.3

    looked = list(look_again(FilmedFrames(film), detector, lambda frame: None, 0.3))
    assert [frame.news for frame in looked if frame.news] == [told]
    flown = read_detections(recorder.folder / "detections.csv")
    assert len(looked) == FRAMES
    for frame in looked:
        np.testing.assert_allclose(frame.boxes.centre, flown.at(frame.index).centre, atol=0.01)
    assert len(looked[-1].boxes.at_least(0.3)) == 8
    assert not np.array_equal(looked[0].boxes.boxes, looked[-1].boxes.boxes)
