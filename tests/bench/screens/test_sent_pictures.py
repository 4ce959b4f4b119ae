"""Pictures as a terminal gets them."""

from __future__ import annotations

import pytest
from rich.console import Console
from textual.strip import Strip

from bench.screens.screen import TerminalScreen
from gcs.tui.draw.mosaic import PictureMode
from gcs.tui.draw.video_canvas import video_cells
from tests.support.fake_station import make_snapshot


@pytest.mark.parametrize("depth", ["truecolor", "256"])
def test_a_picture_is_sent_in_fewer_bytes_than_its_segments_and_shows_the_same(depth):
    rows = video_cells(make_snapshot(), 12, 60, 18, mode=PictureMode(depth=depth)).strips()
    console = Console(color_system=depth, force_terminal=True)
    sent, usual = ([strip.render(console) for strip in strips] for strips in (rows, [Strip([*row]) for row in rows]))
    screens = []
    for lines in (sent, usual):
        screen = TerminalScreen(60, 18)
        screen.feed("".join(f"\x1b[{y};1H{row}" for y, row in enumerate(lines, 1)).encode())
        screens.append(screen.cells)
    assert screens[0] == screens[1]
    assert len({cell for row in screens[0] for cell in row}) > 8
    assert len("".join(sent)) < 0.95 * len("".join(usual))
