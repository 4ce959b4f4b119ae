"""Both ways of seeing run on the same recording; the mission file alone chooses."""

import numpy as np
import pytest

from gcs.fold.detector_factory import open_mission_detector
from gcs.mission.mission import DetectorChoice
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import ROOT
from tests.support.onnx_models import black, brightest_side, classifier, constant, raw, yolo
from vision.detect.scale_finder import ScaleFinder
from vision.errors import ModelError

CURVED = ROOT / "sitl_logs" / "curved-road"


@pytest.fixture
def see(tmp_path):
    """Detections in the first frame, with the recording's mission and a [detector] table beside two models."""
    anchors = np.zeros((1, 6, 84))
    anchors[0, :, :2] = np.transpose([[20, 30, 16, 8, 0.9, 0.4], [44, 30, 16, 8, 0.8, 0.0]])
    constant(tmp_path / "yolo.onnx", [1, 3, 64, 64], anchors, {"names": "{0: 'car'}", "task": "obb"})
    classifier(tmp_path / "front.onnx", 6.0 * brightest_side(16, 2), 16)
    mission = tmp_path / "mission.toml"

    def look(detector=""):
        mission.write_text((CURVED / "session.toml").read_text() + detector)
        analysis = Analysis(open_session(CURVED, mission=mission))
        try:
            seer = analysis.detector()
            assert seer is not None
            return seer.detect(analysis.video.read(0).image)
        finally:
            analysis.close()

    return look


def test_the_bundled_detector_tells_fronts_itself(see):
    found = see().at_least(0.3)
    assert len(found) >= 4
    assert np.isfinite(found.heading).all()


def test_a_yolo_export_alone_tells_none(see):
    found = see('[detector]\nmodel = "yolo.onnx"\n')
    assert len(found) == 2
    assert np.isnan(found.heading).all()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("front", ["front.onnx", "bundled"])
def test_a_classifier_tells_the_fronts_of_a_yolo_export(see, front):
    found = see(f'[detector]\nmodel = "yolo.onnx"\nfront = "{front}"\nfront_sure = 0.0\n')
    assert len(found) == 2
    assert np.isfinite(found.heading).all()


def test_a_classifier_that_is_not_there_is_told(see):
    with pytest.raises(ModelError, match=r"nowhere\.onnx: no such model file"):
        see('[detector]\nfront = "nowhere.onnx"\n')


def test_the_mission_says_which_classes_count(see):
    with pytest.raises(ModelError, match="truck"):
        see('[detector]\nmodel = "yolo.onnx"\nclasses = ["truck"]\n')
    assert len(see('[detector]\nmodel = "yolo.onnx"\nclasses = ["car"]\n')) == 2


def test_a_provider_that_is_not_installed_is_told(see):
    with pytest.raises(ModelError, match="NoSuchExecutionProvider"):
        see('[detector]\nproviders = ["NoSuchExecutionProvider"]\n')


@pytest.mark.slow
def test_weak_boxes_are_found_too_and_cost_no_look_for_their_fronts(see):
    """With a higher score to count from, the second box does not."""
    assert see('[detector]\nmodel = "yolo.onnx"\nscore = 0.85\n').score.round(2).tolist() == [0.9, 0.8]
    found = see('[detector]\nmodel = "yolo.onnx"\nscore = 0.85\nfront = "front.onnx"\nfront_sure = 0.0\n')
    assert np.isfinite(found.heading).tolist() == [True, False]


def test_the_scale_of_a_film_is_found_by_what_the_mission_opens(tmp_path):
    """Whichever networks it names."""
    image = np.zeros((96, 128, 3), np.uint8)
    yolo(tmp_path, raw())
    for model in ("", str(tmp_path / "y.onnx")):
        for front in ("", "bundled"):
            finder = ScaleFinder(open_mission_detector(DetectorChoice(model=model, front=front)))
            assert finder.gsd_m(image, 0, None) is not None


def test_the_mission_can_do_without_tiles(tmp_path):
    yolo(tmp_path, raw((32, 32, 12, 6, 1, 0.9, 0.0)))  # sees a vehicle in the middle of any canvas
    model = str(tmp_path / "y.onnx")
    found = [
        len(open_mission_detector(DetectorChoice(model=model, tiled=tiled)).detect(black(150, 150), gsd_m=0.2))
        for tiled in (True, False)
    ]
    assert found == [16, 1]
