"""The recording of the screens as a moving picture, for pages that play no terminal recordings.

Needs DejaVu Sans Mono, which most Linux systems have.
"""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw, ImageFont
from rich.color import Color

from bench.screens.screen import BACKGROUND, FOREGROUND, Cell, TerminalScreen
from gcs.report.overlay import DARK

CELL = (9, 18)
"""Of a letter, px."""
LETTER_PX = 15
PAPER, INK = DARK, (206, 213, 225)
COLOURS = 96
BEGINS = "video ok"
"""The first picture shows that: it stands for all where nothing moves."""
LAST_S = 2.0
"""For which the last frame stands before it starts again."""
BOLD = "1"
HALVES = {"▀": (0.0, 0.5), "▄": (0.5, 1.0), "█": (0.0, 1.0)}
"""What of a cell has the colour of the letter."""
BRAILLE: Final = 0x2800
DOTS: Final = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
"""Column and row of each bit of a letter of Braille, which the map is drawn in and the font lacks."""
Rgb = tuple[int, int, int]


def colour(look: tuple[str, ...], place: str, default: Rgb) -> Rgb:
    """Of a letter or behind it.

    Example:
        >>> colour(("38;2;1;2;3", "48;5;16"), "38", INK), colour(("48;5;196",), "48", PAPER)
        ((1, 2, 3), (255, 0, 0))
    """
    for part in look:
        kind, *rest = part.split(";")
        if kind == place:
            numbers = [int(number) for number in rest[1:]]
            red, green, blue = numbers if rest[0] == "2" else Color.from_ansi(numbers[0]).get_truecolor()
            return red, green, blue
    return default


@cache
def fonts_of() -> dict[bool, ImageFont.FreeTypeFont]:
    """The font, and for True its bold letters."""
    return {bold: ImageFont.truetype(f"DejaVuSansMono{'-Bold' * bold}.ttf", LETTER_PX) for bold in (False, True)}


def draw(cells: list[list[Cell]], fonts: dict[bool, ImageFont.FreeTypeFont]) -> Image.Image:
    """A screen as a picture."""
    across, down = CELL
    image = Image.new("RGB", (across * len(cells[0]), down * len(cells)), PAPER)
    canvas = ImageDraw.Draw(image)
    for y, row in enumerate(cells):
        for x, cell in enumerate(row):
            left, top = x * across, y * down
            ink, paper = colour(cell.look, FOREGROUND, INK), colour(cell.look, BACKGROUND, PAPER)
            canvas.rectangle((left, top, left + across - 1, top + down - 1), fill=paper)
            if cell.letter in HALVES:
                low, high = (top + round(share * down) for share in HALVES[cell.letter])
                canvas.rectangle((left, low, left + across - 1, high - 1), fill=ink)
            elif 0 < ord(cell.letter or " ") - BRAILLE < 256:
                for bit, (column, line) in enumerate(DOTS):
                    if (ord(cell.letter) - BRAILLE) >> bit & 1:
                        x_px, y_px = left + 2 + column * across // 2, top + 2 + line * down // 4
                        canvas.rectangle((x_px, y_px, x_px + 1, y_px + 1), fill=ink)
            elif cell.letter.strip():
                canvas.text((left, top), cell.letter, fill=ink, font=fonts[BOLD in cell.look])
    return image


def save(cast: Path) -> Path:
    """Write the picture beside the recording."""
    header, *events = map(json.loads, cast.read_text(encoding="utf-8").splitlines())
    terminal = TerminalScreen(header["width"], header["height"])
    fonts = fonts_of()
    frames, times_s = list[Image.Image](), list[float]()
    for at_s, _, data in events:
        terminal.feed(data.encode())
        if frames or BEGINS in terminal.text:
            frames.append(draw(terminal.cells, fonts).quantize(COLOURS, dither=Image.Dither.NONE))
            times_s.append(at_s)
    steps_ms = [round(1000 * (after - at)) for at, after in pairwise([*times_s, times_s[-1] + LAST_S])]
    out = cast.with_suffix(".gif")
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=steps_ms, loop=0, optimize=True)
    return out
