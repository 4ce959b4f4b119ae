"""Training labels: our own reader and evaluation read them back; others: bench/results/interop/labels.md."""

import csv
import json
import math
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from gcs.export.formats import FORMATS
from gcs.export.job import ExportJob
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import CURVED_ROAD, shortened
from tests.support.command_line import run_gcs
from tests.support.snapshots import box, snapshot
from vision.detect.detections import Detections
from vision.evaluation import evaluate, open_folder

LABELS = ("yolo", "dota", "coco", "cvat")
IMAGE = np.full((48, 64, 3), 90, np.uint8)


def exported(name, path, *snapshots, **job):
    sink = FORMATS[name].open(ExportJob(path=path, name="a", video=path, **job))
    for each in snapshots:
        sink.write(each)
    sink.close()
    return path


def seen(frame=0, *boxes):
    shown = snapshot(frame, boxes=boxes, image=IMAGE)
    return replace(shown, seen_us=shown.t_us)


def images(folder):
    return sorted(path.name for path in folder.rglob("*.jpg"))


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Every second of 13 frames, exported to all formats, and the snapshots."""
    folder = tmp_path_factory.mktemp("labels")
    session = open_session(shortened(CURVED_ROAD, folder / "flight", 13))
    analysis = Analysis(session)
    sinks = [FORMATS[name].open(ExportJob(path=folder / name, video=session.video)) for name in LABELS]
    shown = []
    for count, one in enumerate(analysis.snapshots()):
        if count % 2 == 0:
            shown.append(replace(one, image=None))
            for sink in sinks:
                sink.write(one)
    for sink in sinks:
        sink.close()
    analysis.close()
    return folder, shown


@pytest.mark.slow
@pytest.mark.parametrize("name", ["yolo", "dota", "coco"])
def test_eval_detector_finds_each_exported_box(flight, name):
    folder, shown = flight
    read = open_folder(folder / name, corners_tell_front=name != "coco")
    assert read.format == name
    by_name = {f"frame_{one.frame:06d}.jpg": one for one in shown}
    found = []
    for image in read.images:
        boxes = [one for one in by_name[image.name.split("/")[-1]].new_boxes if not one.coasting]
        keys = ("cx", "cy", "w", "h", "angle", "heading")
        columns = {key: np.array([getattr(one, key) for one in boxes]) for key in keys}
        found.append(Detections(**columns, score=np.full(len(boxes), 0.9)))
    assert sum(map(len, found)) >= 40
    result = evaluate(found, [image.truth for image in read.images], score=0.3, floor=0.01)
    assert result.ap50 == 1.0
    if name != "coco":
        for image, one in zip(read.images, found, strict=True):
            assert np.abs(np.sin(0.5 * (image.truth.heading - one.heading))).max() < 0.02


def test_cvat_turns_boxes_about_their_middle(flight):
    folder, shown = flight
    by_name = {f"frame_{one.frame:06d}.jpg": one for one in shown}
    labels = ElementTree.parse(folder / "cvat" / "annotations.xml").getroot()
    assert len(labels.findall("image")) == len(images(folder / "cvat")) > 5
    for image in labels.findall("image"):
        boxes = [one for one in by_name[image.get("name")].new_boxes if not one.coasting]
        for label, one in zip(image.findall("box"), boxes, strict=True):
            left, top, right, bottom = (float(label.get(key)) for key in ("xtl", "ytl", "xbr", "ybr"))
            assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx((one.cx, one.cy), abs=0.02)
            assert (right - left, bottom - top) == pytest.approx((one.w, one.h), abs=0.02)
            rotation = float(label.get("rotation", "0"))
            assert 0.0 <= rotation < 360.0
            assert math.cos(math.radians(rotation) - one.angle) > 0.9999
            told = {one.get("name"): one.text for one in label.findall("attribute")}
            assert told.get("system_id") == (str(one.system_id) if one.system_id else None)
            assert ("name" in told) == bool(one.system_id)


def test_coco_has_the_area_of_its_outline(flight):
    folder, _ = flight
    labels = json.loads((folder / "coco" / "annotations" / "instances_default.json").read_text())
    assert len(labels["annotations"]) > 40
    for one in labels["annotations"]:
        mask = np.zeros((1080 * 4, 1920 * 4), np.uint8) if one["id"] % 20 == 1 else None
        if mask is None:
            continue
        outline = np.array(one["segmentation"][0]).reshape(-1, 2)
        cv2.fillPoly(mask, [np.round(4 * outline).astype(np.int32)], 1)
        assert mask.sum() / 16 == pytest.approx(one["area"], rel=0.03)
        assert cv2.contourArea(outline.astype(np.float32)) == pytest.approx(one["area"], rel=0.01)
        assert one["bbox"][:2] == pytest.approx(outline.min(axis=0).tolist(), abs=0.02)


def test_an_outline_ends_at_the_edge_of_the_image(tmp_path):
    cut = box(1, 2, cx=5.0, cy=20.0, w=30.0, h=10.0, angle=0.0)
    folder = exported("coco", tmp_path / "a", seen(0, cut))
    (one,) = json.loads((folder / "annotations" / "instances_default.json").read_text())["annotations"]
    assert (one["bbox"], one["area"]) == ([0.0, 15.0, 20.0, 10.0], 200.0)


def test_frames_in_which_a_vehicle_may_lack_its_box_are_left_out(tmp_path):
    sure, other = box(1, 2), replace(box(2, 3), confidence=0.6)
    shown = [
        seen(0, sure),
        seen(1, sure, other),
        seen(2, sure, box(3, 0)),
        seen(3, sure, box(2, 3, coasting=True)),
        seen(4, sure, box(2, 3, coasting=True, cx=-30.0)),
        replace(seen(5, sure), seen_us=1),
        seen(6),
        replace(seen(7), seen_us=0),
        seen(8, box(1, 2, cx=70.0)),
        replace(seen(9, sure), image=None),
    ]
    told = []
    everything = exported("yolo", tmp_path / "all", *shown, note=told.append)
    assert [name[6:12] for name in images(everything)] == ["000000", "000001", "000002", "000004", "000006"]
    assert told == ["5 of 10 frames are left out, with reasons in left_out.csv"]
    with (everything / "left_out.csv").open() as file:
        assert {row["frame"]: row["reason"] for row in csv.DictReader(file)} == {
            "3": "track 2 was not found",
            "5": "not looked at",
            "7": "not looked at",
            "8": "a box is not in the image",
            "9": "no image",
        }
    certain = exported("yolo", tmp_path / "sure", *shown, min_confidence=0.9)
    assert [name[6:12] for name in images(certain)] == ["000000", "000004", "000006"]
    assert (certain / "labels/train/frame_000006.txt").read_text() == ""


@pytest.mark.parametrize("name", LABELS)
def test_strangers_have_no_name_and_a_broken_export_leaves_nothing(tmp_path, name):
    stranger = box(9, 0, runner_up=2, runner_up_confidence=0.6, cx=30.0)
    folder = exported(name, tmp_path / "a", seen(0, stranger))
    assert not any(b"Alpha" in path.read_bytes() for path in folder.rglob("*.*") if path.suffix != ".jpg")
    with (folder / "boxes.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["system_id"], row["name"], row["confidence"]) == ("", "", "0.9800")
    broken = FORMATS[name].open(ExportJob(path=tmp_path / "b", video=folder))
    broken.write(seen(0, stranger))
    broken._folder._boxes_file.close()
    if name == "cvat":
        broken._file.close()
    del broken
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.slow
def test_from_the_command_line(tmp_path):
    flight = shortened(CURVED_ROAD, tmp_path / "flight", 12)
    words = ("export", flight, "-f", "dota", "-o", tmp_path / "d")
    code, _, err = run_gcs(*words, "--every", "4", "--min-confidence", "0.5")
    assert code == 0, err
    assert images(tmp_path / "d") == ["frame_000000.jpg", "frame_000004.jpg", "frame_000008.jpg"]
    assert "gcs: 3 frames written to" in err
    code, _, err = run_gcs(*words[:-1], tmp_path / "none", "--every", "4", "--min-confidence", "1")
    assert code == 0, err
    assert "gcs: 0 frames written to" in err
    code, _, err = run_gcs(*words)
    assert code
    assert "exists already" in err
