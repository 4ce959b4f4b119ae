"""Crops of oriented boxes, rectified: every box becomes an upright square image with its width axis to the right."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]
MAX_FINER = 8
"""A crop is averaged from at most this many samples per pixel and axis; a box larger still loses detail to aliasing."""


def rectify(image: Image, boxes: ArrayLike, side: int, margin: float = 0.0) -> Image:
    """Cut boxes out of an image and stretch each onto a square.

    A box that is larger than the crop is sampled finer and averaged, so that nothing is skipped. Outside the image
    its edge is repeated.

    Args:
        image: (H, W, 3) uint8.
        boxes: (n, 5) cx, cy, w, h, angle in continuous pixels and radians; sides below a pixel count as one.
        side: of a crop, px.
        margin: how much more than the box is seen, as a share of its sides; 0.15 adds 7.5 % at every side.

    Returns:
        (n, side, side, 3) uint8: x along the box's width axis, y across, clockwise from it.
    """
    rows = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
    crops = np.empty((len(rows), side, side, 3), np.uint8)
    for crop, row in zip(crops, rows, strict=True):
        crop[...] = _rectified(image, row, side, margin)
    return crops


def _rectified(image: Image, row: NDArray[np.float64], side: int, margin: float) -> Image:
    seen = np.maximum(row[2:4], 1.0) * (1.0 + margin)
    finer = np.clip(np.ceil(seen / side), 1, MAX_FINER).astype(int)
    size = side * finer
    # image = c + R(angle) · diag(seen / size) · (crop − size / 2)
    c, s = np.cos(row[4]), np.sin(row[4])
    linear = np.array([[c, -s], [s, c]]) * (seen / size)
    # OpenCV counts from the middle of the first pixel: both sides move by a half
    shift = row[:2] - 0.5 - linear @ (0.5 * size - 0.5)
    crop = cv2.warpAffine(
        image,
        np.column_stack([linear, shift]),
        (int(size[0]), int(size[1])),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if (finer > 1).any():
        crop = cv2.resize(crop, (side, side), interpolation=cv2.INTER_AREA)
    return np.asarray(crop, dtype=np.uint8)
