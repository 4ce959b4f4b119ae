"""Packets rejected for their signature: what is counted, what is reported, and what only looks like a replay."""

import math
import re

import pytest

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.flights import FIELD, T0, UAV, UGV, Air, S, Sender


def test_signatures_are_counted_and_forgeries_reported():
    air = Air(Sender(auth=Auth.GOOD), Sender(peer=2, shift=(-80.0, 0.0), auth=Auth.BAD, seq=9)).run(20)
    status = air.status()
    assert status.signed > 200 and status.unsigned == 0 and status.bad_signature > 200
    assert air.alarms == ["system 11: 3 packets refused, bad signature (udp address 2)"]
    air.run(12)
    assert len(air.alarms) == 2
    assert air.status(12).unsigned > 0 and air.status(12).signed == 0


@pytest.mark.slow
def test_lasting_rejections_are_reported_ever_more_rarely_and_again_after_a_pause():
    fleet, raw = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV).heartbeat()

    def told(start_s, stop_s):
        return sum(bool(fleet.add_packet(Packet(T0 + k * S, raw, 0, 1, Auth.UNSIGNED))) for k in range(start_s, stop_s))

    assert 5 <= told(0, 3600) <= 12
    assert told(4000, 4010) == 1
    air = Air(Sender(), Sender(peer=2, seq=140, phase_us=100_000)).run(100)
    assert sum("two addresses" in notice.text for notice in air.notices) == 1


def test_a_forger_is_reported_at_once_though_unsigned_packets_were_rejected_all_along():
    fleet, raw = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV).heartbeat()
    for k in range(3600):
        fleet.add_packet(Packet(T0 + k * S, raw, 0, 1, Auth.UNSIGNED))
    said = [n.text for k in range(5) for n in fleet.add_packet(Packet(T0 + 3600 * S + k, raw, 0, 2, Auth.BAD))]
    assert said == ["system 11: 3 packets refused, bad signature (link 0 address 2)"]


def test_a_duplicate_of_a_signed_packet_is_no_replay():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    for i in range(10):
        raw = speaker.heartbeat()
        fleet.add_packet(Packet(T0 + i * S, raw, 0, 1, Auth.GOOD))
        assert fleet.add_packet(Packet(T0 + i * S + 5000, raw, 1, 1, Auth.REPLAYED)) == ()
    status = fleet.at(T0 + 10 * S).vehicles[1]
    assert (status.signed, status.bad_signature, status.copies) == (10, 0, 10)


@pytest.mark.parametrize("believed", [Auth.GOOD, Auth.OPEN], ids=["in flight", "in a replay"])
def test_reordered_signed_packets_are_no_replay(believed):
    """ArduPilot signs for all its radios with one counter: what comes over the slower one is older than the newest."""
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    frames = [speaker.attitude(i * 100, 0.0, 0.0, 0.1) for i in range(200)]
    told = []
    for i in range(0, 200, 2):
        told += fleet.add_packet(Packet(T0 + i * S // 10, frames[i + 1], 0, 1, believed))
        told += fleet.add_packet(Packet(T0 + i * S // 10 + 5000, frames[i], 1, 1, Auth.REPLAYED))
    status = fleet.at(T0 + 20 * S).vehicles[1]
    assert (status.signed + status.unsigned, status.bad_signature) == (100, 0)
    (notice,) = [notice for notice in told if "refused" in notice.text]
    assert notice.level == "warning" and "20 signed packets came after newer ones" in notice.text


def test_a_recording_of_minutes_ago_is_a_replay_though_its_packets_were_never_received():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    old = [speaker.attitude(i * 100, 0.0, 0.0, 0.1) for i in range(10)]
    speaker._mav.signing.timestamp += 30 * 100_000
    fleet.add_packet(Packet(T0, speaker.heartbeat(), 0, 1, Auth.GOOD))
    told = [notice for raw in old for notice in fleet.add_packet(Packet(T0 + S, raw, 0, 2, Auth.REPLAYED))]
    assert [notice.level for notice in told] == ["alarm"] and "replayed signature" in told[0].text
    assert fleet.at(T0 + S).vehicles[1].bad_signature == 10


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seconds", [13, 40, 300, 3000])
@pytest.mark.parametrize("per_s", [20, 100_000], ids=["counter that stands still", "time of day"])
def test_a_recording_played_from_elsewhere_is_recognised_however_slowly_the_counter_runs(seconds, per_s):
    """An armed ArduPilot's timestamps grow by 10 µs a packet: those of minutes ago are only milliseconds behind."""
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    frames = []
    for k in range(seconds + 30):
        speaker._mav.signing.timestamp = 10**12 + k * per_s
        frames += [speaker.attitude(k * 1000 + part * 500, 0.0, 0.0, 0.1) for part in range(2)]
        # half of them were lost on the way here, and the recording has them
        fleet.add_packet(Packet(T0 + k * S, frames[-2], 0, 1, Auth.GOOD))
    now = T0 + (seconds + 30) * S
    told = [notice for raw in frames[1:20:2] for notice in fleet.add_packet(Packet(now, raw, 0, 2, Auth.REPLAYED))]
    (notice,) = told
    assert notice.level == "alarm"
    said = re.search(r": a recording made at least (\d+) (s|min) ago is played \(link 0 address 2\)$", notice.text)
    age_s = float(said[1]) * {"s": 1, "min": 60}[said[2]]
    assert min(seconds, 120) <= age_s <= seconds + 60
    status = fleet.at(now).vehicles[1]
    assert (status.replayed, status.bad_signature, status.signs) == (10, 10, False)


def test_a_recording_played_at_the_start_of_a_flight_is_recognised_by_the_vehicles_own_clock():
    """What newer packets say is three seconds old, and the counter has hardly moved in twenty minutes."""
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    beats = [speaker.heartbeat() for _ in range(40)]
    recording = [speaker.attitude(k * 500, 0.0, 0.0, 0.1) for k in range(40)]
    for k in range(30):
        fleet.add_packet(
            Packet(T0 + k * S // 10, speaker.attitude(1_200_000 + k * 100, 0.0, 0.0, 0.1), 0, 1, Auth.GOOD)
        )
    played = [raw for pair in zip(recording, beats, strict=True) for raw in pair]
    told = [
        n for k, raw in enumerate(played) for n in fleet.add_packet(Packet(T0 + 3 * S + k, raw, 0, 2, Auth.REPLAYED))
    ]
    assert [notice.level for notice in told] == ["alarm"]
    assert "a recording made at least 20 min ago is played (link 0 address 2)" in told[0].text
    assert fleet.at(T0 + 3 * S).vehicles[1].replayed == 80


@pytest.mark.parametrize(("late_s", "replayed"), [(10, 0), (13, 5), (20, 5), (23, 5), (60, 5)])
def test_the_same_packets_again_are_duplicates_for_twelve_seconds_and_then_a_recording(late_s, replayed):
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    frames = [speaker.heartbeat() for _ in range(100)]
    for k, raw in enumerate(frames):
        fleet.add_packet(Packet(T0 + k * S, raw, 0, 1, Auth.GOOD))
    now = T0 + 99 * S
    told = [
        n for k in range(5) for n in fleet.add_packet(Packet(now, frames[99 - late_s - k % 2], 0, 2, Auth.REPLAYED))
    ]
    status = fleet.at(now).vehicles[1]
    assert (status.replayed, len(told)) == (replayed, min(replayed, 1))


@pytest.mark.parametrize("late_s", [1, 5, 10])
@pytest.mark.parametrize("per_s", [20, 100_000], ids=["counter that stands still", "time of day"])
def test_a_slower_second_link_is_no_recording(late_s, per_s):
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    told, frames = [], []
    for k in range(200):
        speaker._mav.signing.timestamp = 10**12 + k * per_s
        frames.append([speaker.attitude(k * 1000 + part * 500, 0.0, 0.0, 0.1) for part in range(2)])
        fleet.add_packet(Packet(T0 + k * S, frames[k][1], 0, 1, Auth.GOOD))
        if k >= late_s:
            for raw in frames[k - late_s]:  # one of them was lost on the faster link
                told += fleet.add_packet(Packet(T0 + k * S + 5000, raw, 1, 1, Auth.REPLAYED))
    status = fleet.at(T0 + 200 * S).vehicles[1]
    assert (status.replayed, status.bad_signature) == (0, 0)
    assert {notice.level for notice in told} == {"warning"} and len(told) == 1


def test_signatures_are_good_again_ten_seconds_after_the_last_rejection():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    for k in range(10):
        fleet.add_packet(Packet(T0 + k * S, MavlinkEncoder(UGV).heartbeat(), 0, 1, Auth.UNSIGNED))
    assert not fleet.at(T0 + 9 * S).vehicles[1].signs
    for k in range(10, 30):
        fleet.add_packet(Packet(T0 + k * S, speaker.heartbeat(), 0, 1, Auth.GOOD))
        assert fleet.at(T0 + k * S).vehicles[1].signs == (k >= 19)
    assert not fleet.at(T0 + 60 * S).vehicles[1].signs


def test_held_packets_are_reported_with_their_lag_and_address_until_one_is_accepted():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV, key=bytes(32))
    speaker._mav.signing.timestamp = (T0 - 1_420_070_400 * S) // 10 - 1800 * 100_000
    told = []
    for k in range(100):
        told += fleet.add_packet(Packet(T0 + k * S // 10, speaker.heartbeat(), 0, 2, Auth.HELD))
    assert [notice.text for notice in told] == [
        "system 11: signatures 30 min behind, nothing proves that its packets are made now: held (link 0 address 2)"
    ]
    status = fleet.at(T0 + 10 * S).vehicles[1]
    assert (status.held, round(status.held_s), status.bad_signature) == (100, 1810, 0)
    fleet.add_packet(Packet(T0 + 10 * S, speaker.heartbeat(), 0, 2, Auth.GOOD))
    assert math.isnan(fleet.at(T0 + 10 * S).vehicles[1].held_s)
