"""The one way out for all that the station says: only to the UAV, numbered in one row, signed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.errors import LinkError
from mavlink.protocol.encoder import GCS, NO_AUTOPILOT, MavlinkEncoder
from mavlink.protocol.packet import Auth
from mavlink.transmit.transmitter import Transmitter, only_to_uav
from tests.support.frames import UAV, UGV, message, packet_of


def sent_by(uav: int = 1, **changes):
    left: list[tuple[int, int, bytes]] = []
    out = Transmitter(uav, lambda link, peer, raw: left.append((link, peer, raw)), **changes)
    return out, left


GROUND = MavlinkEncoder(254, 190)


@pytest.mark.parametrize(
    ("said", "leaves"),
    [
        (dialect.MAVLink_heartbeat_message(GCS, NO_AUTOPILOT, 0, 0, 0, 3), True),
        (dialect.MAVLink_timesync_message(0, 5), True),
        (dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0), True),
        (dialect.MAVLink_command_long_message(7, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0), False),  # a ground vehicle
        (dialect.MAVLink_command_long_message(0, 0, 400, 0, 0, 0, 0, 0, 0, 0, 0), False),  # everybody
        (dialect.MAVLink_command_long_message(0, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0), False),
        (dialect.MAVLink_ping_message(1, 1, 0, 0), False),
        (dialect.MAVLink_ping_message(1, 1, 1, 1), True),
        (dialect.MAVLink_statustext_message(6, b"hello"), False),
        (dialect.MAVLink_setup_signing_message(1, 1, [0] * 32, 5), False),
        (dialect.MAVLink_set_mode_message(7, 1, 4), False),
    ],
)
def test_only_what_is_for_the_uav_leaves(said, leaves):
    raw = GROUND.pack(said)
    assert only_to_uav(raw, 1) is leaves
    out, left = sent_by()
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, peer=4))
    assert out.send(raw) is leaves
    assert len(left) == out.count == int(leaves)


def test_a_uav_whose_packets_are_held_gets_heartbeats_and_nothing_else():
    beat = GROUND.pack(dialect.MAVLink_heartbeat_message(GCS, NO_AUTOPILOT, 0, 0, 0, 3))
    order = GROUND.pack(dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0))
    out, left = sent_by()
    out.note_packet(packet_of(UGV.heartbeat(), link=1, peer=2, auth=Auth.HELD))
    out.note_packet(packet_of(UAV.heartbeat(2), link=1, peer=3, auth=Auth.BAD))
    assert out.broadcast(beat) == 0
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, peer=4, auth=Auth.HELD))
    assert out.broadcast(beat) == 1 and out.broadcast(order) == 0
    assert not out.send(order) and not out.send(order, 2) and out.links == []
    assert [(link, peer) for link, peer, _ in left] == [(2, 4)]
    # once it is believed, only where that is
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, peer=7))
    assert out.broadcast(beat) == 1 and out.send(order)
    assert [(link, peer) for link, peer, _ in left] == [(2, 4), (2, 7), (2, 7)]


@given(st.integers(0, 255), st.sampled_from(sorted(dialect.mavlink_map)), st.binary(max_size=255))
def test_nothing_addressed_to_a_ground_vehicle_ever_leaves(target, message_id, payload):
    raw = bytes([0xFD, len(payload), 0, 0, 0, 254, 190, *message_id.to_bytes(3, "little")]) + payload + b"\0\0"
    if only_to_uav(raw, 1):
        kind = dialect.mavlink_map[message_id]
        values = kind.unpacker.unpack(payload.ljust(kind.unpacker.size, b"\0")[: kind.unpacker.size])
        assert message_id in (0, 111) or "target_system" in kind.fieldnames
        assert message_id in (0, 111) or 1 in values


@pytest.mark.parametrize(
    "raw", [b"", b"\xfd", b"\xfe" + bytes(20), bytes(12), MavlinkEncoder(254, key=bytes(32)).heartbeat()]
)
def test_what_is_no_plain_frame_does_not_leave(raw):
    out, left = sent_by()
    out.note_packet(packet_of(UAV.heartbeat(2)))
    assert not out.send(raw) and left == []


def test_one_row_of_numbers_signed_recorded_and_sent_to_the_peer():
    record: list[tuple[int, bytes]] = []
    out, left = sent_by(sign=lambda raw, link: raw + b"S", sent=lambda link, raw: record.append((link, raw)))
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, peer=4))
    for _ in range(300):
        assert out.send(GROUND.heartbeat(GCS)) and out.send(MavlinkEncoder(254, 190).timesync(0, 1))
    assert [raw[:-1][4] for _, _, raw in left] == [i % 256 for i in range(600)]
    assert {(link, peer) for link, peer, _ in left} == {(2, 4)}
    assert record == [(link, raw) for link, _, raw in left]
    assert message(left[1][2][:-1]).get_type() == "TIMESYNC", "the checksum is that of the new number"


def test_the_uav_is_spoken_to_where_it_was_heard_last():
    out, left = sent_by()
    beat = GROUND.heartbeat(GCS)
    assert not out.send(beat), "nobody was heard"
    out.note_packet(packet_of(UGV.heartbeat(), link=1))
    out.note_packet(packet_of(UAV.heartbeat(2), link=5, auth=Auth.UNSIGNED))
    assert not out.send(beat)
    out.note_packet(packet_of(UAV.heartbeat(2), link=0, t_us=10_000_000))
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, t_us=11_000_000))
    out.send(beat)
    assert [link for link, _, _ in left] == [2]
    assert out.broadcast(beat) == 2
    out.note_packet(packet_of(UAV.heartbeat(2), link=2, t_us=25_000_000))
    assert out.links == [2], "not heard on the other for long"


def test_heartbeats_alone_announce_us_where_nobody_speaks_first_until_the_uav_is_heard_there():
    out, left = sent_by(announce_on=(3,))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 1 and [(link, peer) for link, peer, _ in left] == [(3, 0)]
    assert out.broadcast(GROUND.timesync(0, 1)) == 0
    assert out.broadcast(GROUND.pack(dialect.MAVLink_command_long_message(1, 1, 400, *[0] * 8))) == 0
    out.note_packet(packet_of(UAV.heartbeat(2), link=3, peer=1))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 1 and left[-1][:2] == (3, 1)
    out.note_packet(packet_of(UAV.heartbeat(2), link=0, t_us=30_000_000))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 2, "silent there, it is looked for again"


def test_a_ground_vehicle_that_answers_is_announced_to_no_more():
    out, left = sent_by(announce_on=(3,))
    out.note_packet(packet_of(UGV.heartbeat(), link=3, auth=Auth.UNSIGNED))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 1, "who is not believed has not answered"
    out.note_packet(packet_of(UGV.heartbeat(), link=3))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 0 and len(left) == 1
    out.note_packet(packet_of(UAV.heartbeat(2), link=3, peer=1))
    assert out.broadcast(GROUND.heartbeat(GCS)) == 1, "a router with both behind it"


def test_a_link_that_cannot_send_is_no_error():
    def fails(link: int, peer: int, raw: bytes) -> None:
        raise LinkError("unplugged")

    out = Transmitter(1, fails)
    out.note_packet(packet_of(UAV.heartbeat(2)))
    assert not out.send(GROUND.heartbeat(GCS)) and out.count == 0
