"""An image of the frames that went worst: misses red, false alarms yellow, hits green, what does not count grey."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import corners
from vision.detect.detections import Detections
from vision.evaluation.matching import FALSE_ALARM, match, upright_boxes
from vision.evaluation.truth import LabelledImage

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

RED, YELLOW, GREEN, GREY = (60, 60, 240), (40, 220, 250), (90, 220, 90), (170, 170, 170)
"""BGR."""
TILE_PX = 960
"""Side of a frame's tile."""
READABLE_PX = 24.0
"""Least median length of vehicles on a tile: larger frames show only the part that went worst."""


def worst(
    images: Sequence[LabelledImage], found: Sequence[Detections], score: float, most: int = 4
) -> list[tuple[int, int, int]]:
    """Frames with the most misses and false alarms, worst first: (index, misses, false alarms)."""
    counts = []
    for i, (image, one) in enumerate(zip(images, found, strict=True)):
        truth = match(one, image.truth).truth[0]
        hit = truth[(truth >= 0) & (one.score >= score)]
        misses = int(image.truth.counts.sum()) - len(hit)
        counts.append((i, misses, int(((truth == FALSE_ALARM) & (one.score >= score)).sum())))
    counts.sort(key=lambda c: (-(c[1] + c[2]), c[0]))
    return [c for c in counts[:most] if c[1] + c[2]] or counts[:1]


def worst_sheet(images: Sequence[LabelledImage], found: Sequence[Detections], score: float, most: int = 4) -> Image:
    """Tiles of the worst frames in two columns, (H, W, 3) BGR."""
    tiles = [
        _tile(images[i], found[i], score, f"{images[i].name}: {misses} missed, {false} false alarms")
        for i, misses, false in worst(images, found, score, most)
    ]
    if len(tiles) == 1:
        return tiles[0]
    return np.vstack([_beside(tiles[k : k + 2]) for k in range(0, len(tiles), 2)])


def _beside(tiles: Sequence[Image]) -> Image:
    """One row of the sheet, as high as its highest tile."""
    row = np.zeros((max(len(tile) for tile in tiles), 2 * TILE_PX, 3), np.uint8)
    for k, tile in enumerate(tiles):
        row[: len(tile), k * TILE_PX : (k + 1) * TILE_PX] = tile
    return row


def _tile(labelled: LabelledImage, found: Detections, score: float, title: str) -> Image:
    strong = found.select(found.score >= score)
    number = match(strong, labelled.truth).truth[0]
    missed = labelled.truth.counts.copy()
    missed[number[number >= 0]] = False
    objects, boxes = labelled.truth.boxes, strong.boxes
    if labelled.truth.upright:
        boxes = upright_boxes(boxes)
    marks = [(objects[~labelled.truth.counts], GREY), (boxes[number >= 0], GREEN)]
    marks += [(objects[missed], RED), (boxes[number == FALSE_ALARM], YELLOW)]
    image = labelled.read()
    wrong = np.concatenate([objects[missed], boxes[number == FALSE_ALARM]])[:, :2]
    scale, corner = _frame(image, objects[labelled.truth.counts], wrong)
    turn = np.array([[scale, 0.0, -scale * corner[0]], [0.0, scale, -scale * corner[1]]])
    canvas = _cut(image, scale, corner)
    for rows, color in marks:
        rings = corners(rows) @ turn[:, :2].T + turn[:, 2]
        fixed = np.rint(np.clip(rings, -1e4, 1e4) * 16.0).astype(np.int32)
        cv2.polylines(canvas, list(fixed), True, color, 2, cv2.LINE_AA, 4)
    cv2.rectangle(canvas, (0, 0), (TILE_PX, 30), (20, 20, 20), cv2.FILLED)
    cv2.putText(canvas, _ascii(title)[-90:], (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (230, 230, 230), 1, cv2.LINE_AA)
    return canvas


def _cut(image: Image, scale: float, corner: Floats) -> Image:
    """The part of an image that a tile shows, TILE_PX wide and as high as there is image."""
    high, wide = (min(TILE_PX, max(round(n * scale), 1)) for n in image.shape[:2])
    x, y = (int(c) for c in corner)
    part = image[y : y + int(np.ceil(high / scale)), x : x + int(np.ceil(wide / scale))]
    canvas = np.zeros((high, TILE_PX, 3), np.uint8)
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    canvas[:, :wide] = cv2.resize(part, (wide, high), interpolation=how)
    return canvas


def _frame(image: Image, objects: Floats, wrong: Floats) -> tuple[float, Floats]:
    """Scale and upper left corner, px of the image, of what a tile shows: all, or the part with most mistakes."""
    height, width = image.shape[:2]
    scale = TILE_PX / max(height, width)
    if len(objects):
        length = float(np.median(np.maximum(objects[:, 2], objects[:, 3])))
        scale = max(scale, min(READABLE_PX / max(length, 1.0), 2.0))
    reach = TILE_PX / scale
    room = np.maximum(np.array([width, height]) - reach, 0.0)
    if not len(wrong) or not room.any():
        return scale, np.zeros(2)
    start = np.clip(wrong - 0.5 * reach, 0.0, room)
    within = ((wrong[None] >= start[:, None]) & (wrong[None] <= start[:, None] + reach)).all(axis=-1).sum(axis=1)
    return scale, np.floor(start[int(np.argmax(within))])


def _ascii(text: str) -> str:
    return "".join(letter if " " <= letter <= "~" else "?" for letter in text)
