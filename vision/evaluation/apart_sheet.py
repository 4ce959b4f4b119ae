"""An image of what one detector finds and another misses: vehicles cut out, labels green, boxes yellow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import corners
from vision.detect.detections import Detections
from vision.evaluation.centres import match_centres
from vision.evaluation.matching import FALSE_ALARM
from vision.evaluation.truth import LabelledImage, Truth

Image = NDArray[np.uint8]

LABEL, BOX, INK, GROUND = (90, 220, 90), (40, 220, 250), (230, 230, 230), (20, 20, 20)
"""BGR."""
TILE_PX, TITLE_PX = 150, 26
COLUMNS, ROWS = 10, 3
"""Grid of tiles, of each of the kinds."""
AROUND = 2.2
"""Side of what a tile shows, lengths of the vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """Detection about which two detectors disagree."""

    image: int
    box: NDArray[np.float64]
    """(5,) of the detection, px."""
    score: float


def disagreements(
    one: Sequence[Detections], other: Sequence[Detections], truth: Sequence[Truth], score: float
) -> tuple[list[Disagreement], list[Disagreement]]:
    """Objects that only one finds, and its false alarms where the other has none; highest score first."""
    found, alarms = [], []
    for k, (mine, theirs, t) in enumerate(zip(one, other, truth, strict=True)):
        mine, theirs = (d.select(d.score >= score) for d in (mine, theirs))
        number, seen = match_centres(mine, t).truth[0], match_centres(theirs, t).truth[0]
        apart = np.linalg.norm(mine.centre[:, None] - theirs.centre[None], axis=2).min(axis=1, initial=np.inf)
        same = apart < 0.5 * mine.boxes[:, 2:4].max(axis=1, initial=0.0)
        for i in range(len(mine)):
            odd = Disagreement(image=k, box=mine.boxes[i], score=float(mine.score[i]))
            if number[i] >= 0 and number[i] not in seen:
                found.append(odd)
            elif number[i] == FALSE_ALARM and not same[i]:
                alarms.append(odd)
    return sorted(found, key=lambda o: -o.score), sorted(alarms, key=lambda o: -o.score)


def apart_sheet(images: Sequence[LabelledImage], kinds: Sequence[tuple[str, Sequence[Disagreement]]]) -> Image:
    """Tiles under a title for each kind, (H, W, 3) BGR."""
    shown = {odd.image for _, odds in kinds for odd in odds[: COLUMNS * ROWS]}
    # one image in memory at a time: 4K images by the hundred are too many
    tiles: dict[tuple[int, int], Image] = {}
    for k in sorted(shown):
        pixels = images[k].read()
        for n, (_, odds) in enumerate(kinds):
            for i, odd in enumerate(odds[: COLUMNS * ROWS]):
                if odd.image == k:
                    tiles[n, i] = _tile(pixels, odd, images[k].truth)
    return np.vstack([_block(title, odds, tiles, n) for n, (title, odds) in enumerate(kinds)])


def _block(title: str, odds: Sequence[Disagreement], tiles: dict[tuple[int, int], Image], n: int) -> Image:
    shown = min(len(odds), COLUMNS * ROWS)
    rows = max(-(-shown // COLUMNS), 1)
    block = np.full((TITLE_PX + rows * TILE_PX, COLUMNS * TILE_PX, 3), GROUND, np.uint8)
    words = f"{title}: {len(odds)}" + (f", the first {shown}" if shown < len(odds) else "")
    cv2.putText(block, words, (8, TITLE_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA)
    for i in range(shown):
        y, x = TITLE_PX + i // COLUMNS * TILE_PX, i % COLUMNS * TILE_PX
        block[y : y + TILE_PX, x : x + TILE_PX] = tiles[n, i]
    return block


def _tile(pixels: Image, odd: Disagreement, truth: Truth) -> Image:
    scale = TILE_PX / (AROUND * max(odd.box[2], odd.box[3], 1.0))
    # pixel centres: the middle of the tile is the middle of the box
    shift = 0.5 * TILE_PX - scale * odd.box[:2]
    turn = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    tile = np.asarray(cv2.warpAffine(pixels, turn, (TILE_PX, TILE_PX), flags=cv2.INTER_LINEAR), np.uint8)
    for rows, color in ((truth.boxes[truth.counts], LABEL), (odd.box[None], BOX)):
        rings = corners(rows) @ turn[:, :2].T + turn[:, 2]
        near = ((rings > -TILE_PX) & (rings < 2 * TILE_PX)).all(axis=(1, 2))
        cv2.polylines(tile, list(np.rint(rings[near] * 16.0).astype(np.int32)), True, color, 1, cv2.LINE_AA, 4)
    cv2.putText(tile, f"{odd.score:.2f}", (4, TILE_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA)
    return tile
