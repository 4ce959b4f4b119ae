"""Orders end to end: MAVSDK, our way out, a UAV that answers and ground vehicles that must never hear a thing."""

from __future__ import annotations

import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.command import ORDERS, CommandParams, GeoPoint
from gcs.command.ack import CommandAck
from gcs.command.orders import orders_about
from mavlink.protocol.packet import Auth, Packet
from tests.support.fake_vehicles import PLACE, UAV, UGV, FakeVehicle, open_air

QUICK = CommandParams(point_s=0.05, fly_s=0.05, lost_s=0.3, settle_s=0.3, see_s=0.4, text_s=0.15)


@pytest.fixture
def air():
    """A UAV, two ground vehicles and a desk between them."""
    made = open_air(FakeVehicle, QUICK)
    yield made
    made.close()


def test_point_asks_the_autopilot_first_to_follow_the_vehicle(air):
    events = air.order("point", UGV, "accepted")
    said = air.uav.order(198)
    assert (said.get_type(), said.param1, said.target_system) == ("COMMAND_LONG", 3.0, 1)
    assert events[-1].text.startswith("Point the camera at UGV-3: accepted")
    assert (events[-1].kind, events[-1].level, events[-1].system_id) == ("operator", "warning", 3)


@pytest.mark.parametrize("result", [3, 4])
def test_point_streams_positions_when_the_autopilot_cannot(air, result):
    air.uav.results[198] = result
    air.order("point", UGV, "by the positions received here instead")
    assert air.until(lambda: len(air.uav.commands(195)) >= 2)
    air.places[UGV] = GeoPoint(47.3990, 8.5470)
    assert air.until(lambda: air.uav.commands(195)[-1].x == 473990000)
    first = air.uav.commands(195)[0]
    assert (first.get_type(), first.frame, first.x, first.y) == ("COMMAND_INT", 0, 473980000, 85460000)
    assert first.z == pytest.approx(480.0), "the ground at home: 520 m less 40 m"
    assert any(event.text.endswith("goes on until another order") for event in air.events)
    air.order("unpoint", 0, "accepted")
    count = len(air.uav.commands(195))
    air.until(lambda: False, 0.3)
    assert len(air.uav.commands(195)) <= count + 1
    assert any(event.text == "Point the camera at UGV-3: ended by another order" for event in air.events)


def test_a_denied_pointing_is_not_tried_in_another_way(air):
    air.uav.results[198] = 2
    events = air.order("point", UGV, "refused")
    assert events[-1].text == "Point the camera at UGV-3: refused (DENIED)" and events[-1].level == "warning"
    assert air.uav.commands(195) == []


def test_a_stream_waits_without_a_position_and_ends_after_a_while(air):
    air.order("track", UGV, "goes on")
    del air.places[UGV]
    assert air.until(lambda: any("waits" in event.text for event in air.events))
    count = len(air.uav.commands(195))
    assert air.until(lambda: any("ended: no position" in event.text for event in air.events))
    assert len(air.uav.commands(195)) <= count + 1
    assert [event.level for event in air.events if "ended" in event.text] == ["alarm"]


def test_above_and_follow_go_to_the_vehicle_at_the_present_height(air):
    air.order("above", UGV, "accepted")
    said = air.uav.order(192)
    assert (said.x, said.y, said.z, said.param1, said.param2) == (473980000, 85460000, 520.0, -1.0, 1.0)
    assert said.param4 != said.param4, "the heading is left to the vehicle"
    before = len(air.uav.commands(192))
    air.order("follow", UGV, "goes on")
    air.places[UGV] = GeoPoint(47.3995, 8.5475)
    assert air.until(lambda: air.uav.commands(192)[-1].x == 473995000)
    followed = air.uav.commands(192)[before:]
    changes = [said.param2 for said in followed]
    assert changes == sorted(changes, reverse=True) and set(changes) == {1.0, 0.0}, "the mode is changed at first only"
    assert {said.z for said in followed} == {520.0}


def test_following_ends_when_a_pilot_takes_over(air):
    air.uav.rule = lambda said: 2 if said.command == 192 and not said.param2 and air.uav.mode != 4 else 0
    air.order("follow", UGV, "goes on")
    air.uav.mode = 5
    assert air.until(lambda: any("ended" in event.text for event in air.events))
    count = len(air.uav.commands(192))
    air.until(lambda: False, 0.3)
    assert len(air.uav.commands(192)) <= count + 1
    assert air.uav.mode == 5, "it was not taken back"


def test_following_ends_by_the_mode_even_when_goals_are_still_accepted(air):
    air.order("follow", UGV, "goes on")
    settled = 2 + round(QUICK.settle_s / QUICK.fly_s)
    assert air.until(lambda: len(air.uav.commands(192)) >= settled)
    air.uav.mode = 5
    assert air.until(lambda: any("flight mode was changed to LOITER" in event.text for event in air.events))


def test_orbit_and_its_middle_that_drives_on(air):
    air.order("orbit", UGV, "accepted")
    first, count = air.uav.order(34), len(air.uav.commands(34))
    assert (first.x, first.y, first.z, first.param1) == (473980000, 85460000, 520.0, 20.0)
    air.until(lambda: False, 0.3)
    assert len(air.uav.commands(34)) == count, "the middle stands still"
    air.places[UGV] = GeoPoint(47.3981, 8.5460)
    assert air.until(lambda: air.uav.commands(34)[-1].x == 473981000)
    assert air.uav.commands(192) == []


def test_orbit_point_by_point_where_it_is_not_known(air):
    air.uav.results[34] = 3
    air.order("orbit", UGV, "point by point")
    assert air.until(lambda: len(air.uav.commands(192)) >= 4)
    for said in air.uav.commands(192):
        north_m = (said.x / 1e7 - PLACE.lat_deg) * 111_200
        east_m = (said.y / 1e7 - PLACE.lon_deg) * 111_200 * 0.677
        assert (north_m**2 + east_m**2) ** 0.5 == pytest.approx(20.0, rel=0.02)


def test_hold_return_camera_and_gimbal(air):
    for key, number, params in (
        ("hold", 176, (1, 17, 0)),  # BRAKE
        ("return", 20, (0, 0, 0)),
        ("unpoint", 197, (0, 0, 0)),
        ("take", 1001, (254, 190, -1)),
        ("release", 1001, (-3, -3, -3)),
        ("photo", 2000, (0, 0, 1)),
        ("record", 2500, (0, 0, 0)),
        ("record_stop", 2501, (0, 0, 0)),
    ):
        air.order(key, 0, "accepted")
        said = air.uav.commands(number)[-1]
        assert (said.param1, said.param2, said.param3) == params, key
        assert (said.get_type(), said.target_system, said.target_component) == ("COMMAND_LONG", 1, 1)
    air.order("photo", 0, "accepted")
    numbers = list(dict.fromkeys(said.param4 for said in air.uav.commands(2000)))
    assert numbers == [1.0, 2.0], "no second photo for a repeated command"


def test_neutral_falls_back_to_the_older_command(air):
    air.order("neutral", 0, "accepted")
    assert air.uav.commands(1000)[0].param5 == 2.0 and air.uav.commands(205) == []
    air.uav.results[1000] = 3
    air.order("neutral", 0, "accepted")
    assert air.uav.commands(205)[0].param7 == 1.0


def test_a_refusal_shows_the_autopilots_own_words(air):
    air.uav.results[20] = 4
    air.uav.texts[20] = "Mode change failed: RTL requires position"
    air.uav.progress[20] = 30
    events = air.order("return", 0, "refused")
    assert events[-1].text == (
        "Let UAV-1 return to launch: refused (FAILED at 30 %): Mode change failed: RTL requires position"
    )
    assert events[-1].level == "warning" and events[-1].system_id == UAV


def test_no_answer_is_told_after_repeats(air):
    air.uav.rule = lambda said: None
    events = air.order("photo", 0, "no answer")
    assert events[-1].level == "warning"
    assert len(air.uav.commands(2000)) >= 3 and {said.param4 for said in air.uav.commands(2000)} == {1.0}


def test_an_unknown_autopilot_is_not_told_to_hold(air):
    air.uav.kind = 12
    air.until(lambda: air.desk._uav.kind == "sub")
    events = air.order("hold", 0, "not sent")
    assert "not sent" in events[-1].text and air.uav.commands(176) == []


def test_without_a_height_or_a_place_nothing_is_sent(air):
    air.places.clear()
    assert "not known" in air.order("above", UGV, "not sent")[-1].text
    air.places[UGV] = PLACE
    air.uav.place = (0.0, 0.0, 0.0, 0.0)
    assert air.until(lambda: air.desk._uav.alt_m != air.desk._uav.alt_m)
    assert "height" in air.order("follow", UGV, "not sent")[-1].text
    assert air.uav.commands(192) == []


def test_everything_sent_is_recorded_and_in_one_row(air):
    air.order("photo", 0, "accepted")
    assert air.until(lambda: len(air.uav.heard) >= 6)
    air.desk.close()
    assert air.recorded == air.sock.sent
    assert [raw[4] for raw in air.recorded] == [i % 256 for i in range(len(air.recorded))]
    kinds = {said.get_type() for said in air.uav.heard}
    assert {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"} <= kinds


def test_a_hung_station_falls_silent_though_mavsdk_lives(air):
    """Nothing but the caller's loop beats: MAVSDK's own heartbeats never leave."""
    assert air.until(lambda: any(said.get_type() == "HEARTBEAT" for said in air.uav.heard))

    def beats():
        return sum(Packet(0, raw).message_id == 0 for raw in air.sock.sent)

    before = beats()
    time.sleep(2.2)
    assert beats() == before > 0


def test_what_mavsdk_asks_by_itself_reaches_the_uav_only(air):
    """It asks every system it hears for messages; it hears the UAV alone."""
    assert air.until(lambda: any(said.command == 512 for said in air.uav.commands()))
    assert {said.target_system for said in air.uav.commands()} == {UAV}


def test_what_is_not_believed_commands_nothing(air):
    before = air.desk._uav.alt_m
    bad = Packet(1, b"\xfd", auth=Auth.BAD)
    air.desk.receive(bad)
    assert air.desk._uav.alt_m == before


def test_who_holds_the_gimbal_is_told(air):
    for holder in ((0, 0), (255, 190), (255, 190), (254, 190)):
        air.uav.say(dialect.MAVLink_gimbal_manager_status_message(1, 0, 1, *holder, 0, 0))
        assert air.until(lambda holder=holder: air.desk._uav.gimbal_holder == holder)
        air.desk._look_s = 0.0
        air.desk.poll()
    said = [event.text for event in air.events if event.kind == "camera"]
    assert said == [
        "the gimbal of UAV-1 is controlled by no station",
        "the gimbal of UAV-1 is controlled by system 255 component 190",
        "the gimbal of UAV-1 is controlled by this station",
    ]


def test_orders_name_their_target_and_need_one(air):
    about = dict(air.desk.orders(UGV))
    assert about["point"] == "Point the camera at UGV-3"
    assert about["hold"] == "Let UAV-1 stop and hold its position"
    assert len(about) == len(ORDERS)
    alone = dict(air.desk.orders(0))
    assert set(alone) == {order.key for order in orders_about(ugv=False)} and "point" not in alone
    assert dict(air.desk.orders(UAV)) == alone
    with pytest.raises(ValueError, match="ground vehicle"):
        air.desk.submit("point", 99)
    with pytest.raises(KeyError):
        air.desk.submit("self_destruct", 0)


def test_answers_in_words():
    assert CommandAck(result=0).words == "accepted"
    assert CommandAck(result=2, progress=30, texts=("a", "a", "b")).words == "refused (DENIED at 30 %): a; b"
    assert CommandAck(result=99).words == "refused (result 99)"
    assert CommandAck(result=None).words == "no answer"
    assert CommandAck(result=None, reason="UAV not received").words == "UAV not received"


def test_an_end_in_the_middle_of_a_command_is_clean(air):
    air.uav.rule = lambda said: None
    air.desk.submit("photo", 0)
    assert air.until(lambda: air.uav.commands(2000))
    air.desk.close()
    assert not air.desk._thread.is_alive()
    for packet in air.sock.packets():
        air.desk.receive(packet)
    air.desk.poll()
    with pytest.raises(ValueError, match="ended"):
        air.desk.submit("photo", 0)
    air.desk.close()
