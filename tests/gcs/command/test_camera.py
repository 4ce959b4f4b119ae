"""Pointing the camera: done when the gimbal is seen to do it, and the way that works is found."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.command import CommandParams, GeoPoint
from gcs.command.executor import PointingMonitor
from gcs.fold.pipeline import Pipeline
from gcs.mission.mission import Camera, Mission, MissionVehicle
from mavlink.geodesy import quaternion_from_euler
from mavlink.protocol.encoder import COPTER
from mavlink.protocol.packet import Auth, Packet
from mavlink.transmit import message_rates as rates
from tests.support.fake_vehicles import PLACE, UAV, UGV, FakeCopter, open_air
from tests.support.frames import MessageEncoder

HEARTBEAT = 0
QUICK = CommandParams(point_s=0.1, lost_s=0.3, see_s=1.2, text_s=0.15)


@pytest.fixture
def air(monkeypatch):
    monkeypatch.setattr(rates, "WINDOW_S", 0.2)
    made = open_air(FakeCopter, QUICK)
    beats, receive = [], made.desk.receive

    def count(packet):
        if (packet.system_id, packet.message_id) == (UAV, HEARTBEAT):
            beats.append(packet)
        receive(packet)

    def clock_s():
        """Ten reports are a second: where they come late, patience is longer."""
        return 0.1 * len(beats)

    monkeypatch.setattr(made.desk, "receive", count)
    monkeypatch.setattr(made.desk._uav, "_clock", clock_s)
    monkeypatch.setattr("gcs.command.executor.time", SimpleNamespace(monotonic=clock_s))
    yield made
    made.close()


def texts(air):
    """What was told of the order, without what it was."""
    return [event.text.partition(": ")[2] for event in air.events if event.text.startswith("Point the camera at UGV-3")]


def looks_at(copter, place):
    """Whether the copter's gimbal is turned to a place on the ground at its home's height."""
    lat, lon, _, relative = copter.place
    north, east = (place.lat_deg - lat) * 111_190, (place.lon_deg - lon) * 111_320 * math.cos(math.radians(lat))
    pitch = math.atan2(-relative, math.hypot(north, east))
    return (
        abs(copter.pitch - pitch) < 0.06 and abs(math.remainder(copter.yaw - math.atan2(east, north), math.tau)) < 0.06
    )


def test_an_order_that_is_accepted_and_does_nothing_is_carried_out_in_the_way_that_works(air):
    air.order("point", UGV, "done: the camera looks there")
    assert air.uav.order(198).param1 == UGV
    assert texts(air)[1].startswith("accepted, but the camera did not move: it looks ")
    assert texts(air)[1].endswith("° off; by the positions received here instead")
    assert texts(air)[2:] == ["accepted; goes on until another order", "done: the camera looks there"]
    assert air.until(lambda: looks_at(air.uav, PLACE))
    asked = [said for said in air.uav.commands(511) if said.param1 == 285]
    assert asked and asked[0].param2 == pytest.approx(100_000), "gimbal reports, ten times a second"
    air.places[UGV] = GeoPoint(47.3970, 8.5450)
    assert air.until(lambda: looks_at(air.uav, air.places[UGV])), "and it goes on"
    assert air.uav.commands(1000) == [], "what works is kept"


def test_an_autopilot_that_hears_the_vehicle_is_left_to_it(air):
    air.uav.hears[UGV] = (PLACE.lat_deg, PLACE.lon_deg, 480.0)
    air.order("point", UGV, "done: the camera looks there; the autopilot follows the positions it receives itself")
    assert air.until(lambda: looks_at(air.uav, PLACE))
    assert air.uav.commands(195) == []


def test_a_camera_that_looked_there_already_and_does_not_follow_is_taken_over(air):
    lat, lon, alt, _ = air.uav.place
    air.uav.place = (lat, lon, alt, 40.0)
    air.uav.pitch = -math.pi / 2
    air.places[UGV] = GeoPoint(lat, lon)
    air.order("point", UGV, "done: the camera looks there; the autopilot follows")
    air.places[UGV] = PLACE
    assert air.until(lambda: any(text.startswith("the camera does not follow: it looks") for text in texts(air)))
    assert air.until(lambda: looks_at(air.uav, PLACE))


def test_a_pilot_who_turns_the_camera_away_is_told_and_not_fought(air):
    air.order("track", UGV, "done: the camera looks there")
    air.uav.obeys = set()
    air.uav._goal = (-1.5, 0.0)
    assert air.until(lambda: any(text.startswith("the camera does not follow: it looks") for text in texts(air)))
    assert air.uav.commands(1000) == [] == air.uav.commands(205)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("obeys", "instead"), [(1000, ["by angles"]), (205, ["by angles", "by angles the older way"])]
)  # fmt: skip
def test_the_next_way_is_tried_until_the_camera_turns(air, obeys, instead):
    air.uav.obeys = {obeys}
    air.order("track", UGV, "done: the camera looks there")
    assert air.until(lambda: looks_at(air.uav, PLACE))
    moved = [text for text in texts(air) if text.startswith("accepted, but the camera did not move")]
    assert [text.rpartition("; ")[2] for text in moved] == [f"{way} instead" for way in instead]
    said = air.uav.commands(obeys)[-1]
    assert (said.get_type(), said.target_system) == ("COMMAND_LONG", UAV)


def test_a_camera_that_nothing_turns_is_told_and_left_alone(air):
    air.uav.obeys = set()
    air.desk.submit("point", UGV)
    assert air.until(
        lambda: texts(air)[-1:] and texts(air)[-1].startswith("accepted, but") and texts(air)[-1][-3:] == "off"
    )
    assert sum("did not move" in text for text in texts(air)) == 4
    count = len(air.uav.commands())
    air.until(lambda: False, 0.5)
    assert len([said for said in air.uav.commands() if said.command != 511]) <= count
    assert not any("done" in text for text in texts(air))


def test_without_gimbal_reports_it_is_said_that_nobody_knows(air):
    air.uav.has_gimbal = False
    air.order("point", UGV, "goes on until another order")
    assert "accepted, but nothing reports where the camera looks; by the positions received here instead" in texts(air)
    assert air.until(lambda: texts(air)[-1] == "accepted, but nothing reports where the camera looks")
    assert air.events[-1].level == "warning"
    count = len(air.uav.commands(195))
    assert air.until(lambda: len(air.uav.commands(195)) > count + 2), "it goes on all the same"


def test_a_slow_gimbal_is_waited_for_while_it_turns():
    look = PointingMonitor(patience_s=2.0, since_s=0.0)
    assert [look.update(math.radians(90 - 5 * k), float(k)) for k in range(15)] == ["not yet"] * 15
    assert look.update(math.radians(14), 15.0) == "done"
    stuck = PointingMonitor(patience_s=2.0, since_s=0.0)
    assert [stuck.update(1.0 + 0.01 * (k % 2), 0.5 * k) for k in range(5)] == ["not yet"] * 4 + ["not moved"]
    silent = PointingMonitor(patience_s=2.0, since_s=0.0)
    assert [silent.update(math.nan, t) for t in (0.0, 1.9, 2.1)] == ["not yet", "not yet", "unknown"]


MISSION = Mission(
    uav=MissionVehicle(system_id=1),
    ugv=(MissionVehicle(system_id=3),),
    camera=Camera(width=640, height=480, fx=500.0, fy=500.0, cx=320.0, cy=240.0, mount="stabilized"),
)


def fold(mission, *, ack=None, gimbal=True, auth=Auth.OPEN, system_id=1, seconds=8):
    """How far east the camera looks at the end, metres on the ground, and what was told; an answer comes after 2 s."""
    pipeline, speaker, t0 = Pipeline(mission), MessageEncoder(1), 1_790_000_000_000_000
    told = []
    for k in range(10 * seconds):
        t_us, boot_ms = t0 + 100_000 * k, 1000 + 100 * k
        frames = [
            speaker.heartbeat(COPTER),
            speaker.attitude(boot_ms, 0.0, 0.0, 0.0),
            speaker.global_position_int(boot_ms, 47.0, 8.0, 540.0, 40.0),
        ]
        if gimbal:  # 60° down to the east
            frames.append(speaker.gimbal_attitude(boot_ms, quaternion_from_euler(0.0, -math.pi / 3, math.pi / 2)))
        for raw in frames:
            pipeline.add_packet(Packet(t_us, raw, 0, 1))
        if ack is not None and k == 20:
            said = dialect.MAVLink_command_ack_message(*ack)
            pipeline.add_packet(Packet(t_us, MessageEncoder(system_id).pack(said), 0, 1, auth))
        snapshot = pipeline.add_frame(k, t_us)
        told += [event for event in snapshot.events if "an order turned the camera" in event.text]
    east_m = float(snapshot.footprint_enu[:, 0].mean() - snapshot.uav_enu[0])
    return east_m, told


EAST_M = 40.0 * math.tan(math.radians(30.0))
"""Where the middle of the frame is, 40 m above ground; its corners are further away on one side than on the other."""


@pytest.mark.slow_but_first
@pytest.mark.parametrize("command", [195, 197, 198, 205, 1000])
def test_once_an_order_turned_the_camera_its_gimbal_is_believed(command):
    east_m, told = fold(MISSION, ack=(command, 0))
    assert east_m == pytest.approx(EAST_M, rel=0.5)
    assert [(event.level, event.text.partition(":")[0]) for event in told] == [("info", "an order turned the camera")]


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"ack": (195, 4)},  # refused
        {"ack": (192, 0)},  # flies, and turns no camera
        {"ack": (195, 0), "auth": Auth.BAD},
        {"ack": (195, 0), "system_id": 3},
    ],
)
def test_else_the_mission_stands(changes):
    east_m, told = fold(MISSION, **changes)
    assert east_m == pytest.approx(0.0, abs=0.1) and told == []


def test_a_camera_that_was_turned_and_reports_nothing_is_an_alarm():
    east_m, told = fold(MISSION, ack=(195, 0), gimbal=False)
    assert east_m == pytest.approx(0.0, abs=0.1)
    assert [event.level for event in told] == ["alarm"] and "do not act on names" in told[0].text
