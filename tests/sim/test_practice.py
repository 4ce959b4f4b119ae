"""Each trouble that an operator practises with does to the frames what it says, and ends again."""

import hashlib
import math
import socket
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim.errors import PlayError
from sim.practice import OF_CAMERAS, TROUBLES, Troubles, parse_trouble
from tests.support.ports import free_port

IDS = (1, 11, 12)


def sent(troubles, seconds=20, system_id=11):
    """What leaves of a vehicle that beats and reports its place: messages of its own, and the impostor's."""
    source = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    parser, own, forged = dialect.MAVLink(None), [], []
    for second in range(seconds):
        for message in (
            dialect.MAVLink_heartbeat_message(10, 3, 128, 10, 4, 3),
            dialect.MAVLink_global_position_int_message(1000 * (60 + second), 10**8 + second * 100, *([0] * 7)),
            dialect.MAVLink_gps_raw_int_message(0, 3, 10**8 + second * 100, 0, 0, 80, 120, 0, 0, 14),
            dialect.MAVLink_attitude_message(1000 * (60 + second), *([0.0] * 6)),
            dialect.MAVLink_system_time_message(10**15, 1000 * (60 + second)),
        ):
            raw = bytes(message.pack(source))
            source.seq = (source.seq + 1) % 256
            for by_impostor, frame in troubles.frames(raw):
                if frame[0] in (0xFD, 0xFE):
                    (forged if by_impostor else own).append(parser.decode(bytearray(frame)))
    return own, forged


def of(kind, messages):
    return [message for message in messages if message.get_type() == kind]


POSITION, STATUS, GPS, FILTER = "GLOBAL_POSITION_INT", "SYS_STATUS", "GPS_RAW_INT", "EKF_STATUS_REPORT"
ALL = 140
"""Messages of twenty seconds."""


def health(status):
    """What is wrong of the sensors that a vehicle uses."""
    return status.onboard_control_sensors_enabled & ~status.onboard_control_sensors_health


def hypot(place):
    """From the place that is sent without a trouble, 1e-7 degrees."""
    return math.hypot(place.lat - 10**8, place.lon)


SHOWS = {
    "charge": lambda own, forged: {m.battery_remaining for m in of(STATUS, own)} == {20},
    "far": lambda own, forged: 15 < len(own) < 60,
    **dict.fromkeys(("unsigned", "signature"), lambda own, forged: len(own) == ALL),
    "stale": lambda own, forged: not of("SYSTEM_TIME", own) and len(own) == ALL - 20,
    "garbled": lambda own, forged: own == [],
    "arming": lambda own, forged: {health(m) for m in of(STATUS, own)} == {dialect.MAV_SYS_STATUS_PREARM_CHECK},
    "battery": lambda own, forged: {m.battery_remaining for m in of(STATUS, own)} == {7},
    "link": lambda own, forged: own == [],
    "loss": lambda own, forged: 50 < len(own) < 110 and len({m.get_seq() for m in own}) == len(own),
    "impostor": lambda own, forged: of(POSITION, forged)[0].lat - of(POSITION, own)[0].lat == 7195,
    "lie": lambda own, forged: of(POSITION, own)[0].lat == 10**8 + 2698,
    "frozen": lambda own, forged: {m.lat for m in of(POSITION, own)} == {10**8},
    "position": lambda own, forged: not of(POSITION, own) and len(own) == ALL - 20,
    "fix": lambda own, forged: {(m.fix_type, m.satellites_visible) for m in of(GPS, own)} == {(1, 4)},
    "satellites": lambda own, forged: {(m.fix_type, m.satellites_visible) for m in of(GPS, own)} == {(3, 4)},
    "filter": lambda own, forged: min(m.pos_horiz_variance for m in of(FILTER, own)) == 2.0,
    "compass": lambda own, forged: min(m.compass_variance for m in of(FILTER, own)) == 2.0,
    "attitude": lambda own, forged: not of("ATTITUDE", own) and len(own) == ALL - 20,
    "clock": lambda own, forged: {m.time_unix_usec for m in of("SYSTEM_TIME", own)} == {10**15 + 60_000_000},
    "reboot": lambda own, forged: of(POSITION, own)[0].time_boot_ms == 0 < of(POSITION, own)[1].time_boot_ms < 2000,
    "sensor": lambda own, forged: {health(m) for m in of(STATUS, own)} == {dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO},
    "text": lambda own, forged: len(of("STATUSTEXT", own)) == 2,
    "video": lambda own, forged: len(own) == ALL,
    "mirror": lambda own, forged: len(own) == ALL,
    "elsewhere": lambda own, forged: 39.0 < 0.0111195 * hypot(of(POSITION, own)[0]) < 41.0,
}


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", TROUBLES)
def test_a_trouble_shows_in_the_frames_of_its_vehicle_alone_and_ends(name):
    troubles = Troubles(IDS)
    said = f"{name} 11" if name not in OF_CAMERAS else name
    troubles.toggle(said)
    assert [troubles.has(each, 1) for each in OF_CAMERAS] == [each == name for each in OF_CAMERAS]
    assert SHOWS[name](*sent(troubles))
    own, forged = sent(troubles, system_id=12)
    assert len(own) == ALL and not forged and of(POSITION, own)[0].lat == 10**8
    if name != "reboot":
        troubles.toggle(said)
    assert not any(troubles.has(each, 1) for each in OF_CAMERAS) and len(sent(troubles)[0]) == ALL


@pytest.mark.parametrize("text", ["", "fire 11", "battery", "battery 99", "battery ²", "lie 11 12"])
def test_no_trouble_is_taken_for_another(text):
    with pytest.raises(ValueError, match=r"there are battery|name one of"):
        parse_trouble(text, IDS)


@pytest.mark.parametrize(
    ("trouble", "signed", "good", "age_s"),
    [
        ("", True, True, 0.0),
        ("unsigned", False, False, 0.0),
        ("signature", True, False, 0.0),
        ("stale", True, True, 300.0),
    ],
)
def test_a_fleet_that_signs_does_so_wrongly_on_request(trouble, signed, good, age_s):
    secret = bytes(range(32))
    troubles = Troubles(IDS, keys={11: secret})
    if trouble:
        troubles.toggle(f"{trouble} 11")
    beat = dialect.MAVLink_heartbeat_message(10, 3, 128, 10, 4, 3)
    frame = next(
        raw for _, raw in troubles.frames(bytes(beat.pack(dialect.MAVLink(None, srcSystem=11, srcComponent=1))))
    )
    assert (len(frame) == 12 + frame[1] + 13) == signed == bool(frame[2] & 1)
    if signed:
        assert (hashlib.sha256(secret + frame[:-6]).digest()[:6] == frame[-6:]) == good
        made_s = 1_420_070_400 + int.from_bytes(frame[-12:-6], "little") * 1e-5
        assert time.time() - made_s == pytest.approx(age_s, abs=5.0)
    other = dialect.MAVLink(None, srcSystem=12, srcComponent=1)
    assert not next(raw for _, raw in troubles.frames(bytes(beat.pack(other))))[2] & 1, "a vehicle without a key"


def test_a_trouble_of_nobody_alone_is_the_whole_fleets():
    assert parse_trouble("elsewhere", IDS) == ("elsewhere", 0) and parse_trouble("mirror", IDS) == ("mirror", 1)
    troubles = Troubles(IDS)
    troubles.toggle("elsewhere")
    own = {system_id: of(POSITION, sent(troubles, system_id=system_id)[0])[0] for system_id in (11, 12)}
    assert own[11].lat != own[12].lat and all(0.0111195 * hypot(place) > 39.0 for place in own.values())


@pytest.mark.parametrize("trouble", ["lie 11", "frozen 11", "fix 11", "elsewhere"])
def test_the_receiver_of_who_is_misled_tells_the_same_place(trouble):
    troubles = Troubles(IDS)
    troubles.toggle(trouble)
    own, _ = sent(troubles)
    places, received = ([(m.lat, m.lon) for m in of(kind, own)] for kind in (POSITION, GPS))
    assert places == received and places[1] != (10**8 + 100, 0)


def test_troubles_come_by_a_port_of_this_computer_and_noise_there_is_passed_over():
    port = free_port()
    troubles = Troubles(IDS, port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        for data in (b"\xff" * 60, b"battery 99", b"", b"video"):
            outlet.sendto(data, ("127.0.0.1", port))
    for _ in range(100):
        troubles.listen()
    assert troubles.has("video", 1)
    with pytest.raises(PlayError, match="cannot be had"):
        Troubles(IDS, port)
    troubles.close()
