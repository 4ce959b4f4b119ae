"""Single images from elsewhere, decoded within bounds: a file of some kilobytes may ask for gigabytes of pixels."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from infra.files.safe_open import read_small

MAX_SIDE_PX = 16384
"""Longest side of any camera's picture."""
MAX_BYTES = 256 << 20
PNG, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND"
FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TIFF")

Image = NDArray[np.uint8]


def decoded(data: bytes, most_side_px: int = MAX_SIDE_PX) -> Image | None:
    """(H, W, 3) BGR of an image's file; None where it is none, or a side is longer than that by its own heading."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of many pixels, which are counted here, and of odd tags
            with Picture.open(io.BytesIO(data), formats=FORMATS) as picture:
                if max(picture.size) > most_side_px or (picture.format == "PNG" and not _is_whole_png(data)):
                    return None
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    except (OSError, ValueError, SyntaxError, TypeError, LookupError, Picture.DecompressionBombError, cv2.error):
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def _is_whole_png(data: bytes) -> bool:
    """Tell whether the pieces of a PNG are as long as they say: OpenCV makes room for that before it reads them."""
    at = len(PNG)
    while at + 12 <= len(data):  # length, name, bytes, checksum
        if data[at + 4 : at + 8] == PNG_END:
            return True
        at += 12 + int.from_bytes(data[at : at + 4], "big")
    return False


def read_image(path: Path) -> Image | None:
    """The image in a file; None where there is none that can be decoded."""
    try:
        return decoded(read_small(path, MAX_BYTES))
    except OSError:
        return None
