"""The one door to textual-image: real pixels on kitty and sixel terminals, nothing elsewhere.

textual-image asks the terminal questions while it is imported, so it is imported here only, when an app is made and
before it runs, and only when there is a terminal to ask.
"""

from __future__ import annotations

import os
import sys
import termios
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Graphics", "Pixels", "has_terminal", "pixel_images"]

Graphics = Literal["auto", "blocks", "pixels"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pixels:
    """How this terminal shows images."""

    widget: Any
    """textual-image's widget class."""
    cell_width: int
    """px"""
    cell_height: int
    """px"""

    def to_widget(self, image: NDArray[np.uint8]) -> Any:  # noqa: ANN401  Pillow is textual-image's business
        """(H, W, 3) BGR as the image that the widget takes."""
        from PIL import Image

        return Image.fromarray(np.ascontiguousarray(image[..., ::-1]))


def pixel_images(graphics: Graphics) -> Pixels | None:
    """Pixels if they are wanted and the terminal reports that it can, else None.

    ``auto`` keeps to half blocks over SSH: an image is some 0.7 MB, a field of half blocks some 0.05 MB.
    """
    if graphics == "blocks" or not has_terminal() or (graphics == "auto" and "SSH_CONNECTION" in os.environ):
        return None
    try:
        from textual_image import renderable
        from textual_image import widget as widgets
        from textual_image._terminal import get_cell_size
    except (ImportError, OSError, ValueError, ArithmeticError, RuntimeError, termios.error):
        return None
    if renderable.Image not in (renderable.SixelImage, renderable.TGPImage):
        return None
    size = get_cell_size()
    return Pixels(widget=widgets.Image, cell_width=max(1, size.width), cell_height=max(1, size.height))


def has_terminal() -> bool:
    """Whether input and output both are a terminal."""
    streams = (sys.__stdin__, sys.__stdout__)
    return all(stream is not None and not stream.closed and stream.isatty() for stream in streams)
