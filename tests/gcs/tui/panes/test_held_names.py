"""Names that are held through a gap of the video look held, with their age, and are not counted as new."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.report.overlay import label_of
from gcs.tui.draw.video_canvas import video_cells, video_labels
from gcs.tui.panes.alarms import AlarmPane
from gcs.tui.panes.fleet import FleetPane
from gcs.tui.panes.identity import IdentityPane
from gcs.tui.panes.status import StatusBar
from gcs.tui.panes.video import VideoPane
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, polled, running, screen_text, text_of

S = 1_000_000


def aged(seconds, **change):
    """A snapshot whose frame and boxes are so old."""
    base = make_snapshot(live=True)
    then_us = base.t_us - round(seconds * S)
    return replace(base, seen_us=then_us, frame_us=then_us, **change)


def without_new_frame(seconds):
    base = aged(seconds, boxes=())
    rows = [
        replace(row, standing="no new frame", track_id=0, confidence=float("nan")) if row.track_id else row
        for row in base.vehicles
    ]
    return replace(base, vehicles=tuple(rows))


def test_labels_say_how_old_they_are_where_nothing_else_does():
    labels = [label_of(aged(1.4), box) for box in aged(1.4).boxes]
    assert all(label.endswith(" (1.4s)") for label in labels) and labels[0].startswith("UGV-11 97%")
    assert label_of(aged(0.2), aged(0.2).boxes[0]) == "UGV-11 97%"
    assert video_labels(aged(1.4), 0, 120, 40).places == video_labels(aged(0.2), 0, 120, 40).places, "no label moves"


def test_names_that_are_held_are_drawn_fainter():
    fresh, held = (video_cells(aged(seconds), 0, 120, 40).strips() for seconds in (0.2, 1.4))

    def colour_of(strips):
        return next(s.style.color for strip in strips for s in strip if s.text.strip().startswith("UGV-11"))

    assert colour_of(fresh) != colour_of(held)


@pytest.mark.parametrize(("seconds", "shown"), [(0.2, False), (0.8, True)])
async def test_the_screen_marks_what_is_held(seconds, shown):
    station = FakeStation(live=True, snapshot=aged(seconds))
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        app.selected = 11
        await pilot.pause()
        assert screen_text(app).count("0.8s") == 3 * shown, "count, picture and card"
        status = text_of(app.query_one(StatusBar))
        assert ("confirmed 0.8s ago" in status, "video ok" in status) == (shown, not shown)
        assert ("0.8s old" in text_of(app.query_one(VideoPane))) == shown
        card = text_of(app.query_one(IdentityPane))
        assert ("names 0.8s old" in card) == shown
        assert ("wait for a new picture" in card, "the picture is old" in card) == (shown, shown)
        assert ("nothing: rely on it" in card, "where no box is" in card) == (not shown, False)


async def test_after_two_seconds_there_is_no_count_but_why():
    station = FakeStation(live=True, snapshot=without_new_frame(4.0))
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        fleet, status = text_of(app.query_one(FleetPane)), text_of(app.query_one(StatusBar))
        assert "no new frame" in fleet and "97%" not in fleet
        assert "–/7 confirmed" in status and "video ok" not in status
        assert "4.0s old" in text_of(app.query_one(VideoPane)).splitlines()[0]


async def test_clocks_show_the_latest_moment_although_a_frame_is_older():
    base = make_snapshot(live=True)
    ahead = base.t_us + 3 * S
    late = replace(base, clock_us=ahead, alarms=tuple(replace(a, since_us=ahead - 5 * S) for a in base.alarms))
    station = FakeStation(live=True, snapshot=late)
    async with running(station, WIDE) as (app, pilot, _):
        await polled(app, pilot)
        assert "10:37:26Z" in text_of(app.query_one(StatusBar))
        await pilot.press("a")
        assert not base.alarms or " 5.0s " in text_of(app.query_one(AlarmPane))
