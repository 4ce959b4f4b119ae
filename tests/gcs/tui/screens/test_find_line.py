from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.tui.panes.find_line import NONE_FOUND, FindLine
from gcs.tui.panes.key_hints import KeyHints
from gcs.tui.picking import found
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, running, screen_text

ROWS = [
    replace(make_snapshot().vehicles[0], system_id=system_id, name=name)
    for system_id, name in ((1, "UAV"), (12, "UGV-1"), (16, "Bravo 7"), (17, "UGV-11"), (7, "UGV-6"))
]


@pytest.mark.parametrize(
    ("words", "system_id"),
    [("1", 1), ("ugv-1", 12), ("16", 16), ("11", 17), ("br", 16), ("6", 7), ("7", 7), ("vo", 16), ("u", 1), ("g", 12)],
)
def test_a_part_of_a_name_means_the_vehicle_that_it_fits_best(words, system_id):
    assert found(ROWS, words).system_id == system_id


def test_a_word_that_no_vehicle_has_means_nobody():
    assert found(ROWS, "x") is None and found([], "1") is None and found(ROWS, "2") is None, "no part of an id"


async def test_the_vehicle_is_picked_while_its_name_is_typed_and_stays_or_goes_back():
    async with running(FakeStation(live=True), WIDE) as (app, pilot, _):
        first, *_, wanted = [row for row in app.snapshot.vehicles if row.role == "ugv"]
        await pilot.press("down", "f")
        before, focused = app.selected, app.focused
        await pilot.press("slash", *wanted.name)
        assert app.selected == wanted.system_id and not app.query_one(KeyHints).display
        await pilot.press("x")
        assert app.selected == before and NONE_FOUND in screen_text(app)
        await pilot.press("backspace")
        assert app.selected == wanted.system_id, "a key of the line states or withdraws nothing"
        await pilot.press("enter")
        assert app.selected == wanted.system_id and app.focused is focused
        assert not app.query(FindLine) and app.query_one(KeyHints).display
        await pilot.press("slash", *str(first.system_id))
        assert app.selected == first.system_id
        await pilot.press("escape")
        assert app.selected == wanted.system_id and not app.query(FindLine) and app.query_one(KeyHints).display


async def test_a_click_elsewhere_ends_the_search():
    async with running(FakeStation(live=True), WIDE) as (app, pilot, _):
        await pilot.press("slash", "1")
        await pilot.click("#identity", offset=(2, 0))
        await pilot.pause()
        assert not app.query(FindLine) and app.query_one(KeyHints).display
        await pilot.press("slash")
        assert app.query_one(FindLine)
