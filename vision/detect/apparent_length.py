"""Length of vehicles in an image of unknown ground resolution, by what the network itself finds at several scales.

A vehicle is found at the same place and with the same length in the image whatever the scale, as long as the network
can see it. What is no vehicle looks like one at a single scale at most: what a network takes for a vehicle by mistake
has a length that it was trained for on the canvas, and so another in the image at each scale. Boxes that two
neighbouring scales agree on are therefore evidence, and the length at which most of it lies is the vehicles'. Lorries,
and a roof that looks like one, lie elsewhere and move it little.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import prob_iou
from vision.detect.detections import Detections
from vision.detect.tiles import Tile, detect_in_tiles

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Look = Callable[[Image, float], Detections]
"""Looks at an image, scaled by a factor; its boxes are in pixels of that image."""

CAR_M = 4.5
"""Length that is meant: most vehicles are taken to be as long as a car."""
FLOOR = 0.15
"""Weaker boxes are no evidence."""
STEP = 2.0
"""Factor from one scale to the next: vehicles are seen over three octaves, and so by two or three neighbours."""
MIN_SIDE_PX = 200.0
"""Minimum side of the smallest canvas: a vehicle of the network's length would fill a quarter of a smaller one."""
AGREE = 0.5
"""Probabilistic overlap from which boxes of two scales are one vehicle's, if they are about as long."""
SAME_OCTAVES = 0.4
"""Lengths that differ by more are not the same: a third, where what is no vehicle differs by a whole ``STEP``."""
SPREAD_OCTAVES = 0.25
"""Standard deviation of the lengths of vehicles of one kind, with the error of the boxes."""
GRID_OCTAVES = 0.05
"""Resolution of the length."""
MIN_EVIDENCE, MIN_LENGTH_PX = 0.35, 40.0
"""Two vehicles that two scales find with a score of 0.4, where vehicles are this long on the finest canvas. Of shorter
ones an image has room for more, by the square, and what is none agrees by chance as much more often."""
CAR_ASPECT = 2.5
"""Length of a car, in widths. A bus is little wider than a car and three times as long: in a depot widths tell more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ApparentLength:
    """The length that most vehicles of an image have, or would have if they were cars of their width."""

    px: float
    """Length in pixels of the image."""
    evidence: float
    """Sum of squared scores of the boxes of about this length that two scales agree on."""


def examine(image: Image, look: Look, *, finest: float, most_px: float) -> Generator[None, None, ApparentLength | None]:
    """Look at an image at scales an octave apart, one each time that the generator is continued.

    Where an image is too large at a scale, the part of it is looked at that the next coarser scale found most in.

    Args:
        image: (H, W, 3) BGR.
        most_px: pixels that are looked at at one scale.

    Returns:
        None where the scales do not agree on vehicles: there are none, or they are too small or too large.
    """
    found = [np.empty((2, 0))]
    coarse: Detections | None = None
    for scale in scales(image, finest):
        share = min(most_px / (image.shape[0] * image.shape[1] * scale**2), 1.0)
        fine = _look_at_part(image, look, scale, share, coarse)
        if coarse is not None:
            found.append(confirmed(coarse, fine))
        coarse = fine
        yield
    length, weight = np.concatenate(found, axis=1)
    return common_length(length, weight, finest)


def finish(examination: Generator[None, None, ApparentLength | None]) -> ApparentLength | None:
    """Go through an examination at once."""
    while True:
        try:
            next(examination)
        except StopIteration as end:
            result: ApparentLength | None = end.value
            return result


def scales(image: Image, finest: float) -> list[float]:
    """Scales to look at an image (H, W, 3), the coarsest first."""
    octaves = int(np.log2(max(max(image.shape[:2]) * finest / MIN_SIDE_PX, 1.0)))
    return [finest / STEP**k for k in range(octaves, -1, -1)]


def confirmed(coarse: Detections, fine: Detections) -> Floats:
    """Length px and weight, the squared score, of the vehicles that two scales agree on: (2, k)."""
    a, b = coarse.at_least(FLOOR), fine.at_least(FLOOR)
    if not len(a) or not len(b):
        return np.empty((2, 0))
    overlap = prob_iou(a.boxes, b.boxes)
    best = overlap.argmax(axis=1)
    rows = np.arange(len(a))
    i = np.flatnonzero((overlap.argmax(axis=0)[best] == rows) & (overlap[rows, best] >= AGREE))
    j = best[i]
    length_a, length_b = _length(a)[i], _length(b)[j]
    same = np.abs(np.log2(length_a / length_b)) <= SAME_OCTAVES
    # the geometric mean of either's length, √(L₁ L₂), and of its squared score, s₁ s₂
    return np.stack([np.sqrt(length_a * length_b), a.score[i] * b.score[j]])[:, same]


def _length(found: Detections) -> Floats:
    """(m,) px, that of a car of this width at most."""
    return np.asarray(np.minimum(np.maximum(found.w, found.h), CAR_ASPECT * np.minimum(found.w, found.h)))


def common_length(length: Floats, weight: Floats, finest: float) -> ApparentLength | None:
    """The length about which the evidence is densest.

    Args:
        length: (k,) px, above 0.
        weight: (k,) evidence.

    Returns:
        None for too little evidence.
    """
    if not len(length):
        return None
    octave = np.log2(np.maximum(length, 1.0))
    grid = np.arange(octave.min(), octave.max() + GRID_OCTAVES, GRID_OCTAVES)
    # evidence(g) = Σ wᵢ e^(−½ ((oᵢ − g) / σ)²)
    evidence = np.exp(-0.5 * ((octave - grid[:, None]) / SPREAD_OCTAVES) ** 2) @ weight
    best = int(evidence.argmax())
    if evidence[best] < MIN_EVIDENCE * max(MIN_LENGTH_PX / (2.0 ** grid[best] * finest), 1.0) ** 2:
        return None
    return ApparentLength(px=float(2.0 ** grid[best]), evidence=float(evidence[best]))


def _look_at_part(image: Image, look: Look, scale: float, share: float, coarse: Detections | None) -> Detections:
    """Look at this share of an image's area, where most was found before."""
    if share >= 1.0:
        return look(image, scale)
    height, width = image.shape[:2]
    part_h, part_w = (max(int(side * np.sqrt(share)), 1) for side in (height, width))
    left, top = _fullest((width, height), (part_w, part_h), coarse)
    part = Tile(
        left=left, top=top, right=left + part_w, bottom=top + part_h, kept=(left, top, left + part_w, top + part_h)
    )
    return detect_in_tiles(image, [part], lambda parts: [look(parts[0], scale)])


def _fullest(image: tuple[int, int], part: tuple[int, int], found: Detections | None) -> tuple[int, int]:
    """Left and top of the part of an image (width, height), px, that holds the greatest sum of squared scores.

    Parts begin at every half of their own sides; of equal ones the one in the middle is taken.
    """
    starts = [
        np.linspace(0, length - side, int(np.ceil(2 * (length - side) / side)) + 1)
        for length, side in zip(image, part, strict=True)
    ]
    lefts, tops = starts
    middle = np.abs(lefts[None] - lefts.mean()) / image[0] + np.abs(tops[:, None] - tops.mean()) / image[1]
    mass = -1e-9 * middle
    if found is not None:
        inside_x = (found.cx >= lefts[:, None]) & (found.cx < lefts[:, None] + part[0])
        inside_y = (found.cy >= tops[:, None]) & (found.cy < tops[:, None] + part[1])
        mass = mass + (inside_y * found.score**2) @ inside_x.T.astype(np.float64)
    row, column = np.unravel_index(int(mass.argmax()), mass.shape)
    return int(lefts[column]), int(tops[row])
