"""The one door to textual-image: real pixels on kitty, sixel and iTerm2 terminals, nothing elsewhere.

textual-image asks the terminal questions while it is imported, so it is imported here only, when an app is made and
before it runs, and only when there is a terminal to ask. It has no iTerm2 images; those are here.
"""

from __future__ import annotations

import base64
import io
import os
import sys
import termios
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs.tui.draw.mosaic import PictureMode
from gcs.tui.draw.terminal_kind import ask_version, finest_grain, has_terminal, is_in_multiplexer

__all__ = ["Graphics", "Pixels", "inline_image", "picture_mode", "pixel_images"]

Graphics = Literal["auto", "pixels", "blocks", "sextants", "octants"]
SHOW_INLINE = frozenset({"iTerm.app", "WarpTerminal"})
"""TERM_PROGRAM of terminals that show iTerm2's images, and in some versions neither kitty's nor sixels."""
QUALITY = 85
"""Of JPEG: a third of PNG's size, and what it blurs is less than a camera's own coding does."""


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

    ``auto`` keeps to blocks over SSH: an image is some 0.7 MB, a field of half blocks some 0.05 MB.
    """
    wanted = graphics == "pixels" or (graphics == "auto" and "SSH_CONNECTION" not in os.environ)
    if not wanted or not has_terminal():
        return None
    try:
        from textual_image import renderable
        from textual_image import widget as widgets
        from textual_image._terminal import get_cell_size
    except (ImportError, OSError, ValueError, ArithmeticError, RuntimeError, termios.error):
        return None
    widget: Any = widgets.Image
    if renderable.Image not in (renderable.SixelImage, renderable.TGPImage):
        if not _shows_inline(os.environ):
            return None
        widget = _inline_widget()
    size = get_cell_size()
    return Pixels(widget=widget, cell_width=max(1, size.width), cell_height=max(1, size.height))


def picture_mode(graphics: Graphics, colours: str | None) -> PictureMode:
    """How the picture is drawn in cells.

    Args:
        graphics: as the user wants it; ``auto`` and ``pixels`` take the finest that the terminal is known to draw.
        colours: Rich's word for what the terminal has: ``truecolor``, ``256``, ``standard`` …
    """
    palette = colours == "256"
    if graphics in ("sextants", "octants"):
        return PictureMode(grain="sextants" if graphics == "sextants" else "octants", palette=palette)
    if graphics == "blocks" or not has_terminal() or sys.__stdin__ is None or sys.__stdout__ is None:
        return PictureMode(palette=palette)
    reads, writes = sys.__stdin__.fileno(), sys.__stdout__.fileno()
    return PictureMode(grain=finest_grain(os.environ, lambda: ask_version(reads, writes)), palette=palette)


def _shows_inline(environ: Mapping[str, str]) -> bool:
    return not is_in_multiplexer(environ) and environ.get("TERM_PROGRAM", "") in SHOW_INLINE


def inline_image(image: Any) -> str:  # noqa: ANN401  Pillow's
    """An image as iTerm2's control sequence (OSC 1337), in its own size; the cursor may move by it.

    Args:
        image: of Pillow.
    """
    file = io.BytesIO()
    image.convert("RGB").save(file, "JPEG", quality=QUALITY)
    data = file.getvalue()
    size = f"size={len(data)};width={image.width}px;height={image.height}px"
    return f"\x1b]1337;File=inline=1;preserveAspectRatio=0;{size}:{base64.b64encode(data).decode()}\x07"


def _inline_widget() -> Any:  # noqa: ANN401  textual-image's
    """textual-image's widget for sixels, which scales, crops and places an image, with another coding of its pixels."""
    from textual_image.widget import sixel

    class Coded(sixel._ImageSixelImpl):
        def _image_to_sixels(self, image: Any, *_: Any, **__: Any) -> str:  # noqa: ANN401
            return inline_image(image)

    class InlineImage(sixel.Image, Renderable=sixel._NoopRenderable):
        def compose(self) -> Any:  # noqa: ANN401
            yield Coded(self.image)

    return InlineImage
