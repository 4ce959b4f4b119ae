"""Why a vehicle is a box, why not, and since when; any box can be picked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.health.vehicle_alarms import CONTRADICTED
from gcs.snapshot import Alarm, Candidate
from gcs.tui.draw.format import standing_of_row
from gcs.tui.draw.mosaic import fit
from gcs.tui.framing import frame_for
from gcs.tui.palette import INK
from gcs.tui.panes.advice import UNHEARD, what_to_do
from gcs.tui.panes.fleet import FleetPane
from gcs.tui.panes.identity import IdentityPane, _columns, expected_place
from gcs.tui.panes.video import VideoPane
from mavlink.state import VehicleCondition
from tests.support.fake_station import WIDE, FakeStation, make_snapshot, polled, running, text_of

SNAPSHOT = replace(make_snapshot(), pose="known")
UNNAMED = next(box for box in SNAPSHOT.boxes if box.track_id == 21)
CANDIDATES = (
    Candidate(system_id=15, confidence=0.34, distance_m=9.8, against="too far: up to 2.4 m is usual"),
    Candidate(system_id=11, confidence=0.02, distance_m=31.0, against="another box has its name (97%)"),
    Candidate(system_id=17, confidence=0.0, against="no position for 12 s"),
)


def changed(**change):
    """The snapshot with its unnamed box changed."""
    boxes = tuple(replace(box, **change) if box.track_id == 21 else box for box in SNAPSHOT.boxes)
    return replace(SNAPSHOT, boxes=boxes)


def row_of(system_id, **change):
    return replace(next(row for row in SNAPSHOT.vehicles if row.system_id == system_id), **change)


async def test_keys_go_through_vehicles_and_then_unnamed_boxes():
    async with running(size=WIDE) as (app, pilot, _):
        await pilot.press("up")
        assert (app.selected, app.picked_track) == (0, 21)
        assert "track 21" in text_of(app.query_one(IdentityPane))
        await pilot.press("up")
        assert (app.selected, app.picked_track) == (17, 0)
        await pilot.press("down", "down")
        assert (app.selected, app.picked_track) == (1, 0)
        await pilot.press("up", "escape")
        assert (app.selected, app.picked_track) == (0, 0)


async def test_a_click_picks_a_box_without_a_name():
    async with running(size=WIDE) as (app, pilot, _):
        pane = app.query_one(VideoPane)
        width, height = pane.size.width, pane.size.height - 1
        part = frame_for(SNAPSHOT, (0, 0), width / (2 * height))
        left, top, columns, rows = fit(*part.rect[2:], width, height)
        x, y = UNNAMED.cx - part.rect[0], UNNAMED.cy - part.rect[1]
        column, row = left + x * columns / part.rect[2], top + y * rows / part.rect[3]
        await pilot.click(pane, offset=(round(column), 1 + round(row)))
        assert (app.selected, app.picked_track) == (0, 21)


async def test_an_unnamed_box_shows_its_candidates_and_what_speaks_against_each():
    snapshot = changed(candidates=CANDIDATES, none_of_ours=0.64, since_us=SNAPSHOT.t_us - 8_000_000)
    async with running(FakeStation(snapshot=snapshot), size=WIDE) as (app, pilot, _):
        await pilot.press("up")
        said = text_of(app.query_one(IdentityPane))
        assert "no name for 8.0s" in said
        for words in (
            "34%",
            "9.8 m",
            "2.4 m is usual",
            "another box has its name (97%)",
            "no position for 12 s",
            "64%",
        ):
            assert words in said.replace("\n", " "), words
        assert "none of ours" in said and "█" in said


async def test_an_unnamed_box_says_which_missing_vehicle_it_may_be():
    missing = replace(CANDIDATES[0], missing="no position for 27 s")
    snapshot = changed(candidates=(missing,), none_of_ours=0.64, doubt="a vehicle of ours is not accounted for")
    async with running(FakeStation(snapshot=snapshot), size=WIDE) as (app, pilot, _):
        await pilot.press("up")
        said = " ".join(text_of(app.query_one(IdentityPane)).split())
        assert f"against may be {SNAPSHOT.name_of(15)}: no position for 27 s" in said


async def test_candidates_can_be_read_on_a_small_screen():
    snapshot = changed(candidates=CANDIDATES, none_of_ours=0.64)
    async with running(FakeStation(snapshot=snapshot)) as (app, pilot, _):
        await pilot.press("up")
        assert "34% ██▊       9.8 m" in text_of(app.query_one(IdentityPane))
        await pilot.press("i", "z")
        said = " ".join(text_of(app.query_one(IdentityPane)).split())
        assert "UGV-15 34%" in said and "too far: up to 2.4 m is usual" in said and "no position for 12 s" in said


async def test_a_picked_box_that_gets_a_name_is_picked_as_its_vehicle():
    async with running(size=WIDE) as (app, pilot, station):
        await pilot.press("up")
        station.snapshot = changed(system_id=15, confidence=0.95)
        await polled(app, pilot)
        assert (app.selected, app.picked_track) == (15, 0)


async def test_a_picked_box_that_is_gone_is_said_to_be_gone():
    async with running(size=WIDE) as (app, pilot, station):
        await pilot.press("up")
        station.snapshot = replace(SNAPSHOT, boxes=SNAPSHOT.boxes[:2])
        await polled(app, pilot)
        assert "gone" in text_of(app.query_one(IdentityPane))


async def test_standings_say_since_when():
    rows = tuple(replace(row, standing_since_us=SNAPSHOT.t_us - 12_000_000) for row in SNAPSHOT.vehicles)
    async with running(FakeStation(snapshot=replace(SNAPSHOT, vehicles=rows)), size=WIDE) as (app, pilot, _):
        await pilot.press("down", "down")
        assert "confirmed 97% for 12s" in text_of(app.query_one(IdentityPane))


@pytest.mark.parametrize(
    ("px", "words"),
    [
        ((-40.0, 100.0), "left of the picture"),
        ((1400.0, 900.0), "below and right of the picture"),
        ((4000.0, 900.0), "far below and right of the picture"),
        ((600.0, -7.0), "above the picture"),
        ((1200.0, 30.0), "in the picture at the upper right, where no box is"),
        ((640.0, 30.0), "in the picture at the top, where no box is"),
        ((640.0, 330.0), "in the middle of the picture, where no box is"),
        ((UNNAMED.cx, UNNAMED.cy), "in the picture at the upper right, where track 21 is"),
        (None, "behind the camera: the picture does not show it"),
    ],
)
def test_a_vehicle_without_a_box_says_where_it_should_be(px, words):
    assert expected_place(SNAPSHOT, row_of(15, expected_px=px)) == words


def test_nobody_says_where_one_is_that_doubts_its_own_position():
    row = row_of(15, expected_px=(640.0, -519.0), doubted_for="receiver and estimate are apart")
    assert expected_place(SNAPSHOT, row) == "not known: it doubts its own position"


async def test_all_that_speaks_against_a_vehicle_is_told_since_one_may_be_why_there_is_another():
    raised = [
        Alarm(key=key, level="alarm", kind=kind, text=f"UGV-15: {text}", advice="", since_us=1, system_id=15)
        for key, kind, text in (("silent 15", "vehicle", "no heartbeat"), ("signature 15", "link", "wrong signature"))
    ]
    async with running(FakeStation(snapshot=replace(SNAPSHOT, alarms=tuple(raised))), size=WIDE) as (app, _, _):
        app.selected = 15
        assert "no heartbeat; wrong signature" in " ".join(text_of(app.query_one(IdentityPane)).split())


async def test_no_new_frame_is_said_for_as_long_as_none_came():
    row = row_of(15, standing="no new frame", standing_since_us=SNAPSHOT.t_us)
    rows = tuple(row if each.system_id == 15 else each for each in SNAPSHOT.vehicles)
    late = replace(SNAPSHOT, vehicles=rows, frame_us=SNAPSHOT.t_us - 8_000_000)
    async with running(FakeStation(snapshot=late), size=WIDE) as (app, _, _):
        app.selected = 15
        assert "no new frame for 8.0s" in text_of(app.query_one(IdentityPane))


async def test_the_fleet_in_numbers_has_the_words_of_its_table():
    unheard = {"position_state": "never", "heartbeat_age_s": math.inf, "position_age_s": math.inf, "loss": math.nan}
    unheard |= {"condition": VehicleCondition(), "refusals": {}, "signed": 0, "standing": "no position"}
    rows = tuple(row_of(each.system_id, **unheard) if each.system_id > 15 else each for each in SNAPSHOT.vehicles)
    async with running(FakeStation(snapshot=replace(SNAPSHOT, vehicles=rows)), size=WIDE) as (app, _, _):
        assert "never heard  2" in text_of(app.query_one(IdentityPane))


def test_a_vehicle_that_was_never_heard_says_so_and_not_that_its_receiver_fails():
    silent = dict.fromkeys(("heartbeat_age_s", "position_age_s"), math.inf) | {"loss": math.nan, "signed": 0}
    silent |= {"condition": VehicleCondition(), "refusals": {}}
    row = row_of(15, standing="no position", position_state="never", **silent)
    assert expected_place(SNAPSHOT, row) == "not known: never heard"
    assert what_to_do(replace(SNAPSHOT, alarms=()), row) == UNHEARD
    assert standing_of_row(row) == "never heard"
    assert standing_of_row(replace(row, bad_signature=3)) == "refused"
    assert standing_of_row(replace(row, heartbeat_age_s=0.5)) == "no position"


def test_the_nearest_camera_is_to_turn_to_a_vehicle_that_none_shows():
    uav, *rest = SNAPSHOT.vehicles
    row = row_of(rest[0].system_id, standing="out of view")
    second = replace(uav, system_id=2, name="North", p_enu=row.p_enu + np.array([3.0, 4.0, 40.0]))
    both = replace(SNAPSHOT, vehicles=(uav, second, row))
    assert what_to_do(replace(both, vehicles=(uav, row)), row) == "turn or move the camera there"
    assert what_to_do(both, row) == "turn or move the camera there: North is nearest, 5.0 m away"
    assert what_to_do(both, replace(row, elsewhere=("North",))) == "nothing: another camera shows it"


def test_where_no_box_is_is_not_said_without_a_new_frame():
    row = row_of(15, expected_px=(1200.0, 30.0), standing="no new frame")
    assert expected_place(SNAPSHOT, row) == "not known: the picture is old"


def test_where_a_vehicle_should_be_may_be_unknown():
    row = row_of(15, expected_px=None)
    assert expected_place(replace(SNAPSHOT, pose="unknown"), row) == "not known: the camera's pose is unknown"
    assert "no usable position" in expected_place(SNAPSHOT, replace(row, position_state="refused"))


async def test_the_pane_of_a_vehicle_without_a_box_says_which_box_it_may_be():
    rows = tuple(replace(row, expected_px=(1200.0, 30.0)) if row.system_id == 15 else row for row in SNAPSHOT.vehicles)
    snapshot = replace(changed(candidates=CANDIDATES), vehicles=rows)
    async with running(FakeStation(snapshot=snapshot), size=WIDE) as (app, pilot, _):
        await pilot.press(*["down"] * 6)
        said = " ".join(text_of(app.query_one(IdentityPane)).split())
        assert app.selected == 15
        assert "upper right, where no box is" in said and "track 21: 34%, 9.8 m" in said and "2.4 m is usual" in said


async def test_a_reason_is_said_once_of_a_vehicle():
    lies = Candidate(
        system_id=15, confidence=0.45, distance_m=30.3, against=f"{CONTRADICTED}, none of ours is likelier"
    )
    alarm = Alarm(
        key="conflict 15",
        level="alarm",
        kind="identity",
        text=f"UGV-15: {CONTRADICTED}",
        advice="",
        since_us=SNAPSHOT.t_us,
        system_id=15,
        doubts_name=True,
    )
    snapshot = replace(changed(candidates=(lies,)), alarms=(alarm,), conflicts=frozenset({15}))
    async with running(FakeStation(snapshot=snapshot), size=WIDE) as (app, pilot, _):
        await pilot.press(*["down"] * 6)
        said = " ".join(text_of(app.query_one(IdentityPane)).split())
    assert app.selected == 15 and said.count(CONTRADICTED) == 1
    assert "should be not known" in said and "45%, 30.3 m away, none of ours is likelier" in said


@pytest.mark.parametrize(("later_s", "words"), [(0, "gone: no longer in the picture"), (12, "no new frame for 12s")])
async def test_a_picked_box_is_gone_only_where_there_is_a_frame_without_it(later_s, words):
    now_us = SNAPSHOT.t_us + later_s * 1_000_000
    snapshot = replace(SNAPSHOT, t_us=now_us, seen_us=SNAPSHOT.t_us, boxes=())
    async with running(size=WIDE) as (app, pilot, station):
        await pilot.press("up")
        station.snapshot = snapshot
        await polled(app, pilot)
        assert words in text_of(app.query_one(IdentityPane))


def test_where_a_vehicle_that_lies_should_be_is_not_known():
    row, snapshot = row_of(16), replace(SNAPSHOT, conflicts=frozenset({16}))
    assert expected_place(snapshot, row) == "not known: its position contradicts the video"


async def test_of_a_provisional_place_nobody_says_never_nor_since_when():
    """It is worked out from the last seconds before it alone."""
    unheard = {"position_state": "never", "heartbeat_age_s": math.inf, "position_age_s": math.inf, "loss": math.nan}
    unheard |= {"condition": VehicleCondition(), "refusals": {}, "signed": 0, "standing": "no position"}
    row = row_of(15, **unheard, standing_since_us=SNAPSHOT.t_us - 4_700_000)
    rows = tuple(row if each.system_id == 15 else each for each in SNAPSHOT.vehicles)
    for provisional, words in ((False, "never heard for 4.7s"), (True, "not heard")):
        place = replace(SNAPSHOT, vehicles=rows, provisional=provisional)
        async with running(FakeStation(snapshot=place), size=WIDE) as (app, _, _):
            app.selected = 15
            said = " ".join((text_of(app.query_one(IdentityPane)) + text_of(app.query_one(FleetPane))).split())
            assert words in said and ("never" in said) is not provisional
            assert ("4.7s" in said) is not provisional
            app.query_one(IdentityPane).named_for = {15: 0.0}
            for app.selected in (15, 0):
                said = text_of(app.query_one(IdentityPane))
                assert ("never yet" in said or "ever named" in said) is not provisional


async def test_how_long_a_battery_lasts_is_on_the_card_once_its_vehicle_is_picked():
    lasts = VehicleCondition(voltage_v=12.4, charge=0.81, left_s=840.0, power_age_s=0.4)
    rows = tuple(replace(row, condition=lasts) for row in SNAPSHOT.vehicles)
    async with running(FakeStation(snapshot=replace(SNAPSHOT, vehicles=rows)), size=WIDE) as (app, pilot, _):
        await pilot.press("down", "down")
        assert "battery      81% 12.4 V 14m left" in text_of(app.query_one(IdentityPane))


@pytest.mark.parametrize(("provisional", "never", "yet"), [(False, True, True), (True, False, False)])
async def test_of_a_provisional_place_no_candidate_was_never_heard(provisional, never, yet):
    candidates = (
        Candidate(system_id=15, confidence=0.5, missing="never heard", against="never heard"),
        Candidate(system_id=17, confidence=0.2, missing="no position yet", against="no position yet"),
    )
    place = replace(changed(candidates=candidates, none_of_ours=0.3), provisional=provisional, alarms=())
    async with running(FakeStation(snapshot=place), (160, 60)) as (app, pilot, _):
        app._pick(0, 21)
        await pilot.pause()
        said = " ".join(text_of(app.query_one(IdentityPane)).split())
        assert ("may be UGV-15: never heard" in said) is never and ("no position yet" in said) is yet
        assert ("may be UGV-15: not heard" in said) is provisional and "no position" in said


@pytest.mark.parametrize(
    ("frozen", "words"), [(False, ("no position", "lost 12s")), (True, ("same place", "same 12s"))]
)
async def test_a_position_that_stands_still_is_not_called_lost(frozen, words):
    gone = {"standing": "no position", "position_state": "lost", "position_age_s": 12.0, "frozen": frozen}
    rows = tuple(replace(row, **gone) if row.system_id == 14 else row for row in SNAPSHOT.vehicles)
    async with running(FakeStation(snapshot=replace(SNAPSHOT, vehicles=rows, alarms=())), WIDE) as (app, pilot, _):
        app._pick(14, 0)
        await pilot.pause()
        row = next(line for line in text_of(app.query_one(FleetPane)).splitlines() if "UGV-14" in line)
        card = text_of(app.query_one(IdentityPane))
        assert words[0] in row and words[1] in row and words[1] in card
        other = ("lost 12s", "same 12s")[not frozen]
        assert other not in row + card


async def test_while_nothing_is_picked_the_card_tells_who_is_not_named_and_why():
    silent = Alarm(
        key="s", level="alarm", kind="vehicle", text="UGV-14: no heartbeat", advice="go there", since_us=0, system_id=14
    )
    lost = {"standing": "no position", "position_state": "lost"}
    rows = {14: lost, 15: {"standing": "unidentified", "expected_px": (20.0, 20.0)}, 16: {"elsewhere": ("North",)}}
    vehicles = tuple(replace(row, **rows.get(row.system_id, {})) for row in SNAPSHOT.vehicles)
    place = replace(SNAPSHOT, vehicles=vehicles, alarms=(silent,))
    async with running(FakeStation(live=True, snapshot=place), size=(160, 60)) as (app, pilot, station):
        facts = [" ".join(row.split()) for row in text_of(app.query_one(IdentityPane)).splitlines()]
        told = [fact for fact in facts if fact.startswith("UGV-")]
        assert told[0] == "UGV-14 no heartbeat"
        assert told[1].startswith("UGV-15 in the picture at the upper left, where no")
        assert "do UGV-14: no heartbeat: go there" in facts
        assert not any(fact.startswith(("UGV-11", "UGV-16")) for fact in told), "it is named, it is seen elsewhere"
        many = tuple(replace(vehicles[1], **lost, system_id=n, name=f"UGV-{n}") for n in range(20, 30))
        station.snapshot = replace(place, vehicles=(vehicles[0], *many), alarms=())
        await polled(app, pilot)
        said = text_of(app.query_one(IdentityPane))
        assert "UGV-25" in said and "UGV-26" not in said and "and 4 more" in said


def test_of_two_columns_of_facts_none_runs_into_the_other():
    facts = [("refused", "10 altitude, far from the rest", INK), ("loss", "0%", INK), ("from the UAV", "9.1 m", INK)]
    rows = [strip.text for strip in _columns(facts, 64, 2)]
    assert [len(row) for row in rows] == [64, 64]
    assert "10 altitude, … " in rows[0] and rows[0].split("…")[1].split() == ["from", "the", "UAV", "9.1", "m"]
    assert rows[1].split() == ["loss", "0%"]
