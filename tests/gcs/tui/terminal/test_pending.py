from __future__ import annotations

import re

from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual._compositor import LayoutUpdate
from textual.geometry import Region
from textual.strip import Strip

from gcs.tui.terminal.pending import PendingCells

WIDTH, HEIGHT = 60, 10
CONSOLE = Console(color_system="truecolor", force_terminal=True)


class Screen:
    """What a terminal shows of text and moves of the cursor."""

    def __init__(self) -> None:
        self.rows = [[" "] * WIDTH for _ in range(HEIGHT)]

    def show(self, sequences: str) -> None:
        for row, column, text in re.findall(r"\x1b\[(\d+);(\d+)H((?:(?!\x1b\[\d+;\d+H).)*)", sequences, re.DOTALL):
            letters = re.sub(r"\x1b\[[\d;]*m", "", text)
            self.rows[int(row) - 1][int(column) - 1 : int(column) - 1 + len(letters)] = letters

    def text(self) -> list[str]:
        return ["".join(row) for row in self.rows]


def words(text: str) -> Strip:
    return Strip([Segment(text, Style(color="red"))])


def picture(letter: str, cells: int = WIDTH) -> Strip:
    return Strip([Segment(letter, Style(color=f"rgb({i},0,0)")) for i in range(cells)])


def whole(*rows: Strip) -> LayoutUpdate:
    return LayoutUpdate([[row] for row in rows], Region(0, 0, WIDTH, len(rows)))


def test_only_the_newest_of_a_cell_is_sent():
    pending, screen = PendingCells(), Screen()
    for letter in "abc":
        pending.add(whole(*[picture(letter)] * HEIGHT))
    sent = ""
    while pending:
        sent += pending.take(700, CONSOLE)
    screen.show(sent)
    assert screen.text() == ["c" * WIDTH] * HEIGHT
    assert "a" not in sent and "b" not in sent


def test_pieces_over_each_other_end_as_the_last_one_left_them():
    pending, screen, want = PendingCells(), Screen(), Screen()
    for y, x, text in (
        (0, 0, "a" * 40),
        (0, 10, "b" * 10),
        (0, 5, "c" * 10),
        (0, 38, "d" * 5),
        (0, 38, "e" * 3),
        (1, 3, "f"),
    ):
        pending._put(y, x, words(text))
        want.show(f"\x1b[{y + 1};{x + 1}H{text}")
    screen.show(pending.take(10_000, CONSOLE))
    assert screen.text() == want.text()
    assert not pending


def test_text_goes_before_a_picture_and_never_stops_it():
    pending = PendingCells()
    pending.add(whole(*[picture("p")] * 6, *[words(f"row {y} " * 8) for y in range(6, HEIGHT)]))
    first = pending.take(1024, CONSOLE)
    assert all(f"row {y}" in first for y in range(6, HEIGHT)) and "p" in first
    assert first.index("row 9") < first.index("p\x1b")
    shown = 0
    for _ in range(100):
        for y in range(6, HEIGHT):
            pending._put(y, 0, Strip([Segment("new text "), Segment("x" * 400)]))
        shown += pending.take(1024, CONSOLE).count("p")
    assert shown >= 4 * WIDTH


def test_a_chunk_is_as_large_as_its_room():
    pending = PendingCells()
    pending.add(whole(*[picture("p")] * HEIGHT))
    while pending:
        assert len(pending.take(2000, CONSOLE).encode()) <= 2000 + 600
