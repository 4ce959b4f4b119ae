"""A camera image as half-block pixels: fitted, shrunk, and reduced to few colours so that styles can be reused."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["fit", "shrink"]

LUMA_STEP = 6
CHROMA_STEP = 12


def fit(width: int, height: int, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Where an image goes in a field of cells that are twice as high as wide.

    Args:
        width: Of the image, px, above 0.
        height: Of the image, px, above 0.
        columns: Of the field, cells.
        rows: Of the field, cells.

    Returns:
        Left, top, columns, rows of the largest centred image that keeps its shape; at least one cell.
    """
    scale = min(columns / width, 2 * rows / height)
    used_columns = min(columns, max(1, round(width * scale)))
    used_rows = min(rows, max(1, round(height * scale / 2)))
    return (columns - used_columns) // 2, (rows - used_rows) // 2, used_columns, used_rows


def shrink(image: NDArray[np.uint8], columns: int, rows: int) -> NDArray[np.int64]:
    """Image to packed pixels.

    Args:
        image: (H, W, 3) uint8 BGR.
        columns: Width of the result, above 0.
        rows: Height in cells, above 0.

    Returns:
        (2 · rows, columns) int64 of 0xRRGGBB, in steps of brightness and wider steps of hue.
    """
    small = np.asarray(cv2.resize(image, (columns, 2 * rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    ycc = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb), dtype=np.uint8)
    ycc[..., 0] = ycc[..., 0] // LUMA_STEP * LUMA_STEP + LUMA_STEP // 2
    hue = (ycc[..., 1:].astype(np.float64) - 128) / CHROMA_STEP
    ycc[..., 1:] = np.clip(np.rint(hue) * CHROMA_STEP + 128, 0, 255)
    bgr = np.asarray(cv2.cvtColor(ycc, cv2.COLOR_YCrCb2BGR)).astype(np.int64)
    return np.asarray(bgr[..., 2] << 16 | bgr[..., 1] << 8 | bgr[..., 0], dtype=np.int64)
