"""The event log searched, and a vehicle's chatter folded."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gcs.snapshot import Event
from gcs.tui.draw.event_rows import found_events, rows_of
from gcs.tui.panes.event_log import EventPane
from tests.support.fake_station import HOSTILE, START_US, WIDE, FakeStation, polled, running, screen_text, text_of

NAMES = {1: "UAV-1", 11: "UGV-1", 12: "UGV-11"}


def event(text, system_id=11, kind="text", level="info", at_s=0):
    return Event(t_us=START_US + at_s * 1_000_000, level=level, kind=kind, text=text, system_id=system_id)


def rows(events):
    return [(row.event.text, row.times) for row in rows_of(events)]


def test_names_that_go_or_come_together_are_one_row_each():
    gone = [event(f"track {n} is no longer UGV-{n}: the evidence does not suffice", n, "identity") for n in (1, 2, 3)]
    come = [event(f"track {n} is UGV-{n} (8{n}%)", n, "identity", at_s=3) for n in (1, 2, 3)]
    assert rows([*gone, *come]) == [
        ("3 names gone, the evidence does not suffice: UGV-1, UGV-2, UGV-3", 1),
        ("3 named: UGV-1, UGV-2, UGV-3", 1),
    ]
    other = event("track 4 is no longer UGV-4: it left the picture", 4, "identity")
    later = event("track 3 is no longer UGV-3: the evidence does not suffice", 3, "identity", at_s=1)
    assert len(rows([*gone[:2], other])) == len(rows([*gone[:2], later])) == 3, "another reason, another frame"
    warned = [event(f"track {n} is UGV-{n} (89%), no longer UGV-9", n, "identity", "warning") for n in (1, 2, 3)]
    assert len(rows(warned)) == 3


def test_waypoints_of_one_vehicle_are_one_row_with_their_range():
    said = [event(f"Reached waypoint #{n}", at_s=n) for n in range(1, 13)]
    assert rows(said) == [("Reached waypoint #1–12", 12)]
    assert rows_of(said)[0].event.t_us == said[-1].t_us
    assert rows(said[:1]) == [("Reached waypoint #1", 1)]
    assert rows([event("EKF3 IMU0 is using GPS"), event("EKF3 IMU1 is using GPS")]) == [("EKF3 IMU0–1 is using GPS", 2)]
    assert rows([event("at -3.5 m"), event("at 12 m"), event("at 2 m")]) == [("at -3.5–12 m", 3)]


def test_others_may_talk_within_a_run_and_stay_apart():
    said = [event(f"Reached waypoint #{n}", who) for n in range(1, 5) for who in (11, 12)]
    assert rows(said) == [("Reached waypoint #1–4", 4), ("Reached waypoint #1–4", 4)]
    assert [row.event.system_id for row in rows_of(said)] == [11, 12]


def test_another_event_of_the_vehicle_ends_its_run():
    said = [event("Lap #1"), event("mode HOLD", kind="vehicle"), event("Lap #2")]
    assert [times for _, times in rows(said)] == [1, 1, 1]


def test_a_vehicles_waypoints_are_one_row_whatever_happens_meanwhile():
    said = [event("Reached waypoint #1"), event("mode HOLD", kind="vehicle"), event("Reached waypoint #2")]
    assert rows(said) == [("mode HOLD", 1), ("Reached waypoint #1–2", 2)]


def test_where_many_vehicles_reach_waypoints_that_is_one_row_and_nothing_else_is_in_it():
    said = [event(f"UGV-{who} says: Reached waypoint #{n}", who) for n in (1, 2) for who in range(11, 16)]
    assert rows(said) == [("5 vehicles reached waypoints 1–2", 1)] and rows_of(said)[0].event.system_id == 0
    assert rows(said[:5]) == [("5 vehicles reached waypoint 1", 1)]
    assert len(rows(said[:4])) == 4, "few"
    others = [
        event("Reached waypoint #3", 16, level="warning"),
        event("Waypoint 3 is not reached", 17),
        event("Reached waypoint #3", 18, level="alarm"),
    ]
    assert [text for text, _ in rows([*said, *others])] == [rows(said)[0][0], *(each.text for each in others)]


def test_alarms_names_and_other_kinds_are_never_folded():
    for kind, level in (("text", "alarm"), ("vehicle", "alarm"), ("identity", "info"), ("link", "warning")):
        said = [event(f"track {n} is it", kind=kind, level=level) for n in range(5)]
        assert [times for _, times in rows(said)] == [1] * 5, (kind, level)
    assert [times for _, times in rows([event("lost 1", system_id=0), event("lost 2", system_id=0)])] == [1, 1]


@given(st.lists(st.tuples(st.sampled_from(["a 1", "a 2", "b", *HOSTILE[:4]]), st.integers(0, 2)), max_size=30))
def test_no_event_is_lost_by_folding(said):
    events = [event(text, who) for text, who in said]
    assert sum(row.times for row in rows_of(events)) == len(events)


def test_search_finds_words_kinds_levels_and_vehicles():
    said = [
        event("Reached waypoint #3", 11),
        event("Reached waypoint #3", 12),
        event("track 4 is UGV-11 (99%)", 12, "identity"),
        event("UGV-11 is near", 0, "operator"),
        event("position lost", 11, "vehicle", "alarm"),
    ]
    find = lambda query: [said.index(each) for each in found_events(said, query, NAMES)]  # noqa: E731
    assert find("") == [0, 1, 2, 3, 4]
    assert find("WAYPOINT") == [0, 1]
    assert find("ugv-1") == [0, 4], "not those of UGV-11"
    assert find("ugv-11") == [1, 2, 3]
    assert find("identity") == [2] and find("alarm") == [4] and find("ugv-11 waypoint") == [1]
    assert find("nothing") == []


async def test_search_in_flight_and_escape():
    station = FakeStation(live=True)
    async with running(station, size=(120, 40)) as (app, pilot, _):
        log = app.query_one(EventPane)
        await pilot.press("e", "slash", *"UGV-11", "enter")
        assert "/UGV-11" in text_of(log) and "UGV-12 confirmed" not in text_of(log)
        assert "EKF3 IMU0 is using GPS" in text_of(log)
        station.said = [*station.said, event("now", 11, at_s=300), event("not now", 12, at_s=301)]
        await polled(app, pilot)
        assert "now" in text_of(log) and "not now" not in text_of(log)
        await pilot.press("f", "down", "escape")
        assert "UGV-12 confirmed" in text_of(log) and app.selected, "the search ends first"
        await pilot.press("escape")
        assert not app.selected


async def test_a_search_without_a_hit_says_how_to_end_it_and_takes_any_text():
    async with running(size=(120, 40)) as (app, pilot, _):
        await pilot.press("e")
        for text in ("[/x]", "\\", "(((", HOSTILE[4]):
            await pilot.press("slash")
            app.screen.query_one("#answer").value = text
            await pilot.press("enter")
            assert "esc ends the search" in text_of(app.query_one(EventPane))
            assert "\u202e" not in screen_text(app)
        await pilot.press("slash")
        app.screen.query_one("#answer").value = " "
        await pilot.press("enter")
        assert "UGV-11" in text_of(app.query_one(EventPane))


async def test_chatter_is_folded_on_the_screen():
    async with running(size=(120, 40)) as (app, pilot, station):
        station.said = [event(f"Reached waypoint #{n}", at_s=n) for n in range(1, 13)]
        await polled(app, pilot)
        said = text_of(app.query_one(EventPane))
        assert "Reached waypoint #1–12 × 12" in said


async def test_a_short_log_leaves_out_what_is_routine_until_it_has_the_focus():
    station = FakeStation(live=True)
    station.said = [event(f"track {n}", 0, "identity") for n in range(9)]
    station.said += [event("Reached waypoint #3", vehicle, at_s=9) for vehicle in range(11, 17)]
    async with running(station) as (app, pilot, _):
        log = app.query_one(EventPane)
        assert "track 8" in text_of(log) and "reached waypoint 3" not in text_of(log)
        await pilot.press("e")
        assert "6 vehicles reached" in text_of(log)
    async with running(station, WIDE) as (app, _, _):
        assert "6 vehicles reached waypoint 3" in text_of(app.query_one(EventPane))


async def test_a_pick_makes_only_the_rows_of_the_vehicles_anew_that_it_concerns(monkeypatch):
    async with running(FakeStation(live=True), WIDE) as (app, pilot, _):
        log = app.query_one(EventPane)
        await pilot.press("down", "down")
        before, made = text_of(log), []
        fresh = log._fresh_rows_of
        monkeypatch.setattr(log, "_fresh_rows_of", lambda row, *a, **k: made.append(row) or fresh(row, *a, **k))
        first = app.selected
        await pilot.press("down")
        assert app.selected != first
        assert {row.event.system_id for row in made} <= {first, app.selected}
        assert text_of(log) == before
        await pilot.press("t")
        assert {row.event.system_id for row in made} > {first, app.selected}
