"""A short recording of the screens for the docs, in asciinema's format and as a moving picture, of a scripted replay.

    python -m bench.screens.cast docs/rollcall.cast

The program runs in a pseudo-terminal on a copy of a bundled recording. A few frames a second are kept, each as the
cells that changed, with the camera's image in 256 colours, so that the file stays small. Pages that play no terminal
recordings show the moving picture, which needs DejaVu Sans Mono; most Linux systems have it.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw, ImageFont
from rich.color import Color, ColorSystem

from bench.screens.screen import BACKGROUND, FOREGROUND, Cell, TerminalScreen
from bench.screens.station import DOWN, HOME, RECORDING, SPACE, replaying
from gcs.report.overlay import DARK

CELL = (9, 18)
"""Width and height of a letter, px."""
LETTER_PX = 15
PAPER, INK = DARK, (206, 213, 225)
COLOURS = 96
BEGINS = "video ok"
"""The first picture shows that: it stands for all where nothing moves."""
LAST_S = 2.0
"""Time for which the last frame stands before it starts again, s."""
BOLD = "1"
HALVES = {"▀": (0.0, 0.5), "▄": (0.5, 1.0), "█": (0.0, 1.0)}
"""Part of a cell that has the colour of the letter, from and to, by letter."""
BRAILLE: Final = 0x2800
DOTS: Final = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))
"""Column and row of each bit of a letter of Braille, which the map is drawn in and the font lacks."""
Rgb = tuple[int, int, int]


def colour(look: tuple[str, ...], place: str, default: Rgb) -> Rgb:
    """Colour of a letter or behind it.

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


SIZE = (80, 24)
FRAME_S = 0.5
PICTURE = frozenset("▀▄█")
ESCAPE = b"\x1b"
STEPS: tuple[tuple[bytes, float], ...] = (
    (HOME, 3.5),  # video with names, fleet, log
    (DOWN, 1.0),
    (DOWN, 2.5),  # why a vehicle is the box that has its name
    (b"2", 2.0),  # the map
    (b"a", 2.0),  # what is wrong, and what to do
    (b"1", 1.5),
    (b"?", 2.0),  # the keys
    (ESCAPE, 1.0),
    (SPACE, 1.0),  # paused
)
"""Keys, and for how long to look, seconds."""
Rows = Sequence[Sequence[Cell]]


def record(recording: Path) -> Iterator[tuple[float, str]]:
    """Frames as (seconds, what to write), of a replay that is analysed already."""
    blank: list[list[Cell]] = [[Cell()] * SIZE[0] for _ in range(SIZE[1])]
    before, now_s = blank, 0.0
    with replaying(recording, SIZE) as session:
        session.wait_until(lambda text: PICTURE.intersection(text) != set())
        session.wait_analysed()
        session.go_to_start(playing=True)
        for keys, look_s in STEPS:
            session.press(keys)
            for _ in range(round(look_s / FRAME_S)):
                time.sleep(FRAME_S)
                session.catch_up()
                now_s += FRAME_S
                cells = [list(row) for row in session.terminal.cells]
                if drawn := changes(before, cells):
                    yield now_s, drawn
                before = cells


def changes(before: Rows, after: Rows) -> str:
    """Changes that turn one screen into the next, as a terminal takes them."""
    drawn, look = [], None
    for y, (old, new) in enumerate(zip(before, after, strict=True)):
        changed = [x for x in range(len(new)) if _small(old[x]) != _small(new[x])]
        for _, group in groupby(enumerate(changed), key=lambda pair: pair[1] - pair[0]):
            columns = [x for _, x in group]
            drawn.append(f"\x1b[{y + 1};{columns[0] + 1}H")
            for x in columns:
                cell = _small(new[x])
                if cell.look != look:
                    drawn.append(f"\x1b[{';'.join(('0', *cell.look))}m")
                    look = cell.look
                drawn.append(cell.letter)
    return "".join(drawn)


@lru_cache(maxsize=1 << 16)
def _small(cell: Cell) -> Cell:
    """The same in fewer letters: the camera's image in 256 colours."""
    if cell.letter not in PICTURE:
        return cell
    return Cell(cell.letter, tuple(map(_indexed, cell.look)))


def _indexed(look: str) -> str:
    place, *rest = look.split(";")
    if rest[:1] != ["2"]:
        return look
    red, green, blue = map(int, rest[1:])
    return f"{place};5;{Color.from_rgb(red, green, blue).downgrade(ColorSystem.EIGHT_BIT).number}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="file to write; the picture beside it")
    options = parser.parse_args()
    header = {"version": 2, "width": SIZE[0], "height": SIZE[1], "title": "Rollcall: a replay"}
    lines = [json.dumps(header)]
    for at_s, drawn in record(RECORDING):
        start = "\x1b[?25l\x1b[2J" if len(lines) == 1 else ""
        lines.append(json.dumps([at_s, "o", start + drawn], ensure_ascii=False))
    options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for written in (options.out, save(options.out)):
        print(f"{written}: {written.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
