"""Crops to learn from: out of a video with any detector, or a folder of images that are crops already.

A crop has the vehicle's longer side along x, the front at either end; it is half as long again as it is high, whatever
the vehicle, so that no box in it is square. Crops of a video keep more of the surroundings than a classifier sees, for
boxes are jittered in training.
"""

from __future__ import annotations

import csv
import logging
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from training.fronts.vehicles import Vehicles
from vision.detect.boxes import canonical, corners
from vision.detect.detector import Detector, open_detector
from vision.detect.front_crops import rectify
from vision.errors import ModelError, VideoError
from vision.video.video import VideoFile

Image = NDArray[np.uint8]

LENGTH, ACROSS = 144, 96
"""Size of a crop, px."""
WIDE = 0.5
"""Margin of the crops of a video."""
MIN_PX = 8.0
"""A vehicle of a shorter box shows no front."""
IMAGES = (".png", ".jpg", ".jpeg")
"""Suffixes of files that are read as images."""
COLUMNS = ("crop", "frame", "cx", "cy", "w", "h", "angle", "score")
"""Columns of ``crops.csv``: number of crop and frame, box in px and rad, detector's score."""
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crops:
    """n crops in the order of time, or of their names."""

    images: Image
    """(n, ACROSS, LENGTH, 3) BGR."""
    margin: float
    """Margin beyond the box that crops show, a share of its sides."""
    length_px: NDArray[np.float64]
    """(n,) of the vehicles where they were found."""

    def __len__(self) -> int:
        return len(self.images)

    def vehicles(self, right: NDArray[np.bool_]) -> Vehicles:
        """With the front at the right where ``right`` (n,), else at the left."""
        size = np.array([LENGTH, ACROSS]) / (1.0 + self.margin)
        boxes = np.tile([LENGTH / 2.0, ACROSS / 2.0, *size, 0.0], (len(self), 1))
        boxes[:, 4] = np.where(right, 0.0, np.pi)
        return Vehicles(images=self.images, boxes=boxes)


def detector_of(mission: Path | None) -> Detector:
    """The detector that a mission file's ``[detector]`` names, the bundled one without."""
    if mission is None:
        return open_detector()
    try:
        table = tomllib.loads(mission.read_text(encoding="utf-8")).get("detector", {})
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ModelError(f"{mission}: cannot be read as a mission file: {error}") from error
    model = table.get("model", "")
    return open_detector(mission.parent / model if model else None, score=float(table.get("score", 0.3)))


def collect_video(path: Path, detector: Detector, out: Path, frames: int, most: int) -> None:
    """Cut the vehicles out of frames spread over a video; writes ``crops/*.png`` and, last, ``crops.csv``."""
    rows: list[tuple[float, ...]] = []
    folder = out / "crops"
    folder.mkdir(parents=True, exist_ok=True)
    with VideoFile.open(path) as video:
        step = max(video.n // frames, 1)
        for frame in video.frames():
            if frame.index % step or len(rows) >= most:
                continue
            found = detector.detect(frame.image)
            boxes = canonical(found.boxes)
            whole = _whole(boxes, frame.image) & (boxes[:, 2] >= MIN_PX)
            for box, score in zip(boxes[whole], found.score[whole], strict=True):
                cv2.imwrite(str(_path(folder, len(rows))), _cut(frame.image, box, WIDE))
                rows.append((len(rows), frame.index, *box.tolist(), float(score)))
    if not rows:
        raise VideoError(f"{path}: not one vehicle was found in {frames} of its frames; choose another detector")
    _write(out / "crops.csv", rows)
    log.info("%d crops of %d frames of %s", len(rows), len({row[1] for row in rows}), path)


def collect_folder(path: Path, out: Path, most: int) -> None:
    """Take images of a folder for crops of boxes without a margin; one that is upright is turned by a quarter."""
    folder = out / "crops"
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[float, ...]] = []
    for image in _images(path):
        if len(rows) < most:
            height, width = image.shape[:2]
            box = canonical([[width / 2, height / 2, width, height, 0.0]])
            cv2.imwrite(str(_path(folder, len(rows))), _cut(image, box[0], 0.0))
            rows.append((len(rows), len(rows), *box[0].tolist(), 1.0))
    if not rows:
        raise VideoError(f"{path}: no image in it; a folder of {', '.join(IMAGES)} is needed, one vehicle on each")
    _write(out / "crops.csv", rows)
    log.info("%d crops of %s", len(rows), path)


def read_crops(out: Path, margin: float) -> Crops:
    """Crops that were collected."""
    with (out / "crops.csv").open() as file:
        length_px = np.array([float(row["w"]) for row in csv.DictReader(file)])
    images = np.zeros((len(length_px), ACROSS, LENGTH, 3), np.uint8)
    for number in range(len(images)):
        path = _path(out / "crops", number)
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None or image.shape != images.shape[1:]:
            raise VideoError(f"{path}: is gone or another image; delete {out / 'crops.csv'} and run again")
        images[number] = image
    return Crops(images=images, margin=margin, length_px=length_px)


def _images(path: Path) -> Iterator[Image]:
    if not path.is_dir():
        raise VideoError(f"{path}: no such folder of crops")
    for file in sorted(p for p in path.iterdir() if p.suffix.lower() in IMAGES):
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if image is None:
            log.warning("%s: cannot be read as an image and is left out", file)
            continue
        yield np.asarray(image, dtype=np.uint8)


def _cut(image: Image, box: NDArray[np.float64], margin: float) -> Image:
    (square,) = rectify(image, box, LENGTH, margin)
    return np.asarray(cv2.resize(square, (LENGTH, ACROSS), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _whole(boxes: NDArray[np.float64], image: Image) -> NDArray[np.bool_]:
    """(n,) whether the whole box is in the image."""
    points = corners(boxes)
    inside = (points >= 0.0) & (points <= (image.shape[1], image.shape[0]))
    return np.asarray(inside.all(axis=(1, 2)))


def _path(folder: Path, number: int) -> Path:
    return folder / f"{number:05d}.png"


def _write(path: Path, rows: list[tuple[float, ...]]) -> None:
    part = path.with_suffix(".part")
    with part.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows((*row[:2], *(f"{value:.3f}" for value in row[2:])) for row in rows)
    part.replace(path)
