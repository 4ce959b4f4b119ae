"""The 256 colours that terminals without true colour have: a cube of 6×6×6 and 24 greys. Pure."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["FIRST", "PALETTE", "dithered", "nearest"]

FIRST: Final = 16
"""Number of the cube's first colour; the sixteen before look different on every terminal."""
CUBE: Final = np.array([0, 95, 135, 175, 215, 255], dtype=np.int64)
GREYS: Final = np.arange(8, 239, 10, dtype=np.int64)
ALL_GREYS: Final = np.concatenate([[0], GREYS, [255]])
GREY_CHROMA: Final = 16
"""What differs less between its channels, of 255, is dithered in greys, which are closer to each other."""
_BAYER: Final = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
THRESHOLDS: Final = (_BAYER + 0.5) / 16
"""Of an ordered dither."""


def _palette() -> NDArray[np.int64]:
    cube = np.stack(np.meshgrid(CUBE, CUBE, CUBE, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([cube, np.repeat(GREYS[:, None], 3, axis=1)])


PALETTE: Final = _palette()
"""(240, 3) RGB of colours 16 to 255."""


def _steps(levels: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """For each value 0..255 the level at or below it, as an index, and how far it is towards the next, 0..1."""
    values = np.arange(256)
    below = np.minimum(np.searchsorted(levels, values, side="right") - 1, len(levels) - 2)
    return below, (values - levels[below]) / (levels[below + 1] - levels[below])


_CUBE_BELOW, _CUBE_SHARE = _steps(CUBE)
_GREY_BELOW, _GREY_SHARE = _steps(ALL_GREYS)


def dithered(bgr: NDArray[np.uint8]) -> NDArray[np.int64]:
    """An image in colours of the palette that are right on the average (ordered dither after Bayer).

    Args:
        bgr: (h, w, 3).

    Returns:
        (h, w) 0xRRGGBB.
    """
    height, width = bgr.shape[:2]
    threshold = np.tile(THRESHOLDS, (height // 4 + 1, width // 4 + 1))[:height, :width]
    colour = CUBE[_CUBE_BELOW[bgr] + (_CUBE_SHARE[bgr] > threshold[..., None])]
    luma = bgr.astype(np.int64) @ np.array([29, 150, 77]) >> 8
    grey = ALL_GREYS[_GREY_BELOW[luma] + (_GREY_SHARE[luma] > threshold)]
    plain = np.ptp(bgr, axis=-1) < GREY_CHROMA
    blue, green, red = (np.where(plain, grey, colour[..., channel]) for channel in range(3))
    return np.asarray(red << 16 | green << 8 | blue, dtype=np.int64)


@lru_cache(maxsize=4096)
def nearest(packed: int) -> int:
    """Number, 16 to 255, of the colour that is nearest to 0xRRGGBB."""
    away = PALETTE - (packed >> 16, packed >> 8 & 255, packed & 255)
    return FIRST + int(np.argmin((away * away).sum(axis=1)))
