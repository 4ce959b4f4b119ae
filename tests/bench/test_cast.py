"""The recording of the screens in the docs plays in any player of asciinema's format, and shows what it should."""

import json
from pathlib import Path

from PIL import Image

from bench.screens.cast import CELL, changes, draw
from bench.screens.screen import Cell, TerminalScreen

CAST = Path(__file__).parents[2] / "docs" / "rollcall.cast"
MAX_BYTES = 300_000


def test_the_recording_is_valid_small_and_shows_names_map_and_help():
    assert CAST.stat().st_size < MAX_BYTES
    header, *events = map(json.loads, CAST.read_text(encoding="utf-8").splitlines())
    assert header["version"] == 2
    times = [at_s for at_s, kind, data in events if kind == "o" and isinstance(data, str)]
    assert len(times) == len(events) > 10 and times == sorted(times) and times[-1] < 60
    terminal, seen = TerminalScreen(header["width"], header["height"]), []
    for _, _, data in events:
        terminal.feed(data.encode())
        seen.append(terminal.text)
    for words in ("REPLAY", "confirmed 99%", "MAP", "ALARMS", "quit", "pause"):
        assert any(words in text for text in seen), words


def test_the_moving_picture_is_small_and_of_the_recording():
    with Image.open(CAST.with_suffix(".gif")) as picture:
        events = CAST.read_text(encoding="utf-8").splitlines()[1:]
        assert len(events) - 8 < picture.n_frames <= len(events)
    assert CAST.with_suffix(".gif").stat().st_size < 1_000_000


def test_letters_are_drawn_in_their_colours():
    look = ("38;2;255;0;0", "48;5;16")
    picture = draw([[Cell("▀", look), Cell("\u2801", look)]], {})
    assert picture.getpixel((0, 0)) == (255, 0, 0) and picture.getpixel((0, CELL[1] - 1)) == (0, 0, 0)
    assert picture.getpixel((CELL[0] + 2, 2)) == (255, 0, 0) and picture.getpixel((CELL[0] + 6, 2)) == (0, 0, 0)


def test_only_what_changed_is_drawn():
    before = [[Cell("a"), Cell("b"), Cell("▀", ("38;2;200;10;10",))]]
    after = [[Cell("a"), Cell("c"), Cell("▀", ("38;2;10;200;10",))]]
    drawn = changes(before, after)
    terminal = TerminalScreen(3, 1)
    terminal.feed(b"ab" + drawn.encode())
    assert terminal.text == "ac▀"
    assert "38;5;" in drawn and "a" not in drawn
    assert changes(after, after) == ""


def test_a_terminal_reads_moves_colours_and_wide_letters():
    terminal = TerminalScreen(6, 2)
    for part in ("\x1b[?25l\x1b[2;2H\x1b[1;38;2;1;2;3m漢", "x\x1b[0m\x1b[1;1Hab", "\x1b]0;title\x07\x1b[K"):
        terminal.feed(part.encode())
    assert terminal.text == "ab    \n 漢x  "
    assert terminal.cells[1][1].look == ("1", "38;2;1;2;3")
    data = "\x1b[1;5H漢".encode()
    terminal.feed(data[:4])
    terminal.feed(data[4:7])
    terminal.feed(data[7:])
    assert terminal.text.splitlines()[0] == "ab  漢"
