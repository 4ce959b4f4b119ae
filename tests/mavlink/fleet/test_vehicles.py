import pytest

from mavlink.protocol.encoder import ARDUPILOT, COPTER, GCS, NO_AUTOPILOT, ROVER, MavlinkEncoder
from mavlink.protocol.modes import fix_name, is_aircraft, is_ground_vehicle, is_vehicle, kind_name, mode_name
from mavlink.reception.packet_loss import SequenceLoss
from tests.support.flights import FIELD, T0, S, World


@pytest.fixture
def world():
    return World(origin=FIELD)


def test_reboot_is_said_and_starts_afresh(world):
    end_us = world.run(5)
    world.booted_us[11] = end_us + S
    world.run(5, start_us=end_us + 2 * S)
    assert [n.text for n in world.notices if n.level == "warning"] == ["system 11 has rebooted"]
    t_us = end_us + 7 * S
    assert world.fleet.at(t_us).p_enu[0, 1] == pytest.approx(world.rover_truth(11, t_us)[1], abs=0.05)


def test_second_sender_of_the_same_id_is_told_and_kept_out(world):
    end_us = world.run(5)
    world.fleet.take_reports()
    stranger = MavlinkEncoder(11)
    told_after = None
    for i in range(25):
        t_us = end_us + i * 200_000
        world.copter(t_us)
        world.rover(11, t_us)
        lat, lon, alt = (float(a) for a in FIELD.to_geodetic([-80.0, 30.0 + i, 0.0]))
        world.feed(stranger.global_position_int(900_000 + i * 200, lat, lon, alt, 0, (5, 0, 0), 0), t_us + 90_000)
        if told_after is None and any("two senders" in n.text for n in world.notices):
            told_after = i * 0.2
    assert told_after is not None and told_after <= 2.0
    assert not world.fleet.at(t_us).valid[0]
    assert world.fleet.at(t_us).vehicles[1].contested
    assert world.fleet.at(t_us).vehicles[1].system_id == 11
    late = world.fleet.take_reports()
    assert (late.t_us[late.system_id == 11] < end_us + 2.2 * S).all()


def test_stations_and_gimbals_are_no_vehicles(world):
    said = world.feed(MavlinkEncoder(255, 190).heartbeat(GCS, autopilot=NO_AUTOPILOT), T0)
    said += world.feed(MavlinkEncoder(1, 154).heartbeat(26, autopilot=NO_AUTOPILOT), T0)
    assert said == ()
    assert world.fleet.at(T0).vehicles[0].kind == ""
    said = world.feed(MavlinkEncoder(42).heartbeat(ROVER), T0) + world.feed(MavlinkEncoder(42).heartbeat(ROVER), T0 + S)
    assert [n.text for n in said] == ["rover 42 is on the air and not in the mission: ignored"]


def test_unknown_messages_touch_nothing(world):
    raw = bytes([0xFD, 3, 0, 0, 77, 11, 1]) + (60_001).to_bytes(3, "little") + b"abc\x12\x34"
    world.run(1)
    before = world.fleet.at(T0 + S)
    assert world.feed(raw, T0 + S) == ()
    assert world.fleet.at(T0 + S).vehicles == before.vehicles


def test_a_fix_that_nobody_reports_is_unknown(world):
    rover = world.speakers[11]
    world.feed(rover.heartbeat(ROVER), T0)
    assert world.fleet.at(T0).vehicles[1].fix == ""
    world.feed(rover.gps_raw_int(0, 0.0, 0.0, 0.0, fix_type=1), T0 + S)
    assert world.fleet.at(T0 + S).vehicles[1].fix == "none"


def test_arming_and_modes_are_said(world):
    rover = world.speakers[11]
    world.feed(rover.heartbeat(ROVER, custom_mode=16, armed=False, status=2), T0)
    said = world.feed(rover.heartbeat(ROVER, custom_mode=4, armed=True), T0 + S)
    assert [n.text for n in said] == ["armed", "mode HOLD"]
    status = world.fleet.at(T0 + S).vehicles[1]
    assert (status.armed, status.mode) == (True, "HOLD")


def test_texts_are_passed_on_without_repetition(world):
    rover = world.speakers[11]
    said = [n for i in range(5) for n in world.feed(rover.statustext("PreArm: [GPS]\x1b", 2), T0 + i * S)]
    assert [(n.kind, n.level, n.text) for n in said] == [("text", "alarm", "PreArm: [GPS]\ufffd")]
    assert world.feed(rover.statustext("PreArm: [GPS]\x1b", 2), T0 + 9 * S)
    assert world.fleet.at(T0).vehicles[1].last_text == "PreArm: [GPS]\ufffd"


def test_long_texts_are_put_together(world):
    rover = world.speakers[11]
    assert world.feed(rover.statustext("a" * 50, text_id=7, chunk=0), T0) == ()
    (notice,) = world.feed(rover.statustext("b" * 10, text_id=7, chunk=1), T0 + 1000)
    assert notice.text == "a" * 50 + "b" * 10


def test_endless_texts_stay_bounded(world):
    rover = world.speakers[11]
    said = [n for i in range(100) for n in world.feed(rover.statustext("x" * 50, text_id=1 + i % 20), T0 + i)]
    assert all(len(n.text) <= 1050 for n in said)


def test_modes_and_kinds_in_words():
    assert mode_name(COPTER, ARDUPILOT, 81, 4) == "GUIDED"
    assert mode_name(ROVER, ARDUPILOT, 81, 4) == "HOLD"
    assert mode_name(ROVER, ARDUPILOT, 81, 15) == "GUIDED"
    assert mode_name(ROVER, ARDUPILOT, 81, 99) == "MODE 99"
    assert mode_name(COPTER, 12, 1, 4 << 16 | 5 << 24) == "RTL"
    assert mode_name(COPTER, 12, 1, 6 << 16) == "OFFBOARD"
    assert mode_name(COPTER, 0, 64, 0) == "MANUAL"
    assert [kind_name(k) for k in (2, 13, 4, 10, 11, 1, 200)] == [
        "copter",
        "copter",
        "helicopter",
        "rover",
        "boat",
        "plane",
        "vehicle",
    ]
    assert is_aircraft(COPTER) and not is_aircraft(ROVER)
    assert is_ground_vehicle(ROVER) and not is_ground_vehicle(COPTER)
    assert not is_vehicle(GCS, NO_AUTOPILOT) and not is_vehicle(18, ARDUPILOT) and is_vehicle(ROVER, 0)
    assert [fix_name(f) for f in (0, 1, 2, 3, 4, 5, 6, 99)] == [
        "none",
        "none",
        "2D",
        "3D",
        "DGPS",
        "RTK float",
        "RTK",
        "none",
    ]


def test_loss_by_sequence_numbers():
    loss = SequenceLoss()
    for seq in range(200):
        if seq % 4:
            loss.add(0, 1, seq)
    assert loss.share == pytest.approx(0.25, abs=0.01)
    two_links = SequenceLoss()
    for seq in range(100):
        two_links.add(0, 1, seq)
        two_links.add(1, 1, (seq + 77) % 256)
    assert two_links.share == 0.0
    reordered = SequenceLoss()
    for seq in (1, 3, 2, 4, 4, 5):
        reordered.add(0, 1, seq)
    assert reordered.share == 0.0
