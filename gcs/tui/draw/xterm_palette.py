"""The 256 colours that terminals without true colour have, a cube and greys, and the sixteen that all have. Pure."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

FIRST: Final = 16
"""Number of the cube's first colour; the sixteen before look different on every terminal."""
CUBE: Final = np.array([0, 95, 135, 175, 215, 255], dtype=np.int64)
GREYS: Final = np.arange(8, 239, 10, dtype=np.int64)
GREY_CHROMA: Final = 40
"""Least difference of channels, of 255, that is not dithered in greys: the cube's dark colours are far apart, and of a
meadow every third point would be red."""
_BAYER: Final = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
THRESHOLDS: Final = (_BAYER + 0.5) / 16
"""Thresholds of an ordered dither, 0..1."""
HUE: Final = 3.0
"""Weight of a difference of hue beside one of brightness: a meadow is dark or light green, and not red."""
NOISE: Final = 30.0
"""Change of a colour to brighter and darker, of 255: the cube's steps are 40, but for the darkest; more is noise."""
SIXTEEN: Final = np.array(
    [
        *((0, 0, 0), (205, 0, 0), (0, 205, 0), (205, 205, 0), (0, 0, 238), (205, 0, 205), (0, 205, 205)),
        *((229, 229, 229), (127, 127, 127), (255, 0, 0), (0, 255, 0), (255, 255, 0), (92, 92, 255), (255, 0, 255)),
        *((0, 255, 255), (255, 255, 255)),
    ],
    dtype=np.int64,
)
"""(16, 3) RGB of the sixteen as xterm has them; a user may have chosen others, and their order of brightness holds."""
GREYS_OF_SIXTEEN: Final = np.array([0x000000, 0x7F7F7F, 0xE5E5E5, 0xFFFFFF], dtype=np.int64)
"""Colours of the sixteen without a hue, the darkest first."""
CUT: Final = (2.0, 98.0)
"""Percentiles of the brightness that become black and white: of four greys a flat picture would show one."""
LUMA_BGR: Final = np.array([0.114, 0.587, 0.299], dtype=np.float32)
"""ITU-R BT.601."""

SOFT: Final = 0.4
"""Share of the way from one grey to the next in which both are mixed; over all of it a meadow is a chessboard."""
FLAT: Final = 80.0
"""Spread of brightness, of 255, below which a picture is spread less: its noise would be all that is seen."""


def _palette() -> NDArray[np.int64]:
    cube = np.stack(np.meshgrid(CUBE, CUBE, CUBE, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([cube, np.repeat(GREYS[:, None], 3, axis=1)])


PALETTE: Final = _palette()
"""(240, 3) RGB of colours 16 to 255."""


@cache
def _nearest_by_bits() -> NDArray[np.int64]:
    """(32, 32, 32) 0xRRGGBB of the palette that is nearest to each colour of 5 bits a channel, blue first."""
    middle = np.arange(32, dtype=np.float32) * 8 + 4
    every = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1).reshape(-1, 3)
    wanted, known = _luma_chroma(every), _luma_chroma(PALETTE[:, ::-1].astype(np.float32))
    # |a − b|² = |a|² − 2 a·b + |b|², of which |a|² is the same for all
    away = (known * known).sum(axis=1) - 2 * wanted @ known.T
    red, green, blue = PALETTE[away.argmin(axis=1)].T
    return np.asarray(red << 16 | green << 8 | blue, dtype=np.int64).reshape(32, 32, 32)


def _luma_chroma(bgr: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, 3) BGR as brightness and two differences of colour (ITU-R BT.601)."""
    luma = bgr @ LUMA_BGR
    return np.stack([luma, HUE * 0.564 * (bgr[:, 0] - luma), HUE * 0.713 * (bgr[:, 2] - luma)], axis=-1)


def dithered(bgr: NDArray[np.uint8]) -> NDArray[np.int64]:
    """An image in colours of the palette that are near it on the average (ordered dither after Bayer).

    Args:
        bgr: (h, w, 3).

    Returns:
        (h, w) 0xRRGGBB.
    """
    threshold = _thresholds(bgr.shape)
    # one pattern for all channels: it makes a point brighter or darker, and not redder or greener
    noise = NOISE * (threshold - 0.5)[..., None]
    bits = np.clip(bgr + noise, 0, 255).astype(np.uint8) >> 3
    colour = _nearest_by_bits()[bits[..., 0], bits[..., 1], bits[..., 2]]
    # v = 10 k + 8 for the k-th grey
    level = np.clip(np.floor((bgr @ LUMA_BGR - 8) / 10 + threshold), 0, len(GREYS) - 1).astype(np.int64)
    grey = GREYS[level] * 0x010101
    return np.asarray(np.where(np.ptp(bgr, axis=-1) < GREY_CHROMA, grey, colour), dtype=np.int64)


def _thresholds(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """(h, w) of an ordered dither, for an image of that shape."""
    height, width = shape[:2]
    return np.tile(THRESHOLDS, (height // 4 + 1, width // 4 + 1))[:height, :width]


def in_four_greys(bgr: NDArray[np.uint8]) -> NDArray[np.int64]:
    """An image in the greys that every terminal of sixteen colours has, with its contrast spread over them (dithered).

    Args:
        bgr: (h, w, 3).

    Returns:
        (h, w) 0xRRGGBB.
    """
    luma = bgr @ LUMA_BGR
    least, most = np.percentile(luma, CUT) if luma.size else (0.0, 1.0)
    share = np.clip((luma - least) / max(float(most - least), FLAT), 0.0, 1.0)
    levels = (GREYS_OF_SIXTEEN & 255) / 255
    lower = np.clip(np.searchsorted(levels, share, side="right") - 1, 0, len(levels) - 2)
    between = (share - levels[lower]) / (levels[lower + 1] - levels[lower])
    above = between > 0.5 + SOFT * (_thresholds(bgr.shape) - 0.5)
    return np.asarray(GREYS_OF_SIXTEEN[lower + above], dtype=np.int64)


@lru_cache(maxsize=4096)
def nearest_of_sixteen(packed: int) -> int:
    """Number, 0 to 15, of the colour that is nearest to 0xRRGGBB."""
    away = SIXTEEN - (packed >> 16, packed >> 8 & 255, packed & 255)
    return int(np.argmin((away * away).sum(axis=1)))


@lru_cache(maxsize=4096)
def nearest(packed: int) -> int:
    """Number, 16 to 255, of the colour that is nearest to 0xRRGGBB."""
    away = PALETTE - (packed >> 16, packed >> 8 & 255, packed & 255)
    return FIRST + int(np.argmin((away * away).sum(axis=1)))
