from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from gcs.snapshot import Event
from gcs.tui import RollcallApp
from gcs.tui.draw.event_rows import rows_of
from gcs.tui.panes import event_log
from tests.support.fake_station import HOSTILE, START_US, FakeStation, FakeTimeline, hostile_station, make_snapshot


def letters_on(app) -> str:
    return "".join(segment.text for row in app.screen._compositor.render_strips() for segment in row)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("text", HOSTILE)
async def test_text_from_the_air_is_only_text(text, capsys):
    station = hostile_station(text)
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=(120, 36)) as pilot:
        station.error = RuntimeError(text)
        app.notify(text, markup=False)
        for keys in (
            ["down", "down"],
            ["3"],
            ["f", "z"],
            ["e"],
            ["M"],
            ["m", "escape"],
            ["a", "down", "enter"],
            ["f", "z", "z"],
            ["i"],
            ["2"],
            ["1"],
            ["A"],
            ["v", "question_mark"],
        ):
            await pilot.press(*keys)
            app._poll()
            await pilot.pause()
            said = letters_on(app)
            assert not any(ord(letter) < 32 or 0x7F <= ord(letter) < 0xA0 for letter in said)
            assert not set(said) & set("\u202e\u2066\ud800\u200b\u200d\ufeff\u2028\u2029\ue000")
        assert app.is_running
        await pilot.press("escape", "q")
    assert app.return_code == 1
    left = capsys.readouterr().err
    assert left.startswith("station stopped: ") and "\x1b" not in left and "\x07" not in left


async def test_markup_is_shown_letter_by_letter():
    app = RollcallApp(hostile_station("[@click=app.quit]x[/]"), graphics="blocks")
    async with app.run_test(size=(200, 60)) as pilot:
        await pilot.pause()
        assert "[@click=app.quit]x[/]" in letters_on(app)


def wild(rng: random.Random) -> float:
    return rng.choice([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-12, 1e12, -1e300, 1e300, 3.5, 700.0])


async def test_wild_numbers_break_nothing():
    rng = random.Random(5)
    base = make_snapshot()
    station = FakeStation(snapshot=base)
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=(130, 40)) as pilot:
        for round_ in range(14):
            rows = tuple(
                replace(
                    row,
                    p_enu=np.array([wild(rng) for _ in range(3)]),
                    heading=wild(rng),
                    std_m=wild(rng),
                    confidence=wild(rng),
                    loss=wild(rng),
                    position_age_s=wild(rng),
                    heartbeat_age_s=wild(rng),
                )
                for row in base.vehicles
            )
            boxes = tuple(
                replace(
                    box,
                    cx=wild(rng),
                    cy=wild(rng),
                    w=wild(rng),
                    h=wild(rng),
                    angle=wild(rng),
                    heading=wild(rng),
                    confidence=wild(rng),
                    projection=wild(rng),
                    residual_m=wild(rng),
                    lat_deg=wild(rng),
                    p_enu=np.array([wild(rng) for _ in range(3)]),
                )
                for box in base.boxes
            )
            health = replace(base.health, lag_s=wild(rng), fps=wild(rng), time_offset_s=wild(rng))
            station.snapshot = replace(
                base,
                vehicles=rows,
                boxes=boxes,
                health=health,
                frame=round_,
                uav_heading=wild(rng),
                uav_enu=np.array([wild(rng) for _ in range(3)]),
                t_us=rng.choice([0, -1, 2**62, base.t_us]),
                footprint_enu=np.array([[wild(rng), wild(rng)] for _ in range(4)]),
            )
            app._poll()
            await pilot.press("down", "plus" if round_ % 2 else "minus", "c")
        assert app.is_running


async def test_a_flood_of_events_stays_bounded_and_is_not_folded_for_every_key(monkeypatch):
    folded = []

    def fold(events):
        folded.append(len(events))
        return rows_of(events)

    monkeypatch.setattr(event_log, "rows_of", fold)
    station = FakeStation(live=True)
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=(80, 24)) as pilot:
        for burst in range(20):
            station.said = [
                Event(t_us=START_US + i, level="alarm", kind="text", text=HOSTILE[i % 8] * 40)
                for i in range(3000 + burst)
            ]
            app._poll()
        await pilot.pause()
        before = len(folded)
        await pilot.press("e", "up", "up")
        assert len(folded) == before
        await pilot.press("l")
        assert len(folded) == before + 1, "once for another filter"
        assert max(folded) <= event_log.MAX_EVENTS
        assert app.is_running


async def test_an_empty_recording_has_a_timeline():
    station = FakeStation()
    station.timeline = FakeTimeline()
    station.timeline.stop_us = station.timeline.now_us = station.timeline.start_us
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("right", "left", "home", "end", "space", "n", "p")
        assert app.is_running
