"""A short recording of the screens for the docs, in asciinema's format and as a moving picture, of a scripted replay.

    python -m bench.screens.cast docs/rollcall.cast

The program runs in a pseudo-terminal on a copy of a bundled recording. A few frames a second are kept, each as the
cells that changed, with the camera's image in 256 colours, so that the file stays small.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import groupby
from pathlib import Path

from rich.color import Color, ColorSystem

from bench.screens.gif import save
from bench.screens.screen import Cell
from bench.screens.station import TerminalSession

SIZE = (80, 24)
RECORDING = Path("sitl_logs/curved-road")
FRAME_S = 0.5
ANALYSED_S = 300.0
PICTURE = frozenset("▀▄█")
HOME, DOWN, ESCAPE, SPACE = b"\x1b[H", b"\x1b[B", b"\x1b", b" "
PLAYING = "►"
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


def record(gcs: str, recording: Path) -> Iterator[tuple[float, str]]:
    """Frames as (seconds, what to write), of a replay that is analysed already."""
    blank: list[list[Cell]] = [[Cell()] * SIZE[0] for _ in range(SIZE[1])]
    before, now_s = blank, 0.0
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(recording, Path(folder) / recording.name)
        with TerminalSession([gcs, "replay", str(copy), "--ui", "graphics=blocks"], SIZE) as session:
            session.wait_until(lambda text: "analysed" in text.partition("\n")[0], ANALYSED_S)
            session.wait_until(lambda text: "analysed" not in text.partition("\n")[0], ANALYSED_S)
            session.press(HOME)
            session.wait_until(lambda text: "video ok" in text)
            if PLAYING not in session.catch_up():
                session.press(SPACE)
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
    """What turns one screen into the next, as a terminal takes it."""
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
    for at_s, drawn in record(".venv/bin/gcs", RECORDING):
        start = "\x1b[?25l\x1b[2J" if len(lines) == 1 else ""
        lines.append(json.dumps([at_s, "o", start + drawn], ensure_ascii=False))
    options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for written in (options.out, save(options.out)):
        print(f"{written}: {written.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
