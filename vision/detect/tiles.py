"""Detection in overlapping tiles of a large image: small vehicles keep their size and memory stays bounded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import nms
from vision.detect.detections import Detections

SAME = 0.45
"""Boxes of two tiles that overlap more (probabilistic IoU) are one vehicle's."""
OVERLAP_LENGTHS = 4.0
"""Overlap of tiles, in vehicles of the length that a model was trained for: lorries are twice as long."""
MAX_COMPARED = 1000
"""Boxes of all tiles, the best ones: to compare all with all takes the square of their number in time and memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """A part of an image, px: the part that is searched, and where the centre of a box must lie to count."""

    left: int
    top: int
    right: int
    bottom: int
    kept: tuple[float, float, float, float]
    """x0, y0, x1, y1: half of the overlap with each neighbour, and a little more lest a vehicle falls between two."""


def tile_grid(image: tuple[int, int], tile: tuple[int, int], overlap: float) -> tuple[Tile, ...]:
    """The fewest tiles that cover an image, of one size, no larger than needed.

    A vehicle at a seam is whole in one of the tiles in which it counts, if half the overlap is as long as the vehicle.

    Args:
        image: (width, height) px.
        tile: (width, height) px, largest size of a tile.
        overlap: of neighbours, px; at most half a tile is taken.
    """
    columns, rows = (_spans(length, side, overlap) for length, side in zip(image, tile, strict=True))
    return tuple(
        Tile(left=x0, top=y0, right=x1, bottom=y1, kept=(bx0, by0, bx1, by1))
        for y0, y1, by0, by1 in rows
        for x0, x1, bx0, bx1 in columns
    )


def detect_in_tiles(
    image: NDArray[np.uint8],
    tiles: Sequence[Tile],
    detect: Callable[[Sequence[NDArray[np.uint8]]], Sequence[Detections]],
) -> Detections:
    """Vehicles of all tiles, in pixels of the image, best first; one that two tiles saw counts once.

    Args:
        image: (H, W, 3) the image.
        detect: finds the vehicles in each of a list of parts.
    """
    seen = detect([image[tile.top : tile.bottom, tile.left : tile.right] for tile in tiles])
    parts = [_placed(found, tile) for found, tile in zip(seen, tiles, strict=True)]
    columns = np.concatenate([part.table for part in parts], axis=1)
    cx, cy, w, h, angle, score, heading = columns
    found = Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=score, heading=heading)
    if len(found) > MAX_COMPARED:
        found = found.select(np.sort(np.argsort(-score, kind="stable")[:MAX_COMPARED]))
    return found.select(nms(found.boxes, found.score, SAME))


def _placed(found: Detections, tile: Tile) -> Detections:
    moved = replace(found, cx=found.cx + tile.left, cy=found.cy + tile.top)
    x0, y0, x1, y1 = tile.kept
    return moved.select((moved.cx >= x0) & (moved.cx <= x1) & (moved.cy >= y0) & (moved.cy <= y1))


def _spans(length: int, side: int, overlap: float) -> list[tuple[int, int, float, float]]:
    """Tiles along one axis: first and last pixel, and from where to where centres count."""
    if side >= length:
        return [(0, length, -np.inf, np.inf)]
    overlap = min(overlap, side / 2)
    count = int(np.ceil((length - overlap) / (side - overlap) - 1e-9))
    # count · side − (count − 1) · overlap = length
    side = min(side, int(np.ceil((length + (count - 1) * overlap) / count)))
    starts = np.round(np.linspace(0, length - side, count)).astype(int).tolist()
    spans = []
    for k, start in enumerate(starts):
        shared_before = starts[k - 1] + side - start if k else 0
        shared_after = start + side - starts[k + 1] if k + 1 < count else 0
        low = start + shared_before / 4 if k else -np.inf
        high = start + side - shared_after / 4 if k + 1 < count else np.inf
        spans.append((start, start + side, low, high))
    return spans
