"""The one door to textual-image: real pixels on kitty, sixel and iTerm2 terminals, nothing elsewhere.

What the terminal can is asked here, when an app is made and before it runs, and textual-image is imported only where it
has images. It has no iTerm2 images; those are here.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import io
import os
import re
import struct
import sys
import termios
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs.tui.draw.mosaic import PictureMode
from gcs.tui.draw.terminal_kind import ask_version, finest_grain, has_terminal, is_in_multiplexer
from gcs.tui.terminal.question import ask
from gcs.tui.themes import Depth

Graphics = Literal["auto", "pixels", "blocks", "sextants", "octants"]
SHOW_INLINE = frozenset({"iTerm.app", "WarpTerminal"})
"""TERM_PROGRAM of terminals that show iTerm2's images, and in some versions neither kitty's nor sixels."""
KITTY_QUESTION = b"\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"
KITTY_REPLY = re.compile(r"\x1b_Gi=31[^;]*;OK\x1b")
CELL_QUESTION = b"\x1b[16t"
CELL_REPLY = re.compile(r"\x1b\[6;(\d{1,4});(\d{1,4})t")
ATTRIBUTES = re.compile(r"\x1b\[\?([\d;]*)c")
USUAL_CELL = (10, 20)
"""px, of a terminal that does not tell."""
QUALITY = 85
"""Quality of JPEG: a third of PNG's size, and what it blurs is less than a camera's own coding does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pixels:
    """The way this terminal shows images."""

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
    kind, cell = _kind_of_images()
    if kind is None:
        return None
    try:
        widgets = _textual_image(cell)
    except (ImportError, OSError, ValueError, ArithmeticError, RuntimeError, termios.error):
        return None
    widget: Any = {"sixel": widgets.SixelImage, "kitty": widgets.TGPImage}.get(kind) or _inline_widget()
    return Pixels(widget=widget, cell_width=cell[0], cell_height=cell[1])


def _kind_of_images() -> tuple[Literal["sixel", "kitty", "inline"] | None, tuple[int, int]]:
    """Reply of this terminal on images, and width and height of its cells in px."""
    assert sys.__stdin__ is not None and sys.__stdout__ is not None
    replies = "".join(ask(sys.__stdin__.fileno(), sys.__stdout__.fileno(), KITTY_QUESTION + CELL_QUESTION))
    attributes = ATTRIBUTES.search(replies)
    if attributes and "4" in attributes[1].split(";"):
        return "sixel", _cell_size(replies)
    if KITTY_REPLY.search(replies):
        return "kitty", _cell_size(replies)
    return ("inline" if _shows_inline(os.environ) else None), _cell_size(replies)


def _cell_size(replies: str) -> tuple[int, int]:
    assert sys.__stdout__ is not None
    with contextlib.suppress(OSError):
        size = fcntl.ioctl(sys.__stdout__.fileno(), termios.TIOCGWINSZ, bytes(8))
        rows, columns, wide, high = struct.unpack("4H", size)
        if rows and columns and wide >= columns and high >= rows:
            return wide // columns, high // rows
    reply = CELL_REPLY.search(replies)
    return (max(1, int(reply[2])), max(1, int(reply[1]))) if reply else USUAL_CELL


def _textual_image(cell: tuple[int, int]) -> Any:  # noqa: ANN401  textual-image's module
    """textual-image's widgets, without its own questions: they leave the ends of late replies behind as keys."""
    terminal, sys.__stdout__ = sys.__stdout__, io.StringIO()  # type: ignore[misc, assignment]
    try:
        from textual_image import widget as widgets
        from textual_image._terminal import CellSize, get_cell_size
    finally:
        sys.__stdout__ = terminal  # type: ignore[misc]
    get_cell_size._result = CellSize(*cell)  # type: ignore[attr-defined]
    return widgets


def picture_mode(graphics: Graphics, colours: str | None) -> PictureMode:
    """The way the picture is drawn in cells.

    Args:
        graphics: as the user wants it; ``auto`` and ``pixels`` take the finest that the terminal is known to draw.
        colours: Rich's word for what the terminal has: ``truecolor``, ``256``, ``standard`` …
    """
    depth = depth_of(colours)
    if graphics in ("sextants", "octants"):
        return PictureMode(grain="sextants" if graphics == "sextants" else "octants", depth=depth)
    if graphics == "blocks" or not has_terminal() or sys.__stdin__ is None or sys.__stdout__ is None:
        return PictureMode(depth=depth)
    reads, writes = sys.__stdin__.fileno(), sys.__stdout__.fileno()
    return PictureMode(grain=finest_grain(os.environ, lambda: ask_version(reads, writes)), depth=depth)


def depth_of(colours: str | None) -> Depth:
    """Number of colours that the terminal has.

    Args:
        colours: Rich's word for it; None for a terminal that it has no word for.
    """
    return "256" if colours == "256" else "standard" if colours in ("standard", "windows") else "truecolor"


def _shows_inline(environ: Mapping[str, str]) -> bool:
    return not is_in_multiplexer(environ) and environ.get("TERM_PROGRAM", "") in SHOW_INLINE


def inline_image(image: Any) -> str:  # noqa: ANN401  Pillow's
    """An image as iTerm2's control sequence (OSC 1337), in its own size; the cursor may move by it."""
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
