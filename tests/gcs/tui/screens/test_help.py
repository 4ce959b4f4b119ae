from __future__ import annotations

import pytest
from textual.binding import Binding

from gcs.tui.actions import keys_of
from gcs.tui.keys import BINDINGS
from gcs.tui.panes.pane import Pane
from gcs.tui.screens.help import HelpScreen
from gcs.tui.screens.legend import LEGEND
from tests.support.fake_station import SMALL, WIDE, FakeStation, running, screen_text, text_of

SIZES = [WIDE, (120, 40), SMALL, (60, 20)]


async def help_pages(app, pilot):
    """What each page shows, until the first comes again."""
    await pilot.press("question_mark")
    seen = []
    while (page := text_of(app.screen.query_one("#help"))) not in seen:
        seen.append(page)
        await pilot.press("question_mark")
    return seen


def words_of(page):
    """Without columns and line breaks: of two columns, left before right."""
    rows = page.splitlines()[1:-1]
    half = len(rows[0]) // 2 if len(rows[0]) >= 2 * 58 else len(rows[0])
    return " ".join(" ".join(row[start : start + half] for row in rows) for start in range(0, len(rows[0]), half))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("live", [True, False])
async def test_every_key_and_mark_is_in_the_help_in_whole(size, live):
    async with running(FakeStation(live=live), size) as (app, pilot, _):
        seen = await help_pages(app, pilot)
        said = " ".join(" ".join(map(words_of, seen)).split())
        own = [binding for pane in app.query(Pane) for binding in pane.BINDINGS if isinstance(binding, Binding)]
        for binding in (*BINDINGS, *own):
            if binding.id.startswith("replay." if live else "flight."):
                assert binding.tooltip not in said
            else:
                assert f"{keys_of(binding)} {binding.tooltip}" in said, binding.tooltip
        for _, entries in LEGEND:
            for sign, _, meaning in entries:
                assert " ".join(f"{sign} {meaning}".split()) in said, sign
        assert all(f"page {at} of {len(seen)}" in page for at, page in enumerate(seen, start=1))


async def test_pages_fit_the_screen_and_turn_both_ways():
    async with running() as (app, pilot, _):
        seen = await help_pages(app, pilot)
        assert len(seen) > 2 and all(len(page.splitlines()) == 24 for page in seen)
        for key, at in (("right", 1), ("down", 2), ("left", 1), ("up", 0), ("left", -1), ("pagedown", 0)):
            await pilot.press(key)
            assert text_of(app.screen.query_one("#help")) == seen[at], key
        await pilot.click("#help", offset=(60, 5))
        assert text_of(app.screen.query_one("#help")) == seen[1]
        await pilot.resize_terminal(*WIDE)
        await pilot.pause()
        await pilot.press("left")
        assert "page 1 of " in screen_text(app), "less pages on a larger screen"


@pytest.mark.slow_but_first
@pytest.mark.parametrize("key", ["escape", "q", "enter"])
async def test_the_help_is_left_by_its_keys(key):
    async with running() as (app, pilot, _):
        await pilot.press("question_mark", key)
        assert not isinstance(app.screen, HelpScreen) and app.is_running
