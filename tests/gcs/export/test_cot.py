"""Cursor on Target: one event for a box, read back by an XML parser."""

from dataclasses import replace
from datetime import datetime
from xml.etree import ElementTree

import pytest

from gcs.export.cot import CotPacer, cot_boxes, cot_event, cot_uid
from tests.support.fake_station import HOSTILE
from tests.support.snapshots import box, snapshot

PLACE = {"lat_deg": 47.1234567, "lon_deg": -8.5, "place_std_m": 1.234}


def event_of(shown, one, **how):
    return ElementTree.fromstring(cot_event(shown, one, source="2026-11-20_10-33-12Z", **how))


def test_a_named_vehicle_is_a_friend_with_its_evidence():
    named = box(4, 2, **PLACE, runner_up_confidence=0.01, residual_m=0.5)
    event = event_of(snapshot(7, boxes=[named]), named)
    assert (event.get("version"), event.get("type"), event.get("how")) == ("2.0", "a-f-G-E-V", "m-f")
    assert event.find("point").attrib == {
        "lat": "47.1234567",
        "lon": "-8.5000000",
        "hae": "9999999.0",
        "ce": "1.23",
        "le": "9999999.0",
    }
    assert event.find("detail/contact").get("callsign") == "Alpha"
    evidence = event.find("detail/__rollcall").attrib
    assert evidence == {
        "frame": "7",
        "track": "4",
        "system_id": "2",
        "confidence": "0.980",
        "margin": "0.970",
        "residual_m": "0.500",
    }


def test_a_stranger_is_unknown_and_no_vehicle_is_named_in_its_event():
    stranger = box(9, 0, **PLACE, runner_up=2, runner_up_confidence=0.6, none_of_ours=0.4)
    shown = snapshot(boxes=[stranger])
    event = event_of(shown, stranger)
    assert (event.get("type"), event.get("how")) == ("a-u-G-E-V", "m-i")
    assert event.find("detail/contact").get("callsign") == "unknown 9"
    assert set(event.find("detail/__rollcall").attrib) == {"frame", "track", "none_of_ours"}
    assert "Alpha" not in cot_event(shown, stranger, source="s").decode()


def test_times_are_those_of_the_frame_and_it_goes_stale_after_ten_seconds():
    named = box(4, 2, **PLACE)
    shown = snapshot(boxes=[named])
    time, start, stale = (
        datetime.fromisoformat(event_of(shown, named).get(key)).timestamp() for key in ("time", "start", "stale")
    )
    assert time == start == shown.t_us * 1e-6
    assert stale - time == 10.0
    replayed = event_of(shown, named, t_us=1_800_000_000_000_000, opex="s-replay")
    assert replayed.get("time") == "2027-01-15T08:00:00.000Z"
    assert replayed.get("opex") == "s-replay"


def test_only_what_is_seen_tracked_and_placed_is_told():
    told = box(1, 2, **PLACE)
    boxes = [told, box(2, 3, **PLACE, coasting=True), box(0, 0, **PLACE), box(3, 0)]
    assert list(cot_boxes(snapshot(boxes=boxes))) == [told]
    held = replace(snapshot(boxes=boxes), seen_us=1)
    assert list(cot_boxes(held)) == []


def test_an_unknown_deviation_is_not_a_number():
    named = box(4, 2, **PLACE | {"place_std_m": float("nan")})
    assert event_of(snapshot(boxes=[named]), named).find("point").get("ce") == "9999999.0"


@pytest.mark.parametrize("name", HOSTILE)
def test_names_can_neither_break_the_event_nor_carry_control_characters(name):
    named = box(4, 2, **PLACE)
    shown = snapshot(boxes=[named])
    shown = replace(shown, vehicles=tuple(replace(row, name=name) for row in shown.vehicles))
    data = cot_event(shown, named, source=f"{name}/..")
    event = ElementTree.fromstring(data)
    assert [child.tag for child in event.iter()] == ["event", "point", "detail", "contact", "__rollcall"]
    assert event.find("detail/contact").get("callsign").isprintable()
    assert event.get("uid").isascii()
    assert event.get("uid").isprintable()
    assert b"\n" not in data
    assert len(data) < 1400


def test_each_vehicle_is_told_of_once_a_second():
    pacer = CotPacer()
    sent = [t_us for t_us in range(0, 3_000_000, 100_000) if pacer.due("a", t_us)]
    assert sent == [0, 1_000_000, 2_000_000]
    assert pacer.due("b", 100_000)


def test_an_event_is_about_the_same_vehicle_whatever_track_it_has():
    assert cot_uid(box(4, 2), "s") == cot_uid(box(5, 2), "s") == "rollcall.s.vehicle.2"
    assert cot_uid(box(4, 0), "s") == "rollcall.s.track.4"
