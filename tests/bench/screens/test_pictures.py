"""Pictures of the screens show what the terminal gets."""

from __future__ import annotations

from bench.screens.cast import CELL, colour, draw, fonts_of
from bench.screens.pictures import _ShownApp, cells_of
from bench.screens.screen import BACKGROUND
from gcs.tui.draw.xterm_palette import SIXTEEN
from gcs.tui.themes import LIGHT, Colour
from tests.support.fake_station import SMALL, FakeStation, screen_text


async def test_a_picture_has_the_letters_and_the_few_colours_of_its_terminal():
    papers = {}
    for depth in ("truecolor", "standard"):
        app = _ShownApp(FakeStation(live=True), "light", depth)
        async with app.run_test(size=SMALL) as pilot:
            await pilot.pause()
            cells = cells_of(app)
            assert "\n".join("".join(cell.letter for cell in row) for row in cells) == screen_text(app)
            papers[depth] = {colour(cell.look, BACKGROUND, (1, 1, 1)) for row in cells for cell in row}
            assert draw(cells, fonts_of()).size == (CELL[0] * SMALL[0], CELL[1] * SMALL[1])
    assert LIGHT.colours[Colour.PANEL] in papers["truecolor"]
    assert len(papers["standard"]) <= len(SIXTEEN) < len(papers["truecolor"])
