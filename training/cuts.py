"""Labelled samples, and how training cuts them: turned, scaled, mirrored, in worse quality. Needs no torch.

Boxes are rows (cx, cy, length, width px, heading clockwise from image up, visible share).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE = 256
"""Side of the images that training sees, cut from larger ones."""
SCALES = (0.68, 1.6)
"""Range of the scale of a cut; at the least one it shows nearly all of a crop of 384 px."""
MIN_LENGTH_PX, MIN_WIDTH_PX = 8.0, 3.0
"""Smaller vehicles count neither way."""
FROM_THE_SIDE, ROLL = math.radians(40.0), math.radians(20.0)
"""Tilt from straight down from which on cuts are turned by the roll of a camera alone, and its standard deviation; a
choice."""


class Known(IntEnum):
    """Detail of a label; each level includes those before it."""

    CENTRE = 0
    """An upright box: sides and heading of its row are rough estimates that nothing may be learnt from."""
    BOX = 1
    """An oriented box; its heading may be turned about."""
    FRONT = 2
    """Also the front."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingSample:
    """An image with its n labels."""

    image: NDArray[np.uint8]
    """(H, W, 3) BGR."""
    boxes: NDArray[np.float32]
    """(n, 6), see the module."""
    known: NDArray[np.int64]
    """(n,) of ``Known``."""
    unjudged: NDArray[np.float32]
    """(k, 4, 2) corners, px, of areas that may hold vehicles without a label: nothing there is a mistake."""
    upright: bool = False
    """Seen from the side: a camera may roll, but the sky stays above."""


def rendered_sample(image: NDArray[np.uint8], boxes: NDArray[np.float32], tilt: float = 0.0) -> TrainingSample:
    """A rendered crop, taken so far from straight down: everything on it is known."""
    return TrainingSample(
        image=image,
        boxes=boxes,
        known=np.full(len(boxes), int(Known.FRONT)),
        unjudged=np.empty((0, 4, 2), np.float32),
        upright=tilt > FROM_THE_SIDE,
    )


def cut(sample: TrainingSample, rng: np.random.Generator) -> TrainingSample:
    """A (SIDE, SIDE) part of a square sample, turned as it may be, scaled, and mirrored half of the time."""
    scale = float(np.exp(rng.uniform(*np.log(SCALES))))
    turn = float(rng.normal(0.0, ROLL) if sample.upright else rng.uniform(0.0, 2.0 * np.pi))
    mirror = bool(rng.random() < 0.5)
    side = sample.image.shape[0]
    room = max(0.5 * side - 0.5 * SIDE / scale, 0.0)
    focus = 0.5 * side + rng.uniform(-1.0, 1.0, 2) * room
    # p' = s R (p − focus) + ½ SIDE, R clockwise on the screen; mirrored: x → −x first
    c, s = np.cos(turn), np.sin(turn)
    A = scale * np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    b = 0.5 * SIDE - A @ focus
    # whole pixel coordinates are the middles of pixels for OpenCV: u = x − ½
    M = np.column_stack([A, b + A @ (0.5, 0.5) - 0.5])
    border = tuple(int(v) for v in rng.integers(0, 256, 3))
    flags = cv2.INTER_CUBIC if scale > 1.15 else cv2.INTER_LINEAR
    out = cv2.warpAffine(sample.image, M, (SIDE, SIDE), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=border)
    moved = sample.boxes.copy()
    moved[:, :2] = moved[:, :2] @ A.T + b
    moved[:, 2:4] *= scale
    moved[:, 4] = turn + (-moved[:, 4] if mirror else moved[:, 4])
    moved[:, 5] *= _share_inside(moved)
    moved[(moved[:, 2] < MIN_LENGTH_PX) | (moved[:, 3] < MIN_WIDTH_PX), 5] = 0.0
    middle_inside = ((moved[:, :2] > 0.0) & (moved[:, :2] < SIDE)).all(axis=1)
    # of a vehicle whose middle is beyond the edge, what is seen of it counts neither way
    moved[~middle_inside, 5] = 0.0
    reach = 0.5 * moved[:, 2:3]
    inside = ((moved[:, :2] > -reach) & (moved[:, :2] < SIDE + reach)).all(axis=1)
    unjudged = (sample.unjudged @ A.T + b).astype(np.float32)
    return TrainingSample(
        image=np.asarray(out, np.uint8), boxes=moved[inside], known=sample.known[inside], unjudged=unjudged
    )


def _share_inside(boxes: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) share of each box within the image."""
    a, c = np.meshgrid(np.linspace(-0.45, 0.45, 7), np.linspace(-0.4, 0.4, 3))
    cx, cy, length, width, heading = boxes[:, :5].T[..., None, None]
    u = cx + a * length * np.sin(heading) + c * width * np.cos(heading)
    v = cy - a * length * np.cos(heading) + c * width * np.sin(heading)
    return np.asarray(((u > 0.0) & (v > 0.0) & (u < SIDE) & (v < SIDE)).mean(axis=(1, 2)), np.float32)


def worsen(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Now and then noise, blur, sharpening or compression, as scaling has softened what the pool had of them."""
    kind = rng.random()
    if kind < 0.15:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 1.1))), np.uint8)
    elif kind < 0.4:
        blurred = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.6, 1.5)))
        amount = float(rng.uniform(0.3, 1.5))
        image = np.asarray(cv2.addWeighted(image, 1.0 + amount, blurred, -amount, 0.0), np.uint8)
    if rng.random() < 0.2:
        noise = rng.normal(0.0, float(rng.uniform(1.0, 9.0)), (SIDE, SIDE, 1)).astype(np.float32)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.2:
        packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 95))])[1]
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
    return image
