"""Labelled photographs as a source of training samples: parts at the scale at which the detector sees vehicles.

What is cut is chosen around labelled vehicles, rare classes more often than their share, around false alarms of the
network that training begins with (hard negatives), and anywhere. Nothing is learnt from areas that may hold vehicles
without a label: objects that do not count, the edge of the photograph, and detections without a label that are longer
than cars (lorries and buses are the first that labellers leave out) or very much like cars. Needs no torch.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from training.cuts import Known, TrainingSample
from vision.detect.boxes import corners
from vision.detect.detector import Detector
from vision.errors import LabelError
from vision.evaluation import LabelledImage, Truth
from vision.evaluation.matching import overlap

log = logging.getLogger(__name__)
Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

CAR_LENGTH_M, CAR_PX = 4.5, 52.0
"""Length of a car, and how long the detector sees it where the ground resolution is known: 2.5 m at 29 px."""
ASPECT = 2.2
"""Length over width of a car: 4.5 m by 1.8 to 2.1 m."""
PART_SIDE = 384
"""Side of a part, px, as of rendered crops."""
SCALES = (0.35, 1.3)
"""Range of a part's scale, of that at which a car has CAR_PX: cars of 18 to 68 px, which the cut varies further."""
MAX_SCALE = 2.0
"""Enlarging further adds no detail; the detector does not either."""
OPEN = 16
"""Photographs from which the samples of a step are cut: 400 MB of 4K frames. One is exchanged with each step."""
HARD_SHARE, VEHICLE_SHARE = 0.25, 0.6
"""Shares of parts around a false alarm and around a vehicle; the others lie anywhere. A choice."""
OFF_MIDDLE = 0.3
"""Share of a part's side: how far from its middle what it was chosen for may lie."""
MINING_SCORE = 0.15
"""Least score of a false alarm that is mined: half the operating score, for it may rise while training."""
EXPLAINED_IOU, EXPLAINED_INSIDE = 0.1, 0.5
"""A detection with this much overlap with a label, or with this share of it inside one, is no false alarm."""
LONG = 1.5
"""A box without label of this many car lengths may be an unlabelled lorry or bus ..."""
CAR_LIKE, SURE = 0.7, 0.4
"""... and one of this many car lengths and of this score a car that was overlooked. On street scenes, boxes of such a
score without label are half of them cars; smaller ones are pedestrians and roof windows."""
EDGE_CARS = 1.0
"""Depth of the edge of a photograph, car lengths: vehicles that are cut there have a label or not."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photograph:
    """A labelled photograph in the terms of training."""

    name: str
    read: Callable[[], Image]
    """(H, W, 3) BGR."""
    boxes: NDArray[np.float32]
    """(n, 6) of the objects that count, as in ``training.cuts``."""
    known: NDArray[np.int64]
    """(n,) of ``Known``."""
    draw: Floats
    """(n,) probability with which a part is cut around each object."""
    unjudged: NDArray[np.float32]
    """(k, 4, 2) corners of areas that may hold vehicles without a label."""
    hard: Floats
    """(m, 2) centres of false alarms."""
    car_px: float
    """Length of a car."""


def label_rows(truth: Truth) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Labels as rows of training, and how much of each is known.

    Of an upright box, the longer side stands for the length; the width is estimated from sides W and H of a box around
    a car of length a w at any angle, which is between w and 1.4 w: min(W, H, (W + H) / (1 + a)).

    Returns:
        (n, 6) boxes and (n,) ``Known``.
    """
    cx, cy, w, h, angle = truth.boxes.T
    # the width axis of a box stands at its angle from x: heading = angle + π/2; the other axis points up at angle 0
    fronted = np.isfinite(truth.heading)
    along_w = np.abs(np.cos(truth.heading - angle - 0.5 * np.pi)) > math.sqrt(0.5)
    along_w = np.where(fronted, along_w, w >= h)
    length, width = np.where(along_w, w, h), np.where(along_w, h, w)
    if truth.upright:
        width = np.minimum(width, (w + h) / (1.0 + ASPECT))
    heading = np.where(fronted, truth.heading, angle + np.where(along_w, 0.5 * np.pi, 0.0))
    known = np.where(fronted, Known.FRONT, Known.CENTRE if truth.upright else Known.BOX)
    rows = np.column_stack([cx, cy, length, width, heading, np.ones(len(truth))])
    return rows.astype(np.float32), known.astype(np.int64)


def _photograph(image: LabelledImage, classes: Counter[str], fallback_px: float) -> Photograph:
    counted = image.truth.select(image.truth.counts)
    aside = image.truth.select(~image.truth.counts)
    boxes, known = label_rows(counted)
    if image.as_seen:
        car_px = CAR_PX
    elif math.isfinite(image.gsd_m):
        car_px = CAR_LENGTH_M / image.gsd_m
    else:
        car_px = float(np.median(boxes[:, 2])) if len(boxes) else fallback_px
    # as often as the square root of a class's number: the rare ones more than their share, but not as often as all
    weight = np.array([classes[str(name)] ** -0.5 for name in counted.name])
    return Photograph(
        name=image.name,
        read=image.read,
        boxes=boxes,
        known=known,
        draw=weight / weight.sum() if len(weight) else weight,
        unjudged=corners(aside.boxes).astype(np.float32).reshape(-1, 4, 2),
        hard=np.empty((0, 2)),
        car_px=car_px,
    )


def mine(photograph: Photograph, truth: Truth, detector: Detector, image: Image) -> Photograph:
    """The photograph with the false alarms of a detector, and with what may be unlabelled vehicles set aside.

    Args:
        photograph: without any yet.
        truth: its labels.
        detector: any, opened with a score of MINING_SCORE or less.
    """
    found = detector.detect(image, gsd_m=CAR_LENGTH_M / photograph.car_px)
    iou, inside = overlap(found, truth)
    explained = ((iou >= EXPLAINED_IOU) | (inside >= EXPLAINED_INSIDE)).any(axis=1)
    found = found.select(~explained & (found.score >= MINING_SCORE))
    cars = np.maximum(found.w, found.h) / photograph.car_px
    overlooked = (cars > LONG) | ((cars > CAR_LIKE) & (found.score > SURE))
    aside = corners(found.boxes[overlooked]).astype(np.float32).reshape(-1, 4, 2)
    unjudged = np.concatenate([photograph.unjudged, aside])
    return replace(photograph, hard=found.centre[~overlooked], unjudged=unjudged)


def open_photographs(
    images: Sequence[LabelledImage],
    detector: Detector,
    seed: int,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Photographs:
    """Read every image once and mine it; one that cannot be read is logged and left out.

    Args:
        detector: what training begins with, opened with a score of MINING_SCORE or less.
        seed: of the order in which they come.
        report: is told how many are done, and of how many.

    Raises:
        LabelError: none can be read.
    """
    classes = Counter(str(name) for image in images for name in image.truth.name[image.truth.counts])
    typical = [float(np.median(label_rows(image.truth)[0][:, 2])) for image in images if image.truth.counts.any()]
    # of unknown ground resolution and without a vehicle anywhere: seen at half size, as the detector does
    fallback_px = float(np.median(typical)) if typical else 2.0 * CAR_PX
    made = []
    for i, image in enumerate(images):
        photograph = _photograph(image, classes, fallback_px)
        try:
            made.append(mine(photograph, image.truth, detector, image.read()))
        except LabelError as error:
            log.warning("left out: %s", error)
        report(i + 1, len(images))
    if not made:
        raise LabelError(f"none of {len(images)} labelled images can be read; training needs one at least")
    log.info(
        "%d photographs, %d vehicles, %d false alarms to learn from",
        len(made),
        sum(len(p.boxes) for p in made),
        sum(len(p.hard) for p in made),
    )
    return Photographs(made, seed)


class Photographs:
    """A source of samples; what step k is given depends on the seed and k alone, so a stopped run can be continued.

    Args:
        photographs: at least one.
        seed: of the order of the photographs.
    """

    def __init__(self, photographs: Sequence[Photograph], seed: int) -> None:
        self.photographs = tuple(photographs)
        self._seed = seed
        self._pixels = lru_cache(maxsize=OPEN)(lambda i: self.photographs[i].read())

    def samples(self, step: int, count: int, rng: np.random.Generator) -> list[TrainingSample]:
        """Square parts of PART_SIDE for one training step.

        Args:
            step: its number.
        """
        at_hand = [self._order(step + k) for k in range(min(OPEN, len(self.photographs)))]
        chosen = [at_hand[int(k)] for k in rng.integers(len(at_hand), size=count)]
        return [part(self.photographs[i], self._pixels(i), rng) for i in chosen]

    def _order(self, number: int) -> int:
        """Index of the photograph that comes as this many-th: every one once, then again in another order."""
        turn, place = divmod(number, len(self.photographs))
        return int(np.random.default_rng([self._seed, turn]).permutation(len(self.photographs))[place])


def part(photograph: Photograph, image: Image, rng: np.random.Generator) -> TrainingSample:
    """A part of PART_SIDE squared at a random place and scale."""
    height, width = image.shape[:2]
    scale = CAR_PX / photograph.car_px * float(np.exp(rng.uniform(*np.log(SCALES))))
    scale = min(max(scale, PART_SIDE / max(height, width)), MAX_SCALE)
    span = PART_SIDE / scale
    middle = _focus(photograph, (width, height), rng) + rng.uniform(-OFF_MIDDLE, OFF_MIDDLE, 2) * span
    side = max(round(span), 1)
    # a part lies in the photograph where it fits
    room = np.array([width - side, height - side])
    left, top = (int(v) for v in np.floor(np.where(room > 0, np.clip(middle - 0.5 * span, 0, abs(room)), 0.5 * room)))
    pixels = _window(image, left, top, side)
    factor = PART_SIDE / side
    how = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
    small = cv2.resize(pixels, (PART_SIDE, PART_SIDE), interpolation=how)
    boxes = photograph.boxes.copy()
    boxes[:, :2] = (boxes[:, :2] - (left, top)) * factor
    boxes[:, 2:4] *= factor
    areas = np.concatenate([photograph.unjudged, _edge(width, height, EDGE_CARS * photograph.car_px)])
    unjudged = ((areas - (left, top)) * factor).astype(np.float32)
    return TrainingSample(image=np.asarray(small, np.uint8), boxes=boxes, known=photograph.known, unjudged=unjudged)


def _focus(photograph: Photograph, size: tuple[int, int], rng: np.random.Generator) -> Floats:
    kind = float(rng.random())
    if kind < HARD_SHARE and len(photograph.hard):
        return np.asarray(photograph.hard[rng.integers(len(photograph.hard))])
    if kind < HARD_SHARE + VEHICLE_SHARE and len(photograph.boxes):
        return photograph.boxes[rng.choice(len(photograph.boxes), p=photograph.draw), :2].astype(np.float64)
    return rng.uniform(0.0, 1.0, 2) * size


def _window(image: Image, left: int, top: int, side: int) -> Image:
    """(side, side, 3) from a corner on; black beyond the image."""
    height, width = image.shape[:2]
    out = np.zeros((side, side, 3), np.uint8)
    x0, x1, y0, y1 = max(left, 0), min(left + side, width), max(top, 0), min(top + side, height)
    if x0 < x1 and y0 < y1:
        out[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1]
    return out


def _edge(width: int, height: int, depth: float) -> NDArray[np.float32]:
    """(4, 4, 2) strips along the sides."""
    spans = (
        (0.0, 0.0, width, depth),
        (0.0, height - depth, width, height),
        (0.0, 0.0, depth, height),
        (width - depth, 0.0, width, height),
    )
    return np.array([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)] for x0, y0, x1, y1 in spans], np.float32)
