"""The shape of a box in the image: its corners, its front, the upright rectangle round it. Pure.

Image pixels, x right, y down; angles clockwise on screen in radians.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Box

Rect = tuple[float, float, float, float]
"""Rectangle: left, top, width, height."""

FARTHEST_PX: Final = 30_000.0
"""OpenCV counts in 16 bits before the point when it smooths lines."""


def drawable(box: Box) -> bool:
    """Tell whether a box has a place and a size that can be drawn."""
    numbers = (box.cx, box.cy, box.w, box.h, box.angle)
    return box.w > 0 and box.h > 0 and all(abs(number) < FARTHEST_PX for number in numbers)


def box_corners(box: Box) -> NDArray[np.float64]:
    """(4, 2) pixel corners of an oriented box, clockwise from its own top left."""
    c, s = math.cos(box.angle), math.sin(box.angle)
    # p = c + R(angle) · (±w/2, ±h/2)
    half = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * (box.w, box.h)
    return np.asarray(half @ np.array([(c, s), (-s, c)]) + (box.cx, box.cy), dtype=np.float64)


def front_mark(box: Box, reach: float = 0.45) -> NDArray[np.float64]:
    """(2, 2) pixel ends of the tick ahead of the front edge, NaN when the front is unknown.

    Args:
        box: Its heading is clockwise from image up.
        reach: Length of the tick in lengths of the box.
    """
    if not math.isfinite(box.heading):
        return np.full((2, 2), math.nan)
    # d = (sin heading, −cos heading): clockwise from image up, y down
    right, down = math.sin(box.heading), -math.cos(box.heading)
    along = abs(math.cos(box.angle) * right + math.sin(box.angle) * down)
    length = box.w * along + box.h * (1.0 - along)
    ends = (length / 2, length / 2 + length * reach)
    return np.array([(box.cx + right * far, box.cy + down * far) for far in ends])


def box_bounds(box: Box, scale: float = 1.0, margin: float = 0.0) -> Rect:
    """Upright rectangle round a scaled box and its front tick."""
    c, s = abs(math.cos(box.angle)), abs(math.sin(box.angle))
    across, down = (box.w * c + box.h * s) / 2, (box.w * s + box.h * c) / 2
    x, y = [box.cx - across, box.cx + across], [box.cy - down, box.cy + down]
    if math.isfinite(box.heading):
        for tick_x, tick_y in front_mark(box).tolist():
            x.append(tick_x)
            y.append(tick_y)
    left, top = scale * min(x) - margin, scale * min(y) - margin
    return left, top, scale * max(x) + margin - left, scale * max(y) + margin - top
