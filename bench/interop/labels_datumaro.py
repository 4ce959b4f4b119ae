"""Images and boxes of exported training labels, by datumaro; of YOLO-OBB, for which it has no reader, by supervision.

Areas of COCO are compared with the masks that pycocotools makes of the outlines.

pip install datumaro supervision
python bench/interop/labels_datumaro.py KIND=FOLDER…      KIND: yolo, dota, coco or cvat
"""

from __future__ import annotations

import csv
import math
import sys
from collections import Counter, defaultdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

READERS = {"dota": "dota", "coco": "coco_instances", "cvat": "cvat"}


def main(named: list[str]) -> None:
    import datumaro

    print(", ".join(f"{name} {version(name)}" for name in ("datumaro", "pycocotools", "supervision")) + "\n")
    print("| labels | images | with pixels | shapes | attributes | areas differ, mean and most | corners differ |")
    print("|---|---:|---:|---|---|---:|---:|")
    for kind, _, folder in (one.partition("=") for one in named):
        if kind == "yolo":
            _print_yolo(Path(folder))
            continue
        found = datumaro.Dataset.import_from(folder, READERS[kind])
        items = list(found)
        shapes = [shape for item in items for shape in item.annotations]
        told = sorted({key for shape in shapes for key in shape.attributes})
        kinds = ", ".join(f"{n} {name}" for name, n in Counter(type(s).__name__ for s in shapes).items())
        pixels = sum(item.media is not None and item.media.data is not None for item in items)
        differ = _areas_differ(Path(folder)) if kind == "coco" else ""
        turned = f"{_corners_differ(Path(folder), items):.3f} px" if kind in ("cvat", "dota") else ""
        print(f"| {kind} | {len(items)} | {pixels} | {kinds} | {', '.join(told)} | {differ} | {turned} |")


def _print_yolo(folder: Path) -> None:
    import supervision

    images, labels = folder / "images" / "train", folder / "labels" / "train"
    data = str(folder / "data.yaml")
    found = list(supervision.DetectionDataset.from_yolo(str(images), str(labels), data, is_obb=True))
    boxes = sum(len(detections) for _, _, detections in found)
    pixels = sum(image is not None for _, image, _ in found)
    print(f"| yolo | {len(found)} | {pixels} | {boxes} OBB |  |  |  |")


def _corners_differ(folder: Path, items: list[Any]) -> float:
    """How far, at most, a corner that datumaro finds is from that of the same box in boxes.csv, px."""
    rows: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    with (folder / "boxes.csv").open() as file:
        for row in csv.DictReader(file):
            numbers = (float(row[key]) for key in ("cx_px", "cy_px", "w_px", "h_px", "angle_deg"))
            rows[row["image"].removesuffix(".jpg")].append(tuple(numbers))
    apart = 0.0
    for item in items:
        for found, shape in zip(item.annotations, rows[item.id], strict=True):
            ours = _corners(*shape)
            read = _corners(found.cx, found.cy, found.w, found.h, found.r)
            apart = max(apart, *(min(math.dist(a, b) for b in ours) for a in read))
    return apart


def _corners(cx: float, cy: float, w: float, h: float, degrees: float) -> list[tuple[float, float]]:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    halves = [(x * w / 2, y * h / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return [(cx + c * x - s * y, cy + s * x + c * y) for x, y in halves]


def _areas_differ(folder: Path) -> str:
    """By how much areas differ from those of the masks which pycocotools makes of the outlines."""
    from pycocotools.coco import COCO

    labels = COCO(str(folder / "annotations" / "instances_default.json"))
    ones = labels.loadAnns(labels.getAnnIds())
    shares = [100.0 * abs(float(labels.annToMask(one).sum()) / one["area"] - 1.0) for one in ones]
    return f"{sum(shares) / len(shares):.2f} %, {max(shares):.2f} %"


if __name__ == "__main__":
    main(sys.argv[1:])
