"""Nineteen things that real autopilots do, seen on ArduCopter and ArduRover 4.6, played through this program.

Frames go as bytes through framing (and, where it matters, a socket), signing and the fleet.
"""

import math
import random
import socket

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.decode import decode
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import COPTER, GCS, NO_AUTOPILOT, ROVER
from mavlink.protocol.framing import Framer, checksum, split
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.keys import Key, KeyRing
from mavlink.signing.streams import ticks_of
from mavlink.signing.verifier import Verifier
from mavlink.transmit.rate_requests import interval_answer
from tests.support.flights import FIELD, T0, S
from tests.support.frames import MessageEncoder
from tests.support.ports import free_port
from tests.support.receiving import open_reader, wait_for

COPTER_ID, ROVER_ID = 1, 2
BANNER = [b"\n\nInit ArduCopter V4.6.0-dev (00000000)\n\nFree RAM: 131072\n", b"0 ", b"AP_Logger_File: open\n", b"*"]


class Flight:
    """A fleet of copter 1 and rovers 2 and 3 that hears datagrams, and the vehicles' voices."""

    def __init__(self, **options):
        self.fleet = Fleet(COPTER_ID, [ROVER_ID, 3], **options)
        self.speakers = {i: MessageEncoder(i) for i in (COPTER_ID, ROVER_ID, 3)}
        self.notices = []

    def hear(self, data, t_us, peer=1, link=0, auth=Auth.OPEN):
        """One datagram; the number of good frames in it."""
        frames, counts = split(data)
        for raw in frames:
            self.notices += self.fleet.add_packet(Packet(t_us, raw, link, peer, auth))
        return counts.good

    def place(self, system_id, t_us, boot_ms, **fields):
        """GLOBAL_POSITION_INT as on the wire, moving north at 4 m/s, the copter standing at 40 m."""
        flies = system_id == COPTER_ID
        north = 0.0 if flies else 4.0 * (t_us - T0) * 1e-6
        lat, lon, alt = FIELD.to_geodetic([10.0 * system_id, north, 40.0 if flies else 0.0])
        truth = {"lat": round(float(lat) * 1e7), "lon": round(float(lon) * 1e7), "alt": round(float(alt) * 1e3)}
        truth |= {"relative_alt": 40_000 if flies else 0, "vx": 0 if flies else 400, "vy": 0, "vz": 0, "hdg": 0}
        message = dialect.MAVLink_global_position_int_message(boot_ms, **(truth | fields))
        return self.speakers[system_id].pack(message)

    def drive(self, start_us, seconds, system_id=ROVER_ID, booted_us=T0 - 60 * S, peer=1, link=0, **fields):
        """Five positions and one heartbeat a second of one vehicle."""
        kind = COPTER if system_id == COPTER_ID else ROVER
        for tick in range(int(seconds * 5)):
            t_us = start_us + tick * 200_000
            if tick % 5 == 0:
                self.hear(self.speakers[system_id].heartbeat(kind, custom_mode=4), t_us, peer, link)
            self.hear(self.place(system_id, t_us, (t_us - booted_us) // 1000, **fields), t_us, peer, link)
        return start_us + int(seconds * S)

    def texts(self, level=None):
        return [n.text for n in self.notices if level in (None, n.level)]

    def status(self, t_us, system_id=ROVER_ID):
        return next(v for v in self.fleet.at(t_us).vehicles if v.system_id == system_id)


@pytest.fixture
def flight():
    return Flight(origin=FIELD)


def north(flight, t_us):
    return float(flight.fleet.at(t_us).p_enu[0, 1])


def test_01_plain_text_at_boot_and_between_frames():
    port = free_port()
    link = open_reader(f"udpin:127.0.0.1:{port}")
    speaker, rng = MessageEncoder(ROVER_ID), random.Random(1)
    datagrams = BANNER * 4
    for k in range(60):
        datagrams += [speaker.heartbeat(ROVER)] + ([b"Init Gyro", b"*"] if k % 5 == 0 else [])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in datagrams:
            sender.sendto(data, ("127.0.0.1", port))
        assert len(wait_for(link, 60)) == 60
    link.close()
    framer = Framer()  # the same as a byte stream, in pieces of any size
    stream, frames = b"".join(datagrams), []
    while stream:
        cut = rng.randint(1, 40)
        frames += framer.receive_bytes(stream[:cut])
        stream = stream[cut:]
    assert len(frames + framer.finish()) == 60 and framer.counts.bad == 0


def test_02_a_copter_that_sends_nothing_but_heartbeats(flight):
    for k in range(16):
        flight.hear(flight.speakers[COPTER_ID].heartbeat(COPTER), T0 + k * S)
    flight.hear(flight.speakers[COPTER_ID].timesync(0, 10_011_827_001), T0 + 16 * S)
    status = flight.status(T0 + 16 * S, COPTER_ID)
    assert (status.kind, status.position_state, status.heartbeat_age_s) == ("copter", "never", 1.0)
    assert math.isinf(status.position_age_s) and not flight.fleet.at(T0 + 16 * S).uav.position_valid


def test_03_positions_before_there_is_one(flight):
    rover = flight.speakers[ROVER_ID]
    for k in range(15):
        t_us, boot_ms = T0 + k * 500_000, 1000 + k * 500
        flight.hear(rover.attitude(boot_ms, 0, 0, math.radians(0.13)), t_us)
        flight.hear(flight.place(ROVER_ID, t_us, boot_ms, lat=0, lon=0, alt=20, vx=0, hdg=13), t_us)
    status = flight.status(t_us)
    assert dict(status.refusals) == {"no fix (0/0)": 15} and status.position_state == "never"
    assert flight.texts("warning") == [] and len(flight.fleet.take_reports()) == 0
    end_us = flight.drive(t_us + S, 3, booted_us=T0 - S, hdg=4400)  # 44 degrees off while driving north
    state = flight.fleet.at(end_us)
    assert state.valid[0] and math.isnan(state.heading[0])
    end_us = flight.drive(end_us, 4, booted_us=T0 - S)
    assert flight.fleet.at(end_us).heading[0] == pytest.approx(0.0)


def test_04_a_rover_at_sea_level_until_its_filter_starts(flight):
    flight.drive(T0 - 2 * S, 1, COPTER_ID)
    ends_us = [flight.drive(T0, 3, alt=0)]
    ends_us.append(flight.drive(ends_us[-1], 3, alt=583_900, relative_alt=583_800))
    ends_us.append(flight.drive(ends_us[-1], 3, alt=0))
    for end_us in ends_us:
        now_us = end_us - 100_000
        flight.drive(now_us, 0.2, COPTER_ID)
        state = flight.fleet.at(now_us)
        assert state.p_enu[0] == pytest.approx([20.0, 4.0 * (now_us - T0) * 1e-6, 0.0], abs=0.2)
    assert dict(flight.status(now_us).refusals) == {"altitude, far from the ground": 30}
    assert flight.status(now_us).refused == 0 and not any("jump" in text for text in flight.texts())


def test_05_payloads_are_cut_wherever_they_end_in_zeros(flight):
    rng, lengths = random.Random(5), set()
    for k in range(300):
        values = [rng.choice([0, 1, 200, -1]) if k else 0 for _ in range(4)]
        rest = [rng.choice([0, -1, 3]) if k else 0 for _ in range(3)] + [rng.choice([0, 200, 9000]) if k else 0]
        message = dialect.MAVLink_global_position_int_message(5 * k % 255, *values, *rest)
        raw = flight.speakers[ROVER_ID].pack(message)
        lengths.add(raw[1])
        sample = decode(Packet(T0, raw))
        assert (sample.lat_deg, sample.alt_m) == pytest.approx((values[0] * 1e-7, values[2] * 1e-3))
        assert split(raw)[0] == [raw] and split(raw)[1].good == 1
    assert {1, 28} <= lengths and len(lengths) > 8


def test_06_the_nose_is_not_the_course(flight):
    flight.drive(T0, 6, hdg=18_000)  # north in reverse: nose south
    state = flight.fleet.at(T0 + 6 * S)
    assert state.heading[0] == pytest.approx(math.pi) and state.v_enu[0, 1] == pytest.approx(4.0)
    for k in range(30):  # the copter drifts backward and sideways
        lat, lon, _ = FIELD.to_geodetic([0.3 * k, -0.4 * k, 40.0])
        place = {"lat": round(float(lat) * 1e7), "lon": round(float(lon) * 1e7), "vx": -200, "vy": 150}
        flight.hear(flight.place(COPTER_ID, T0 + k * 200_000, 60_000 + k * 200, **place), T0 + k * 200_000)
    assert dict(flight.status(T0 + 6 * S, COPTER_ID).refusals) == {}


def test_07_local_positions_have_no_common_origin_and_are_not_used(flight):
    end_us = flight.drive(T0, 3)
    before = north(flight, end_us)
    for system_id in (ROVER_ID, 3):
        local = dialect.MAVLink_local_position_ned_message(63_000, 500.0, 0.0, 0.0, 4.0, 0.0, 0.0)
        assert flight.hear(flight.speakers[system_id].pack(local), end_us) == 1
    assert north(flight, end_us) == before
    assert flight.status(end_us, 3).position_state == "never"


def test_08_armed_is_a_bit_and_modes_depend_on_the_vehicle(flight):
    rover, copter = flight.speakers[ROVER_ID], flight.speakers[COPTER_ID]
    said = []
    for armed, status, mode in ((False, 2, 16), (False, 4, 0), (True, 3, 4), (True, 4, 15)):
        flight.hear(rover.heartbeat(ROVER, armed=armed, status=status, custom_mode=mode), T0 + len(said) * S)
        row = flight.status(T0 + len(said) * S)
        said.append((row.armed, row.mode))
    assert said == [(False, "INITIALIZING"), (False, "MANUAL"), (True, "HOLD"), (True, "GUIDED")]
    flight.hear(copter.heartbeat(COPTER, custom_mode=4), T0)
    assert flight.status(T0, COPTER_ID).mode == "GUIDED"


def test_09_the_gimbal_is_told_by_the_autopilot_itself(flight):
    copter = flight.speakers[COPTER_ID]
    half = math.sqrt(0.5)
    for k in range(20):
        t_us, boot_ms = T0 + k * 100_000, 60_000 + k * 100
        flight.hear(copter.attitude(boot_ms, 0, 0, 0.5), t_us)
        flight.hear(flight.place(COPTER_ID, t_us, boot_ms), t_us)
        flight.hear(copter.gimbal_attitude(boot_ms, (half, 0, -half, 0), flags=44), t_us)
        flight.hear(copter.pack(dialect.MAVLink_terrain_request_message(-353_630_000, 1_491_650_000, 100, 1)), t_us)
    uav = flight.fleet.at(t_us).uav
    assert uav.R_enu_gimbal[:, 0] == pytest.approx([0, 0, -1], abs=1e-6)
    assert [v.kind for v in flight.fleet.at(t_us).vehicles] == ["", "", ""]  # no heartbeat, so no vehicle yet


def test_10_one_counter_for_each_link_and_two_vehicles_with_one_id(flight):
    radio = MessageEncoder(ROVER_ID)
    radio._mav.seq = 120
    for k in range(60):
        t_us = T0 + k * 200_000
        flight.hear(flight.place(ROVER_ID, t_us, 60_000 + k * 200), t_us, link=0)
        flight.hear(radio.attitude(60_050 + k * 200, 0, 0, 0), t_us + 50_000, link=1)
    status = flight.status(t_us)
    assert [channel.loss for channel in status.channels] == [0.0, 0.0] and status.loss == 0.0
    assert not status.contested
    other, began_us = MessageEncoder(ROVER_ID), t_us
    other._mav.seq = 60
    for k in range(15):  # another vehicle with the same id on the same port: another type, another boot clock
        t_us += 200_000
        if k % 5 == 0:
            flight.hear(flight.speakers[ROVER_ID].heartbeat(ROVER), t_us, 1)
            flight.hear(other.heartbeat(COPTER), t_us + 30_000, 2)
        flight.hear(flight.place(ROVER_ID, t_us, 72_000 + k * 200), t_us, 1)
        flight.hear(other.attitude(9_000 + k * 200, 0, 0, 1.0), t_us + 60_000, 2)
    alarm = next(n for n in flight.notices if n.level == "alarm")
    assert alarm.t_us - began_us <= 2 * S and "two senders use system id 2" in alarm.text
    assert flight.status(t_us).position_state == "contested"


def test_11_boot_clocks_of_their_own_and_a_wrong_idea_of_unix_time(flight):
    rng = np.random.default_rng(11)
    drift = 148e-6
    for k in range(1300):
        t_us = T0 + k * 100_000
        boot_ms = int((t_us - T0) / (1 + drift) / 1000) + 48_000
        arrival_us = t_us + int(rng.gamma(1.5, 3000))
        flight.hear(flight.place(ROVER_ID, t_us, boot_ms), arrival_us)
        if k % 10 == 0:
            unix_us = 0 if k < 75 else t_us - 700_000
            flight.hear(flight.speakers[ROVER_ID].system_time(boot_ms, unix_us), arrival_us)
    status = flight.status(t_us)
    assert status.drift_ppm == pytest.approx(148, abs=25)
    assert status.clock_error_s == pytest.approx(-0.7, abs=0.03)
    assert north(flight, t_us) == pytest.approx(4.0 * (t_us - T0) * 1e-6, abs=0.06)
    assert flight.texts() == [] and not status.clock_fault  # neither is out of the ordinary


def test_12_clock_readings_are_exchanged(flight):
    rover = flight.speakers[ROVER_ID]
    drift, booted_us = 400e-6, T0 - 48 * S
    flight.hear(rover.timesync(0, 10_011_827_002), T0)  # its own question, with its id in the last digits
    assert math.isnan(flight.status(T0).round_trip_s)
    for k in range(13):
        sent_us = T0 + k * 10 * S
        boot_ns = int((sent_us + 3000 - booted_us) / (1 + drift) * 1000)
        flight.hear(rover.timesync(boot_ns, sent_us * 1000), sent_us + 6000)
        flight.hear(rover.timesync(boot_ns, 77_000_000_000), sent_us + 7000)  # answer to another station's clock
    status = flight.status(sent_us)
    assert status.round_trip_s == pytest.approx(0.006)
    assert status.drift_ppm == pytest.approx(400, abs=5)
    assert status.clock_fault == "it runs 400 ppm slow" and flight.texts() == []


def test_13_texts_come_in_repetitions_and_one_piece(flight):
    rover = flight.speakers[ROVER_ID]
    for k in range(6):
        for text in ("Mission: 3 WP", "Mission: 3 WP"):
            flight.hear(rover.statustext(text), T0 + k * 10 * S)
    flight.hear(rover.statustext("PreArm: " + "x" * 40), T0 + 70 * S)
    assert flight.texts() == ["Mission: 3 WP"] * 6 + ["PreArm: " + "x" * 40]


def test_14_answers_to_commands_name_who_asked(flight):
    rover = flight.speakers[ROVER_ID]
    for result, asker, expected in ((0, 254, 0), (4, 254, 4), (0, 255, None)):
        ack = dialect.MAVLink_command_ack_message(511, result, 0, 0, asker, 190)
        raw = rover.pack(ack)
        assert interval_answer(Packet(T0, raw), 254) == expected
        assert flight.hear(raw, T0) == 1 and flight.notices == []


def test_15_missions_are_asked_for_the_old_way_and_are_none_of_ours(flight):
    end_us = flight.drive(T0, 2)
    before = flight.fleet.at(end_us).p_enu
    rover, told = flight.speakers[ROVER_ID], len(flight.notices)
    for message in (
        dialect.MAVLink_mission_request_message(255, 190, 0),
        dialect.MAVLink_mission_ack_message(255, 190, 4),
        dialect.MAVLink_mission_current_message(3),
    ):
        assert flight.hear(rover.pack(message), end_us) == 1
    assert len(flight.notices) == told and np.array_equal(flight.fleet.at(end_us).p_enu, before, equal_nan=True)


def test_16_a_reboot_comes_from_another_port(flight):
    end_us = flight.drive(T0, 8, peer=1)
    for data in BANNER:
        assert flight.hear(data, end_us + S, peer=2) == 0
    flight.speakers[ROVER_ID] = MessageEncoder(ROVER_ID)
    again_us = end_us + 1_300_000
    last_us = flight.drive(again_us, 5, booted_us=end_us, peer=2) - 200_000
    assert flight.texts("warning") == ["system 2 has rebooted"] and flight.texts("alarm") == []
    assert north(flight, last_us) == pytest.approx(4.0 * (last_us - T0) * 1e-6, abs=0.1)
    assert [channel.peer for channel in flight.status(last_us).channels] == [1, 2]


def test_17_what_vehicles_relay_makes_no_vehicle(flight):
    station, synthetic = MessageEncoder(255, 230), MessageEncoder(COPTER_ID, 190)
    flight.drive(T0, 1, COPTER_ID, peer=9)
    for k in range(10):
        beat = station.heartbeat(GCS, autopilot=NO_AUTOPILOT)
        for peer in (1, 2, 3, 4):
            flight.hear(beat, T0 + k * S + peer * 1000, peer)
        name = b"SERIAL0_PROTOCOL"
        flight.hear(synthetic.pack(dialect.MAVLink_param_value_message(name, 2.0, 9, 1000, k)), T0 + k * S, 4)
    assert flight.texts() == ["copter 1 is there, GUIDED"]
    assert flight.status(T0 + 10 * S, COPTER_ID).kind == "copter" and not flight.texts("alarm")
    keyed = Verifier(KeyRing(keys={i: Key(bytes([i]) * 32) for i in (1, 2, 3)}))
    assert keyed.check(Packet(T0, beat)) is Auth.UNSIGNED  # a relayed station, where all have to sign


def test_18_mavlink_1_and_2_from_the_same_vehicle(flight):
    old = flight.speakers[ROVER_ID] = MessageEncoder(ROVER_ID, version=1)
    end_us = flight.drive(T0, 3)
    old._mav.seq, flight.speakers[ROVER_ID] = old._mav.seq, MessageEncoder(ROVER_ID)
    flight.speakers[ROVER_ID]._mav.seq = old._mav.seq
    end_us = flight.drive(end_us, 3)
    zeros = [0] * 8
    version = (0, 0, 0, 0, 0, zeros, zeros, zeros, 0, 0, 0xBEEF, [7] * 18)
    raw = old.pack(dialect.MAVLink_autopilot_version_message(*version))
    raw = bytes([raw[0], 60]) + raw[2:66]  # without the fields that MAVLink 1 does not have
    flight.hear(raw + checksum(raw, DEFINITIONS[148][1]).to_bytes(2, "little"), end_us)
    assert flight.status(end_us).hardware == "beef"  # the long id is cut off
    flight.hear(flight.speakers[ROVER_ID].pack(dialect.MAVLink_autopilot_version_message(*version)), end_us)
    assert flight.status(end_us).hardware == "07" * 18
    assert flight.status(end_us).loss == 0.0 and not flight.status(end_us).contested
    assert north(flight, end_us) == pytest.approx(4.0 * (end_us - T0) * 1e-6, abs=0.1)


def test_19_signed_a_minute_ahead_and_nothing_else_is_believed(flight):
    secret = bytes(range(32))
    checker = Verifier(KeyRing(keys={ROVER_ID: Key(secret)}), steady_ns=lambda: 0)
    ahead = MessageEncoder(ROVER_ID, key=secret)
    ahead._mav.signing.timestamp = ticks_of(T0) + 5_995_000
    forged, unsigned = MessageEncoder(ROVER_ID, key=bytes(32)), MessageEncoder(ROVER_ID)
    forged._mav.signing.timestamp = ticks_of(T0)
    for k in range(20):
        for speaker in (ahead, forged, unsigned):
            kind = ROVER if speaker is ahead else COPTER
            packet = Packet(T0 + k * S, speaker.heartbeat(kind), 0, 1)
            verdict = checker.check(packet)
            flight.notices += flight.fleet.add_packet(Packet(packet.t_us, packet.raw, 0, 1, verdict))
    status = flight.status(T0 + 20 * S)
    assert (status.signed, status.unsigned, status.bad_signature) == (20, 20, 20)
    assert status.kind == "rover" and not status.contested
    assert [text for text in flight.texts("alarm")] == [
        "system 2: 3 packets refused, bad signature (link 0 address 1)",
        "system 2: 3 packets refused, no signature (link 0 address 1)",
    ]
