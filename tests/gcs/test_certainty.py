"""How certain a name is: one number and one wording, wherever it is shown."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.certainty import CONFIRMED, certainty, named
from gcs.report.overlay import label_of
from gcs.tui.palette import GOOD
from gcs.tui.panes.identity import IdentityPane
from gcs.tui.panes.status import StatusBar
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, polled, running, text_of


def test_a_certainty_is_rounded_down_and_never_complete():
    assert [certainty(share) for share in (0.0, 0.29, 0.6, 0.8999, 0.9, 0.994, 0.999, 1.0)] == [
        *("0%", "29%", "60%", "89%", "90%", "99%", "99%", "99%")
    ]
    assert certainty(math.nan) == ""
    assert certainty(CONFIRMED) == "90%" and certainty(math.nextafter(CONFIRMED, 0.0) - 1e-6) == "89%"


def test_a_standing_is_said_with_its_certainty():
    assert named("confirmed", 1.0) == "confirmed 99%"
    assert named("no position", math.nan) == "no position"
    assert named("tentative", 0.8, stated=True) == "stated"
    assert named("coasting", 0.8, stated=True) == "coasting 80%"


@pytest.mark.parametrize("confidence", [0.907, 0.999, 1.0])
async def test_video_table_and_identity_say_the_same(confidence):
    said = certainty(confidence)
    base = make_snapshot()
    boxes = tuple(replace(box, confidence=confidence) if box.system_id == 11 else box for box in base.boxes)
    rows = tuple(replace(row, confidence=confidence) if row.system_id == 11 else row for row in base.vehicles)
    station = FakeStation(snapshot=replace(base, boxes=boxes, vehicles=rows))
    async with running(station, size=WIDE) as (app, pilot, _):
        await pilot.press("down", "down")
        for pane in ("fleet", "identity"):
            assert f"confirmed {said}" in text_of(app.query_one(f"#{pane}"))
        assert label_of(station.snapshot, boxes[0]) == f"UGV-11 {said}"
        assert "100%" not in text_of(app.query_one("#identity"))


async def test_masses_of_the_methods_are_in_the_view_for_analysts_alone():
    async with running(size=WIDE) as (app, pilot, _):
        await pilot.press("down", "down")
        pane = app.query_one(IdentityPane)
        assert not any(word in text_of(pane) for word in ("projection", "topology", "fused"))
        await pilot.press("x")
        said = " ".join(text_of(pane).split())
        assert all(word in said for word in ("projection", "topology", "fused", "for analysts"))
        assert "confirmed 97%" not in said
        await pilot.press("x")
        assert "fused" not in text_of(pane) and "confirmed 97%" in text_of(pane)


async def test_none_confirmed_is_not_good_news():
    base = make_snapshot()
    rows = tuple(replace(row, standing="unidentified", confidence=math.nan) for row in base.vehicles)
    station = FakeStation(snapshot=replace(base, vehicles=rows))
    async with running(station, size=WIDE) as (app, pilot, _):
        await polled(app, pilot)
        bar, pane = app.query_one(StatusBar), app.query_one(IdentityPane)
        counts = [*bar.render_line(0), *(part for y in range(pane.size.height) for part in pane.render_line(y))]
        said = [part for part in counts if part.text.strip() in ("0/7 confirmed", "0 of 7")]
        assert len(said) == 2
        assert all(tuple(part.style.color.triplet) != GOOD for part in said)
