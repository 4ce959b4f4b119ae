"""A camera image as block letters of two colours: fitted, shrunk, and in few colours so that styles can be reused.

A cell holds two pixels above each other as a half block, 2×3 as a sextant (U+1FB00), 2×4 as an octant (U+1CD00).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.tui.draw.xterm_palette import LUMA_BGR, dithered, in_four_greys
from gcs.tui.themes import Depth

Grain = Literal["halves", "sextants", "octants"]
"""Division of a cell into parts."""
HALF: Final = ord("▀")
FINER: Final = 2
"""Factor of the size at which the image is sharpened, on the size that is shown."""
SAMPLES: Final = 2
"""Samples across and down each point of that, each the mean of 2×2 points of the image."""
SHARPER: Final = 0.7
"""Share of what a blur takes away that is added once more; raised, edges get halos."""
LUMA_STEP: Final = 8
CHROMA_STEP: Final = 12
PLAIN_LEVELS: Final = 9
"""Difference of brightness, of 255, below which a cell is of one colour: its pattern would be noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureMode:
    """Mode of pictures that the terminal can show."""

    grain: Grain = "halves"
    """Division of each cell."""
    depth: Depth = "truecolor"
    """Images are dithered to 256 colours, and to the greys of the sixteen."""


HALF_BLOCKS: Final = PictureMode()


@dataclass(frozen=True, slots=True)
class Mosaic:
    """Cells of an image, each (rows, columns)."""

    letter: NDArray[np.int64]
    """Code points."""
    ink: NDArray[np.int64]
    """0xRRGGBB of what the letter fills."""
    paper: NDArray[np.int64]
    """0xRRGGBB of the rest."""


def fit(width: int, height: int, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Place of an image in a field of cells that are twice as high as wide.

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


def mosaic_of(image: NDArray[np.uint8], columns: int, rows: int, mode: PictureMode = HALF_BLOCKS) -> Mosaic:
    """An image in cells.

    Args:
        image: (H, W, 3) uint8 BGR.
        columns: Width of the result, above 0.
        rows: Height of the result, above 0.
        mode: What the terminal can show; true colour is in steps of brightness and wider ones of hue.
    """
    grain, depth = mode.grain, mode.depth
    if grain == "halves":
        pixels = _reduced(_shrunk(image, columns, 2 * rows), depth=depth)
        letter = np.full((rows, columns), HALF, dtype=np.int64)
        return Mosaic(letter, pixels[0::2], pixels[1::2])
    high = 3 if grain == "sextants" else 4
    small = _shrunk(image, 2 * columns, high * rows)
    # (rows, columns, parts, 3), the parts of a cell row by row
    parts = small.reshape(rows, high, columns, 2, 3).transpose(0, 2, 1, 3, 4).reshape(rows, columns, 2 * high, 3)
    bright, ink, paper = _split(parts)
    letters = SEXTANTS if grain == "sextants" else OCTANTS
    pattern = bright @ (1 << np.arange(2 * high))
    return Mosaic(letters[pattern], _reduced(ink, depth=depth), _reduced(paper, depth=depth))


def _split(parts: NDArray[np.uint8]) -> tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]:
    """Divide each cell into bright and dark parts.

    Args:
        parts: (rows, columns, n, 3) BGR.

    Returns:
        (rows, columns, n) which are bright, and the mean colours (rows, columns, 3) of these and of the others.
    """
    wide = parts.astype(np.float32)
    luma = wide @ LUMA_BGR
    least, most = luma.min(axis=-1), luma.max(axis=-1)
    # the threshold halfway: a small bright thing stays one
    bright = 2 * luma > (least + most)[..., None]
    bright &= (most - least >= PLAIN_LEVELS)[..., None]
    count = bright.sum(axis=-1)[..., None]
    total = wide.sum(axis=2)
    inked = (wide * bright[..., None]).sum(axis=2)
    n = parts.shape[2]
    paper = (total - inked) / np.maximum(n - count, 1)
    ink = np.where(count > 0, inked / np.maximum(count, 1), paper)
    return bright, ink.astype(np.uint8), paper.astype(np.uint8)


def _shrunk(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """An image in another size; sharpened before it gets small, so that vehicles and the road's lines stand out."""
    if FINER * width > image.shape[1]:
        way = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (width, height), interpolation=way), dtype=np.uint8)
    # the mean of all points of a large frame would cost more than all else that is drawn
    some = cv2.resize(image, (SAMPLES * FINER * width, SAMPLES * FINER * height), interpolation=cv2.INTER_LINEAR)
    finer = cv2.resize(some, (FINER * width, FINER * height), interpolation=cv2.INTER_AREA)
    # s = f + k (f − blurred f): an unsharp mask
    sharp = cv2.addWeighted(finer, 1 + SHARPER, cv2.GaussianBlur(finer, (0, 0), FINER), -SHARPER, 0.0)
    return np.asarray(cv2.resize(sharp, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _reduced(bgr: NDArray[np.uint8], *, depth: Depth) -> NDArray[np.int64]:
    """(h, w, 3) BGR to (h, w) 0xRRGGBB of fewer colours."""
    if depth != "truecolor":
        return dithered(bgr) if depth == "256" else in_four_greys(bgr)
    ycc = cv2.LUT(cv2.cvtColor(bgr, cv2.COLOR_BGR2YCrCb), FEWER)
    wide = np.asarray(cv2.cvtColor(ycc, cv2.COLOR_YCrCb2BGR)).astype(np.int64)
    return np.asarray(wide[..., 2] << 16 | wide[..., 1] << 8 | wide[..., 0], dtype=np.int64)


def _fewer() -> NDArray[np.uint8]:
    """(1, 256, 3) of each value of brightness and of both differences of colour the nearest that is used."""
    every = np.arange(256)
    luma = every // LUMA_STEP * LUMA_STEP + LUMA_STEP // 2
    chroma = np.clip(np.rint((every - 128) / CHROMA_STEP) * CHROMA_STEP + 128, 0, 255)
    return np.stack([luma, chroma, chroma], axis=-1)[None].astype(np.uint8)


FEWER: Final = _fewer()


def _letters(parts: int, first: int, elsewhere: dict[int, int]) -> NDArray[np.int64]:
    """(2^parts,) code point of each pattern; bit k is part k, row by row.

    Args:
        parts: of a cell.
        first: code point of the first pattern that is not elsewhere; the rest follow it in order.
        elsewhere: code points of patterns that Unicode had before.
    """
    letters = np.empty(1 << parts, dtype=np.int64)
    for pattern in range(1 << parts):
        letters[pattern] = elsewhere.get(pattern, first)
        first += pattern not in elsewhere
    return letters


SEXTANTS: Final = _letters(6, 0x1FB00, {0x00: 0x20, 0x15: 0x258C, 0x2A: 0x2590, 0x3F: 0x2588})
OCTANTS: Final = _letters(
    8,
    0x1CD00,
    {
        0x00: 0x20, 0x01: 0x1CEA8, 0x02: 0x1CEAB, 0x03: 0x1FB82, 0x05: 0x2598, 0x0A: 0x259D, 0x0F: 0x2580,
        0x14: 0x1FBE6, 0x28: 0x1FBE7, 0x3F: 0x1FB85, 0x40: 0x1CEA3, 0x50: 0x2596, 0x55: 0x258C, 0x5A: 0x259E,
        0x5F: 0x259B, 0x80: 0x1CEA0, 0xA0: 0x2597, 0xA5: 0x259A, 0xAA: 0x2590, 0xAF: 0x259C, 0xC0: 0x2582,
        0xF0: 0x2584, 0xF5: 0x2599, 0xFA: 0x259F, 0xFC: 0x2586, 0xFF: 0x2588,
    },
)  # fmt: skip
