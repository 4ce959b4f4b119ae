"""Models of others: what they ask for is bounded before it is given, and so is the work on their answers."""

import tracemalloc

import numpy as np
import pytest

from gcs.fold.pipeline import Pipeline
from gcs.fold.seeing import MAX_BOXES
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import ROOT
from tests.support.onnx_models import ANCHORS, ANY, FLOAT, NAMES, UINT8, black, classifier, model, raw, suppressed, yolo
from vision.detect import decode_yolo, yolo_layout
from vision.detect.boxes import prob_iou, prob_iou_pairs
from vision.detect.decode_yolo import MAX_CANDIDATES, fast_nms
from vision.detect.detections import Detections
from vision.detect.detector import open_detector
from vision.detect.front import open_front_classifier
from vision.detect.tiles import MAX_COMPARED, detect_in_tiles, tile_grid
from vision.errors import ModelError
from vision.track.tracker import Tracker

SWARM = ROOT / "sitl_logs" / "ardupilot-swarm"
SIZES = {
    "an image of 200,000 px a side": ({"shape": [1, 3, 200_000, 200_000]}, "the most are"),
    "one of 2^40 px": ({"shape": [1, 3, 1 << 40, 64]}, "the most are"),
    "a batch of a thousand million": ({"shape": [10**9, 3, 64, 64]}, "the most are"),
    "notes of a hundred million px": (
        {"shape": ANY, "metadata": NAMES | {"imgsz": "[100000000, 100000000]"}},
        "the most are",
    ),
    "notes of five thousand digits": ({"shape": ANY, "metadata": NAMES | {"imgsz": "9" * 5000}}, "the most are"),
    "digits that are none": (
        {"shape": ANY, "metadata": NAMES | {"imgsz": "\u00b2", "stride": "\u00b2"}, "imgsz": 1 << 20},
        "the most are",
    ),
    "a step of 10^12": ({"shape": ANY, "metadata": NAMES | {"stride": "1" + "0" * 12}}, "the most are"),
    "notes without end": ({"metadata": {"names": "{0: 'car'" + " " * (1 << 21) + "}"}}, "class names cannot be read"),
}


@pytest.mark.parametrize(("options", "words"), SIZES.values(), ids=SIZES.keys())
def test_what_a_model_asks_for_is_refused_before_memory_is(tmp_path, options, words):
    tracemalloc.start()
    try:
        with pytest.raises(ModelError, match=words) as error:
            yolo(tmp_path, raw(), **options)
        assert tracemalloc.get_traced_memory()[1] < 32 << 20
    finally:
        tracemalloc.stop()
    assert len(str(error.value)) < 1000


def test_names_that_are_no_text_and_pages_of_them_are_one_line(tmp_path):
    image = ("images", FLOAT, [1, 3, 64, 64])
    path = model(tmp_path / "y.onnx", image, ("output0", FLOAT, [1, 3, 64, 64]))
    good = path.read_bytes()
    path.write_bytes(good.replace(b"images", b"imag\xf1s"))
    with pytest.raises(ModelError, match=r"y.onnx: the names of its inputs and outputs are no text$"):
        open_detector(path, score=0.3)
    path.write_bytes(good.replace(b"Identity", b"Id\nntity"))
    with pytest.raises(ModelError, match=r"y.onnx: cannot be loaded as an ONNX model") as error:
        open_detector(path, score=0.3)
    assert "\n" not in str(error.value) and len(str(error.value)) < 600


@pytest.mark.parametrize("told", [None, ["b", "n", 3]])
def test_an_answer_larger_than_any_is_refused(tmp_path, monkeypatch, told):
    monkeypatch.setattr(yolo_layout, "MAX_VALUES", 8 * ANCHORS - 1)
    with pytest.raises(ModelError, match="has more than"):
        yolo(tmp_path, raw(), told=told)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("form", ["raw", "suppressed"])
@pytest.mark.parametrize("apart", [0.0, 1e-3, 0.5])
def test_thousands_of_boxes_take_bounded_work(tmp_path, monkeypatch, form, apart):
    boxes = [(32 + apart * (k % 30), 32, 10, 5, 1, 0.9 - 1e-5 * k, 0.3) for k in range(20_000)]
    out = raw(*boxes, n=len(boxes)) if form == "raw" else suppressed(*boxes, most=len(boxes))
    detector = yolo(tmp_path, out, NAMES | {"end2end": str(form != "raw")})
    entered, pairs = [], []

    def suppress(boxes, *more):
        entered.append(len(boxes))
        return fast_nms(boxes, *more)

    def overlaps(a, b):
        pairs.append(len(a))
        return prob_iou_pairs(a, b)

    monkeypatch.setattr(decode_yolo, "fast_nms", suppress)
    monkeypatch.setattr(decode_yolo, "prob_iou_pairs", overlaps)
    found = detector.detect(black())
    assert set(entered) == {MAX_CANDIDATES}
    # the best boxes drop most of the others before those are compared: all pairs would be a thousand to each box
    assert sum(pairs) < 50 * sum(entered)
    assert 0 < len(found) <= 300
    assert detector.dropped.surplus >= len(boxes) - MAX_CANDIDATES


def test_suppression_drops_what_it_always_dropped():
    rng = np.random.default_rng(1)
    for count in (0, 1, 15, 16, 17, 400):
        boxes = rng.uniform([0, 0, 5, 5, 0], [80, 80, 30, 30, 3], (count, 5))
        score = rng.uniform(size=count)
        order = np.argsort(-score, kind="stable")
        over = np.triu(prob_iou(boxes[order], boxes[order]) > 0.45, 1)
        assert fast_nms(boxes, score, 0.45).tolist() == order[~over.any(axis=0)].tolist()


def test_tiles_full_of_boxes_are_compared_in_bounded_memory():
    image = np.zeros((400, 400, 3), np.uint8)
    ones = np.ones(300)
    full = Detections(cx=50 * ones, cy=50 * ones, w=9 * ones, h=4 * ones, angle=0 * ones, score=ones, heading=ones)
    tiles = tile_grid((400, 400), (100, 100), 8.0)
    tracemalloc.start()
    found = detect_in_tiles(image, tiles, lambda parts: [full] * len(parts))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(tiles) * 300 > MAX_COMPARED
    assert 1 <= len(found) <= len(tiles)
    assert peak < 300 << 20


def test_an_image_full_of_boxes_is_cut_to_the_best_and_told_once(monkeypatch):
    tracked, track = [], Tracker.update

    def update(tracker, detections, *more, **named):
        tracked.append(len(detections))
        return track(tracker, detections, *more, **named)

    monkeypatch.setattr(Tracker, "update", update)
    analysis = Analysis(open_session(SWARM))
    pipeline = Pipeline(analysis.mission)
    count = 5000
    ones = np.ones(count)
    score = np.linspace(0.3, 0.9, count)
    boxes = Detections(
        cx=900 * ones, cy=500 * ones, w=70 * ones, h=40 * ones, angle=0 * ones, score=score, heading=ones
    )
    told = []
    for frame in range(5):
        snapshot = pipeline.add_frame(frame, int(analysis.times_us[frame]), detections=boxes)
        told += [event.text for event in snapshot.events if "boxes in a frame" in event.text]
    assert tracked == [MAX_BOXES] * 5, "no more is worked on"
    assert len(snapshot.boxes) <= MAX_BOXES
    assert told == [f"{count} boxes in a frame, only the {MAX_BOXES} best count: the detector sees what is not there"]
    analysis.close()


@pytest.mark.parametrize(
    "notes",
    [
        {"stride": "0"},
        {"stride": "1000000000"},
        {"nominal_length_px": "nan"},
        {"nominal_length_px": "1e300"},
        {"nominal_length_m": "0"},
        {"nominal_length_m": "-1"},
        {"stride": "9" * 5000},
    ],
)
def test_notes_of_a_map_that_cannot_be_are_refused(tmp_path, notes):
    metadata = {"rollcall": "1", "stride": "4", "nominal_length_m": "4.5", "nominal_length_px": "40"} | notes
    path = model(
        tmp_path / "m.onnx",
        ("image", UINT8, [1, "h", "w", 3]),
        ("map", FLOAT, [1, 9, "y", "x"]),
        metadata,
        np.zeros((1, 9, 8, 8)),
    )
    with pytest.raises(ModelError, match="metadata"):
        open_detector(path)


def test_a_map_of_another_size_is_refused(tmp_path):
    metadata = {"rollcall": "1", "stride": "4", "nominal_length_m": "4.5", "nominal_length_px": "40"}
    path = model(
        tmp_path / "m.onnx",
        ("image", UINT8, [1, "h", "w", 3]),
        ("map", FLOAT, [1, 9, "y", "x"]),
        metadata,
        np.zeros((1, 9, 8, 8)),
    )
    with pytest.raises(ModelError, match="gave a map"):
        open_detector(path).detect(black())


@pytest.mark.parametrize("options", [{"crop": [3, 100_000, 100_000]}, {"batch": 10**9}])
def test_a_classifier_of_fronts_is_bounded_too(tmp_path, options):
    path = classifier(tmp_path / "f.onnx", np.zeros((3 * 8 * 8, 4), np.float32), 8, **options)
    with pytest.raises(ModelError):
        open_front_classifier(path)


def test_anchors_of_a_canvas_are_as_they_were():
    assert raw().shape == (1, 8, ANCHORS)
