"""COCO files: boxes go to their images, and what makes no sense is refused with its place."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from vision.errors import LabelError
from vision.evaluation import open_folder
from vision.evaluation.coco import read_coco
from vision.evaluation.truth import REGION

CAR, BUS = {"id": 3, "name": "car"}, {"id": 7, "name": "bus"}


def box(image_id, category_id=3, bbox=(10.0, 20.0, 40.0, 16.0), **more):
    return {"image_id": image_id, "category_id": category_id, "bbox": list(bbox), **more}


def write(
    root, images=("a.png", "b.png"), annotations=(), name="annotations/instances.json", present=("a.png", "b.png")
):
    for place in present:
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(root / place), np.zeros((60, 80, 3), np.uint8))
    table = {
        "images": [{"id": i, "file_name": file, "width": 80, "height": 60} for i, file in enumerate(images)],
        "annotations": list(annotations),
        "categories": [CAR, BUS],
    }
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_text(json.dumps(table))
    return root


def test_boxes_go_to_their_images(tmp_path):
    opened = open_folder(write(tmp_path, annotations=[box(1), box(1, 7, (0, 0, 60, 20), iscrowd=1)]))
    assert opened.format == "coco"
    empty, full = opened.images
    assert (empty.name, len(empty.truth)) == ("a.png", 0)
    assert full.truth.boxes.tolist() == [[30.0, 28.0, 40.0, 16.0, 0.0], [30.0, 10.0, 60.0, 20.0, 0.0]]
    assert full.truth.name.tolist() == ["car", "bus"]
    assert full.truth.counts.tolist() == [True, False]
    assert full.truth.upright
    assert full.read().shape == (60, 80, 3)


def test_images_are_found_below_other_folders_and_counted_where_they_are_not(tmp_path):
    opened = open_folder(
        write(
            tmp_path,
            images=("a.png", "west/c.png", "gone.png"),
            present=("images/a.png", "images/west/c.png", "images/east/c.png"),
        )
    )
    assert [image.name for image in opened.images] == ["images/a.png", "images/west/c.png"]
    assert (opened.unlabelled, opened.missing) == (1, 1)


def test_labels_beside_images_come_first_unless_coco_is_asked_for(tmp_path):
    write(tmp_path, annotations=[box(0)])
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.2 0.2\n")
    assert open_folder(tmp_path).format == "yolo"
    assert open_folder(tmp_path, "coco").format == "coco"


@pytest.mark.parametrize(
    ("annotation", "message"),
    [
        (box(9), "annotation 1: image_id 9"),
        (box(0, 4), "annotation 1: category_id 4"),
        ({"image_id": 0, "category_id": 3}, r"instances\.json: .*bbox"),
        (box(0, bbox=(1, 2, 3)), r"instances\.json: .*length"),
    ],
)
def test_nonsense_is_refused_with_its_place(tmp_path, annotation, message):
    with pytest.raises(LabelError, match=message):
        open_folder(write(tmp_path, annotations=[box(0), annotation]))


def test_an_image_that_may_be_one_or_the_other_is_refused(tmp_path):
    folder = write(tmp_path, images=("c.png",), present=("west/c.png", "east/c.png"))
    with pytest.raises(LabelError, match=r"may be .*east/c\.png or .*west/c\.png"):
        open_folder(folder)


def test_an_image_labelled_twice_is_refused(tmp_path):
    write(tmp_path)
    with pytest.raises(LabelError, match=r"'a\.png' is labelled more than once"):
        open_folder(write(tmp_path, name="second.json"))


def test_other_json_is_no_coco_file(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((60, 80, 3), np.uint8))
    (tmp_path / "notes.json").write_text('{"by": "nobody"}')
    with pytest.raises(LabelError, match="1 images, none with labels"):
        open_folder(tmp_path)
    with pytest.raises(LabelError, match="none with labels"):
        open_folder(tmp_path, "coco")


def test_regions_without_labels_keep_their_name(tmp_path):
    write(tmp_path, annotations=[box(0)])
    path = tmp_path / "annotations/instances.json"
    path.write_text(path.read_text().replace('"car"', json.dumps(REGION)))
    assert open_folder(tmp_path).images[0].truth.name.tolist() == [REGION]


def test_boxes_without_area_are_left_out_and_counted(tmp_path):
    boxes = [box(1), box(1, bbox=(10, 20, 0, 5)), box(0, bbox=(10, 20, 5, 0))]
    opened = open_folder(write(tmp_path, annotations=boxes))
    assert opened.without_area == 2
    assert [len(image.truth) for image in opened.images] == [0, 1]


def test_paths_as_windows_writes_them(tmp_path):
    images = ("images\\a.png", "images\\b.png")
    opened = open_folder(write(tmp_path, images=images, present=("images/a.png", "images/b.png")))
    assert [image.name for image in opened.images] == ["images/a.png", "images/b.png"]
    assert opened.missing == 0


def test_bytes_that_are_no_text_are_refused_in_a_line(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b'{"images": [], "annotations": [], "categories": [{"id": 1, "name": "ca\xff\xff"}]}')
    with pytest.raises(LabelError, match=r"a\.json: is no COCO file"):
        read_coco(path)


def test_a_file_nested_without_end_is_refused(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"images": [], "annotations": [], "more": ' + "[" * 100_000)
    with pytest.raises(LabelError, match="is no COCO file of boxes: maximum recursion depth"):
        read_coco(path)
