"""The operator states by keys which vehicle a box is, and withdraws it."""

from __future__ import annotations

from dataclasses import replace

from gcs.snapshot import Candidate
from gcs.tui.screens.naming import NameList, choices_of
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, running, screen_text

CANDIDATES = (
    Candidate(system_id=15, confidence=0.34, distance_m=9.8, against="too far: up to 2.4 m is usual"),
    Candidate(system_id=12, confidence=0.02, distance_m=31.0, against="another box has its name (99%)"),
)


def live(**change):
    base = make_snapshot(live=True)
    boxes = tuple(replace(box, candidates=CANDIDATES, **change) if box.track_id == 21 else box for box in base.boxes)
    return FakeStation(live=True, snapshot=replace(base, boxes=boxes))


def told(app):
    """What the app has notified of."""
    return " ".join(note.message for note in app._notifications)


async def test_the_picked_box_is_stated_with_two_keys():
    async with running(live(), size=WIDE) as (app, pilot, station):
        await pilot.press("up", "equals_sign")
        assert isinstance(app.screen, NameList)
        said = screen_text(app)
        assert (
            "Which vehicle is track 21" in said
            and "34%, 9.8 m, too far: up to 2.4 m is usual" in said
            and "none of ours" in said
        )
        await pilot.press("enter")
        assert station.stated == [(21, 15)]
        assert (app.selected, app.picked_track) == (15, 0)


async def test_the_last_choice_is_none_of_ours():
    async with running(live(), size=WIDE) as (app, pilot, station):
        await pilot.press("up", "equals_sign", "end", "enter")
        assert station.stated == [(21, 0)] and (app.selected, app.picked_track) == (0, 21)


async def test_the_present_name_is_confirmed_by_enter():
    async with running(live(), size=WIDE) as (_, pilot, station):
        await pilot.press("down", "down", "equals_sign", "enter")
        assert station.stated == [(3, 11)]


def test_choices_begin_with_the_present_name_and_then_the_likeliest():
    snapshot = live().snapshot
    box = next(box for box in snapshot.boxes if box.track_id == 21)
    assert [key for key, _ in choices_of(snapshot, box)] == ["15", "12", "11", "13", "14", "16", "17", "0"]
    named = replace(box, system_id=17)
    assert [key for key, _ in choices_of(snapshot, named)][:3] == ["17", "15", "12"]


async def test_the_keys_close_the_list_without_a_statement():
    async with running(live(), size=WIDE) as (app, pilot, station):
        await pilot.press("up")
        for key in ("escape", "q", "equals_sign"):
            await pilot.press("equals_sign")
            assert isinstance(app.screen, NameList)
            await pilot.press(key)
            assert not isinstance(app.screen, NameList)
        assert station.stated == []


async def test_without_a_box_there_is_nothing_to_state():
    async with running(live(), size=WIDE) as (app, pilot, station):
        await pilot.press("equals_sign")
        assert not isinstance(app.screen, NameList) and "pick a box first" in told(app)
        await pilot.press("down", "down", *["down"] * 6, "equals_sign")
        assert app.selected == 17 and not isinstance(app.screen, NameList)
        assert station.stated == []


async def test_one_key_withdraws_a_statement():
    async with running(live(stated=True), size=WIDE) as (_, pilot, station):
        await pilot.press("up", "backspace")
        await pilot.press("escape", "backspace")
        assert station.stated == [(21, None), (0, None)]


async def test_a_recording_takes_no_statements():
    async with running(size=WIDE) as (app, pilot, station):
        await pilot.press("down", "down", "equals_sign", "backspace")
        assert not isinstance(app.screen, NameList) and "a recording takes no statements" in told(app)
        assert station.stated == []
