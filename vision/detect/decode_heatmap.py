"""From the bundled model's map to boxes: only the cells that are peaks are touched.

The map's channels are those of ``training.net``: score (0 but at peaks of the centre's), centre offset x, y in
cells from the cell's middle, log length and log width in cells, (sin, cos) of the heading, (sin, cos) of twice the
heading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detect.boxes import nms
from vision.detect.detections import Detections

CHANNELS = 9
"""Channels of the model's map: score, offset x y, log length and width, front and axis as sine and cosine."""
MAX_PEAKS = 600
"""Most detections of one canvas, the best ones."""
SURE_FRONT = 0.3
"""Shortest front vector from which the front is known; it is 2p − 1 for a front that is right with probability p."""


def decode(cells: NDArray[np.float32], stride: int, score: float, overlap: float = 0.4) -> Detections:
    """Boxes in pixels of the model's input.

    Args:
        cells: (9, rows, columns), the model's map.
        score: smallest score that counts, 0 to 1.
        overlap: of two boxes that overlap more (probabilistic IoU), the one of lower score is dropped.

    Returns:
        Detections in continuous pixel coordinates, best first; heading NaN where the front is uncertain.
    """
    rows, columns = np.nonzero(cells[0] >= score)
    best = np.argsort(-cells[0, rows, columns], kind="stable")[:MAX_PEAKS]
    rows, columns = rows[best], columns[best]
    peak, dx, dy, log_length, log_width, sin_h, cos_h, sin_2h, cos_2h = cells[:, rows, columns].astype(np.float64)
    # centre = (cell + ½ + offset) · stride;  side = exp(log side) · stride
    cx, cy = (columns + 0.5 + dx) * stride, (rows + 0.5 + dy) * stride
    length, width = (np.exp(np.clip(side, -4.0, 6.0)) * stride for side in (log_length, log_width))
    heading, sure = _heading(sin_h, cos_h, sin_2h, cos_2h)
    # the width axis of the box is the vehicle's length: angle = heading − π/2, in [−π, π)
    angle = np.mod(heading + 0.5 * np.pi, 2.0 * np.pi) - np.pi
    found = Detections(
        cx=cx, cy=cy, w=length, h=width, angle=angle, score=peak, heading=np.where(sure, heading, np.nan)
    )
    return found.select(nms(found.boxes, found.score, overlap)) if len(found) else found


def _heading(
    sin_h: NDArray[np.float64], cos_h: NDArray[np.float64], sin_2h: NDArray[np.float64], cos_2h: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(p,) heading in [0, 2π) and whether its direction along the axis is sure."""
    axis = 0.5 * np.arctan2(sin_2h, cos_2h)
    # of the axis's two directions, the one that the front vector points to
    along = np.sin(axis) * sin_h + np.cos(axis) * cos_h
    heading = np.mod(axis + np.where(along < 0.0, np.pi, 0.0), 2.0 * np.pi)
    return heading, np.hypot(sin_h, cos_h) >= SURE_FRONT
