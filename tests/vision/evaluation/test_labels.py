"""Labels of every layout say the same; broken ones are refused with their line; the command measures a folder."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from gcs.cli.detectors.eval_detector import eval_detector
from gcs.errors import GcsError
from vision.detect.boxes import corners, rotated_iou
from vision.detect.detections import Detections
from vision.detect.detector import BUNDLED
from vision.errors import LabelError
from vision.evaluation import open_folder

SIZE = (640, 360)
BOX = np.array([200.0, 120.0, 60.0, 24.0, 0.4])
RING = corners(BOX)
"""Clockwise from top left of a car that looks along +x: the front is the side from the second to the third corner."""
FRONT_FIRST = np.roll(RING, -1, axis=0)


def words(values):
    return " ".join(f"{v:.6f}" for v in np.ravel(values))


YOLO = f"1 {words(RING / SIZE)}\n"
DOTA = f"imagesource:GoogleEarth\ngsd:0.08\n{words(RING)} large-vehicle 0\n{words(RING + 90)} small-vehicle 1\n"
VISDRONE = "170,108,60,24,1,4,0,1\n10,10,90,60,0,0,0,0\n300,100,20,20,1,1,0,0,\n"


def folder_of(root, label, place="pic.txt", image="pic.png"):
    for path in (root / image, root / place):
        path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(root / image), np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
    (root / place).write_text(label)
    return root


def only(folder):
    (image,) = folder.images
    return image


@pytest.mark.parametrize(
    ("label", "form", "names"),
    [
        (YOLO, "yolo", ["1"]),
        (f"0 {words(BOX[:4] / (*SIZE, *SIZE))}\n", "yolo", ["0"]),
        (DOTA, "dota", ["large-vehicle", "small-vehicle"]),
        (VISDRONE, "visdrone", ["car", "ignored regions", "pedestrian"]),
    ],
)
def test_layouts_are_told_from_the_labels(tmp_path, label, form, names):
    opened = open_folder(folder_of(tmp_path, label))
    truth = only(opened).truth
    assert opened.format == form
    assert truth.name.tolist() == names
    assert truth.boxes[0, :2] == pytest.approx(BOX[:2], abs=0.01)
    assert np.isnan(truth.heading).all()
    oriented = not truth.upright
    assert rotated_iou(truth.boxes[:1], [BOX if oriented else [*BOX[:4], 0.0]])[0, 0] == pytest.approx(1.0, abs=1e-3)


def test_dota_tells_the_ground_resolution_and_what_is_difficult(tmp_path):
    image = only(open_folder(folder_of(tmp_path, DOTA)))
    assert image.gsd_m == 0.08
    assert image.truth.counts.tolist() == [True, False]


def test_visdrone_sets_regions_aside_and_tells_what_is_hidden(tmp_path):
    truth = only(open_folder(folder_of(tmp_path, VISDRONE))).truth
    assert truth.upright
    assert truth.counts.tolist() == [True, False, True]
    assert truth.hidden.tolist() == [1, 0, 0]


@pytest.mark.parametrize("form", ["yolo", "dota"])
def test_first_corners_tell_the_front_when_asked(tmp_path, form):
    label = f"0 {words(FRONT_FIRST / SIZE)}\n" if form == "yolo" else f"{words(FRONT_FIRST)} car 0\n"
    opened = open_folder(folder_of(tmp_path, label), corners_tell_front=True)
    assert only(opened).truth.heading[0] == pytest.approx(0.4 + np.pi / 2, abs=1e-4)


@pytest.mark.parametrize("labels", ["labels", "labelTxt", "annotations"])
def test_labels_may_lie_in_a_folder_of_their_own(tmp_path, labels):
    folder_of(tmp_path, YOLO, f"{labels}/val/a.txt", "images/val/a.png")
    folder_of(tmp_path, "", f"{labels}/val/empty.txt", "images/val/empty.png")
    cv2.imwrite(str(tmp_path / "images/val/nobody.png"), np.zeros((9, 9, 3), np.uint8))
    opened = open_folder(tmp_path)
    assert [(p.name, len(p.truth)) for p in opened.images] == [("images/val/a.png", 1), ("images/val/empty.png", 0)]
    assert opened.unlabelled == 1


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("data.yaml", "path: x\nnames:\n  0: bus\n  1: 'car'  # small\nnc: 2\n"),
        ("data.yaml", 'nc: 2\nnames: [bus, "car"]\n'),
        ("data.yaml", "names:\n- bus\n- car\n"),
        ("data.yaml", "names: ['bus, passenger', \"car\"]  # two\n"),
        ("data.yaml", "names:\n    0: bus\n    1: car\n"),
        ("classes.txt", "bus\ncar\n"),
        # a class without a name has a number all the same
        ("obj.names", "\ncar\n\n"),
    ],
)
def test_class_names_are_read_beside_the_labels(tmp_path, file, text):
    folder_of(tmp_path, YOLO)
    (tmp_path / file).write_text(text)
    assert only(open_folder(tmp_path)).truth.name.tolist() == ["car"]
    assert only(open_folder(tmp_path, names=["x", "lorry"])).truth.name.tolist() == ["lorry"]


def test_class_names_that_are_no_text_are_refused(tmp_path):
    folder_of(tmp_path, YOLO)
    (tmp_path / "classes.txt").write_bytes("bus\nVoiture à moteur\n".encode("latin-1"))
    with pytest.raises(LabelError, match=r"classes.txt: cannot be read as text: .*; save it as UTF-8"):
        open_folder(tmp_path)


@pytest.mark.parametrize("text", ["names: 3\n", "nc: 2\n", "names: [a\n", "- a\n", "names: {a: b}\n"])
def test_a_file_without_class_names_is_refused(tmp_path, text):
    folder_of(tmp_path, YOLO)
    (tmp_path / "data.yaml").write_text(text)
    with pytest.raises(LabelError, match=r"data\.yaml: (no list of class names|not YAML)"):
        open_folder(tmp_path)


@pytest.mark.parametrize(
    ("label", "form"),
    [
        ("0 0.1 0.1 0.2 0.2 0.3 0.3 0.4 0.4\n" + YOLO, "yolo"),
        ("0 0.5 0.5 0.1 0\n0 0.5 0.5 0.1 0.1\n", "yolo"),
        ("1,2,0,4,1,4,0,0\n1,2,3,4,1,4,0,0\n", "visdrone"),
        ("1,2,3,0,1,4,0,0\n1,2,3,4,1,4,0,0\n", "visdrone"),
        (f"{words(4 * [RING[0]])} car 0\n{words(RING)} car 0\n", "dota"),
    ],
)
def test_boxes_without_area_are_left_out_and_counted(tmp_path, label, form):
    opened = open_folder(folder_of(tmp_path, label), form)
    assert (opened.without_area, len(only(opened).truth)) == (1, 1)


@pytest.mark.parametrize(
    ("label", "form", "message"),
    [
        ("hello world\n", None, "line 1: 'hello world' is no label"),
        (YOLO + "1 0.1 0.2 0.3\n", None, r"pic.txt, line 2: 4 values, wanted 9"),
        (YOLO + f"1 {words(RING)}\n", None, "line 2: coordinates reach .* wanted shares"),
        ("0.5 0 0 1 0 1 1 0 1\n", None, "line 1: class '0.5' is no class number"),
        ("0 0.5 0.5 0.1 nan\n", None, "line 1: '0 0.5 0.5 0.1 nan' is no label"),
        (YOLO + "0 0.5 0.5 0.1 0.1\n", None, "cannot be judged together"),
        (f"{words(RING)} car 7\n", None, "line 1: difficult is '7'"),
        (f"{words(RING[:3])} x y car 0\n", "dota", "line 1: 'x' is no number"),
        ("imagesource:a\ngsd:-1\n", None, "line 2: gsd is -1"),
        ("1,2,3\n", "visdrone", "line 1: 3 values"),
        ("1,2,3,4,1,44,0,0\n", None, "line 1: category 44 is none"),
        ("1,2,3,4,1,4,0,9\n", None, "line 1: occlusion 9 is none"),
    ],
)
def test_broken_labels_name_file_line_and_fault(tmp_path, label, form, message):
    with pytest.raises(LabelError, match=message):
        open_folder(folder_of(tmp_path, label), form)


def test_folders_without_labels_or_images_are_refused(tmp_path):
    with pytest.raises(LabelError, match="no such folder"):
        open_folder(tmp_path / "none")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((9, 9, 3), np.uint8))
    with pytest.raises(LabelError, match="1 images, none with labels"):
        open_folder(tmp_path)
    with pytest.raises(LabelError, match=r"no crops_\*.npz"):
        open_folder(tmp_path, "shards")
    (tmp_path / "a.txt").write_text(YOLO)
    (tmp_path / "a.png").write_bytes(b"not an image")
    with pytest.raises(LabelError, match=r"a.png: cannot be read as an image"):
        open_folder(tmp_path)


def write_shard(path, **change):
    boxes = np.zeros((2, 3, 6), np.float32)
    boxes[0, :2] = [[30, 30, 20, 10, 1.0, 1.0], [60, 60, 20, 10, 2.0, 0.0]]
    arrays = {"images": np.zeros((2, 96, 96, 3), np.uint8), "boxes": boxes, "n": np.array([2, 0])}
    np.savez(path, **(arrays | change))
    return path


def test_shards_are_folders_too(tmp_path):
    opened = open_folder(write_shard(tmp_path / "crops_000001.npz").parent)
    first, second = opened.images
    assert (opened.format, len(first.truth), len(second.truth)) == ("shards", 2, 0)
    assert first.truth.counts.tolist() == [True, False]
    assert first.truth.heading == pytest.approx([1.0, 2.0])
    assert first.truth.boxes[0] == pytest.approx([30, 30, 20, 10, 1.0 - np.pi / 2])
    assert first.as_seen and first.read().shape == (96, 96, 3)


def test_broken_shards_are_refused(tmp_path):
    path = tmp_path / "crops_000001.npz"
    path.write_bytes(b"PK nothing")
    with pytest.raises(LabelError, match="no shard"):
        open_folder(path)
    with pytest.raises(LabelError, match="do not belong together"):
        open_folder(write_shard(path, n=np.array([2])))


def test_the_command_measures_a_folder(tmp_path, capsys):
    folder = folder_of(tmp_path / "set", YOLO + YOLO.replace("1 ", "0 ", 1))
    call(folder, names="bus,car", classes="car", ignore="bus", gsd=0.08, out=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "eval.json").read_text())
    assert (told["pictures"], told["objects"], told["aside"], told["ap50"]) == (1, 1, 1, 0.0)
    assert told["about"]["labels"] == "yolo"
    assert "| car | 1 | 0 | 0.000 | 0.000 |" in (tmp_path / "out" / "eval.md").read_text()
    assert cv2.imread(str(tmp_path / "out" / "worst.png")) is not None
    assert "AP50-95" in capsys.readouterr().out


def test_the_command_looks_at_the_resolution_that_labels_tell(tmp_path, monkeypatch):
    used = []

    class Knows:
        def detect(self, image, *, gsd_m=None):
            used.append((image.shape, gsd_m))
            cx, cy, w, h, angle = BOX[:, None]
            return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=np.array([0.9]), heading=np.array([np.nan]))

    monkeypatch.setattr("vision.detect.detector.open_detector", lambda model, **settings: Knows())
    folder = folder_of(tmp_path / "set", DOTA)
    call(folder, out=tmp_path / "out")
    call(folder, gsd=0.5)
    assert used == [((SIZE[1], SIZE[0], 3), 0.08), ((SIZE[1], SIZE[0], 3), 0.5)]
    told = json.loads((tmp_path / "out" / "eval.json").read_text())
    assert (told["ap50"], told["precision"], told["recall"], told["aside"]) == (1.0, 1.0, 1.0, 1)


def test_the_command_compares_two_models(tmp_path, monkeypatch, capsys):
    class Sees:
        def __init__(self, score):
            self.score = score

        def detect(self, image, *, gsd_m=None):
            cx, cy, w, h, angle = BOX[:, None]
            one, heading = np.array([self.score]), np.array([np.nan])
            return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=one, heading=heading)

    monkeypatch.setattr(
        "vision.detect.detector.open_detector", lambda model, **settings: Sees(0.2 if model is None else 0.9)
    )
    folder = folder_of(tmp_path / "set", DOTA)
    call(folder, model=BUNDLED, against="bundled", out=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "eval.json").read_text())["comparison"]
    recall = next(d for d in told["differences"] if d["name"] == "recall of centres")
    assert (told["against"], recall["one"], recall["other"], recall["interval"]) == ("bundled", 1.0, 0.0, [None, None])
    assert told["other"]["recall"] == 0.0
    assert cv2.imread(str(tmp_path / "out" / "apart.png")) is not None
    assert "| recall of centres | 1.000 | 0.000 | +1.000 | – to – |" in (tmp_path / "out" / "eval.md").read_text()
    assert "of bundled" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"form": "voc"}, "--format voc"),
        ({"classes": "zebra"}, "zebra|1"),
    ],
)
def test_the_command_explains_what_it_cannot_do(tmp_path, change, message):
    with pytest.raises((GcsError, LabelError), match=message):
        call(folder_of(tmp_path, YOLO), **change)


def call(folder, **change):
    settings = {
        "model": None,
        "against": None,
        "front": None,
        "gsd": None,
        "score": 0.3,
        "form": None,
        "classes": None,
        "ignore": None,
        "names": None,
        "corners_tell_front": False,
        "out": None,
    }
    eval_detector(folder, **(settings | change))
