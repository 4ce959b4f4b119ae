"""Forwarding: untouched, in order, both ways only where allowed, never in a circle, never waiting."""

from __future__ import annotations

import os
import select
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.errors import LinkError
from mavlink.forwarding.forward import Forwarder
from mavlink.protocol.encoder import GCS, NO_AUTOPILOT, MavlinkEncoder
from mavlink.protocol.framing import Framer, checksum
from mavlink.protocol.packet import Auth, Packet
from tests.support.ports import free_port
from tests.support.waiting import until

UAV, ROVER = MavlinkEncoder(1), MavlinkEncoder(7)


class Receiver:
    """A UDP program that frames are forwarded to."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(60.0)

    @property
    def url(self) -> str:
        return f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"

    def get(self, count: int) -> list[bytes]:
        got = []
        for _ in range(count):
            data, self.sender = self.socket.recvfrom(4096)
            got.append(data)
        return got

    def nothing_more(self) -> bool:
        self.socket.settimeout(0.05)
        try:
            self.socket.recvfrom(4096)
        except TimeoutError:
            return True
        return False

    def answer(self, raw: bytes) -> None:
        self.socket.sendto(raw, self.sender)


@pytest.fixture
def receiver():
    made = Receiver()
    yield made
    made.socket.close()


def packets(*frames: bytes, link: int = 0, auth: Auth = Auth.OPEN, peer: int = 1) -> list[Packet]:
    return [Packet(1_000_000 + i, raw, link, peer, auth) for i, raw in enumerate(frames)]


def command(speaker: MavlinkEncoder, target: int, number: int = 400) -> bytes:
    return speaker.pack(dialect.MAVLink_command_long_message(target, 1, number, 0, 1, 0, 0, 0, 0, 0, 0))


def unknown(system_id: int) -> bytes:
    """A message that no dialect here has, with a checksum that may be right."""
    frame = bytes([0xFD, 1, 0, 0, 0, system_id, 1, 0xFF, 0xFF, 0xFF, 1, 0, 0])
    return frame[:-2] + checksum(frame, 7).to_bytes(2, "little")


def nowhere(link: int, raw: bytes, peer: int) -> None:
    raise AssertionError(f"sent to link {link}: {raw.hex()}")


def settle(forwarder: Forwarder, sent: list[tuple[int, bytes, int]], count: int) -> None:
    """Until so many frames of those behind the output have been let back or stopped."""

    def is_settled() -> bool:
        forwarder.forward([], lambda *way: sent.append(way))
        return forwarder.counts[0].returned + forwarder.counts[0].stopped >= count

    assert until(is_settled)


def test_frames_go_out_as_they_came_in_order(receiver):
    signed = MavlinkEncoder(2, key=bytes(range(32))).heartbeat()
    old = MavlinkEncoder(3, version=1).heartbeat()
    frames = [UAV.heartbeat(), signed, old, unknown(1), ROVER.attitude(1, 0.0, 0.1, 0.2)]
    forwarder = Forwarder([receiver.url])
    forwarder.forward(packets(*frames), nowhere)
    assert receiver.get(5) == frames
    assert forwarder.counts[0].sent == 5
    forwarder.close()


def test_what_a_signature_refuses_and_keys_stay_here(receiver):
    key = UAV.pack(dialect.MAVLink_setup_signing_message(1, 1, list(range(32)), 5))
    good = UAV.heartbeat()
    forwarder = Forwarder([receiver.url])
    for auth in (Auth.UNSIGNED, Auth.BAD, Auth.REPLAYED, Auth.FUTURE):
        forwarder.forward(packets(UAV.heartbeat(), auth=auth), nowhere)
    forwarder.forward(packets(key), nowhere)
    forwarder.forward(packets(good, auth=Auth.GOOD), nowhere)
    assert receiver.get(1) == [good]
    assert receiver.nothing_more()
    assert forwarder.counts[0].withheld == 5
    forwarder.close()


def test_refused_packets_on_request_but_never_keys(receiver):
    bad, key = UAV.heartbeat(), UAV.pack(dialect.MAVLink_setup_signing_message(1, 1, [0] * 32, 5))
    forwarder = Forwarder([receiver.url], refused=True)
    forwarder.forward(packets(key, bad, auth=Auth.BAD), nowhere)
    assert receiver.get(1) == [bad]
    forwarder.close()


@pytest.mark.parametrize(
    ("option", "passes"),
    [("", False), ("?ro", False), ("?rw", True), ("?rw=7", True)],
)
def test_only_who_may_write_reaches_a_vehicle(receiver, option, passes):
    forwarder = Forwarder([receiver.url + option], uav=1)
    forwarder.forward(packets(UAV.heartbeat()), nowhere)
    receiver.get(1)
    raw = MavlinkEncoder(255, 190).heartbeat(GCS, autopilot=NO_AUTOPILOT)
    receiver.answer(raw)
    sent: list[tuple[int, bytes, int]] = []
    settle(forwarder, sent, 1)
    assert sent == ([(0, raw, 1)] if passes else [])
    counts = forwarder.counts[0]
    assert (counts.returned, counts.stopped) == ((1, 0) if passes else (0, 1))
    forwarder.close()


def test_a_uav_that_becomes_known_later_is_sent_to_from_then_on(receiver):
    forwarder = Forwarder([receiver.url + "?rw"])
    forwarder.forward(packets(UAV.heartbeat()), nowhere)
    receiver.get(1)
    sent: list[tuple[int, bytes, int]] = []
    for known, sequence in ((False, 1), (True, 2)):
        if known:
            forwarder.set_fleet((1, 7), 1)
        receiver.answer(command(MavlinkEncoder(255, 190), 1))
        settle(forwarder, sent, sequence)
        assert len(sent) == known
    forwarder.close()


def test_addressed_frames_go_only_where_the_target_was_heard(receiver):
    forwarder = Forwarder([receiver.url + "?rw=7,33"], uav=1)
    forwarder.forward(packets(UAV.heartbeat(), link=0) + packets(ROVER.heartbeat(), link=2), nowhere)
    receiver.get(2)
    gcs = MavlinkEncoder(255, 190, key=bytes(32))
    to_uav, to_rover, to_nobody = command(gcs, 1), command(gcs, 7), command(gcs, 33)
    beat = gcs.heartbeat(GCS, autopilot=NO_AUTOPILOT)
    for raw in (to_uav, to_rover, to_nobody, beat):
        receiver.answer(raw)
    sent: list[tuple[int, bytes, int]] = []
    settle(forwarder, sent, 4)
    assert sent == [(0, to_uav, 1), (2, to_rover, 1), (0, beat, 1), (2, beat, 1)]
    assert forwarder.counts[0].stopped == 1
    forwarder.close()


def test_a_target_that_was_only_pretended_is_no_route(receiver):
    forwarder = Forwarder([receiver.url + "?rw"], uav=1)
    forwarder.forward(packets(UAV.heartbeat(), link=0), nowhere)
    forwarder.forward(packets(UAV.heartbeat(), link=5, auth=Auth.BAD), nowhere)
    receiver.get(1)
    raw = command(MavlinkEncoder(255, 190), 1)
    receiver.answer(raw)
    sent: list[tuple[int, bytes, int]] = []
    settle(forwarder, sent, 1)
    assert sent == [(0, raw, 1)]
    forwarder.close()


def test_loops_keys_impostors_and_unknown_messages_are_stopped(receiver):
    forwarder = Forwarder([receiver.url + "?rw"], uav=1, vehicles=(1, 7), own=254)
    out = MavlinkEncoder(60).heartbeat()
    forwarder.forward(packets(UAV.heartbeat()) + packets(out, peer=2), nowhere)
    receiver.get(2)
    gcs = MavlinkEncoder(255, 190)
    passed = gcs.heartbeat(GCS, autopilot=NO_AUTOPILOT)
    for raw in (
        out,  # came from us a moment ago
        MavlinkEncoder(7).heartbeat(),  # a vehicle, which is not behind an output
        MavlinkEncoder(254, 190).heartbeat(),  # ourselves
        gcs.pack(dialect.MAVLink_setup_signing_message(1, 1, [1] * 32, 5)),
        unknown(255),  # nobody knows whom it is for
        passed,
    ):
        receiver.answer(raw)
    sent: list[tuple[int, bytes, int]] = []
    settle(forwarder, sent, 6)
    assert sent == [(0, passed, 1)]
    assert forwarder.counts[0].stopped == 5
    forwarder.close()


def test_what_a_vehicle_repeats_does_not_go_back_to_who_said_it(receiver):
    """Autopilots relay broadcasts between their links: a station's heartbeat comes back from each of them."""
    other = Receiver()
    forwarder = Forwarder([receiver.url + "?rw", other.url], uav=1)
    forwarder.forward(packets(UAV.heartbeat()), nowhere)
    receiver.get(1), other.get(1)
    beat = MavlinkEncoder(255, 190).heartbeat(GCS, autopilot=NO_AUTOPILOT)
    receiver.answer(beat)
    sent: list[tuple[int, bytes, int]] = []
    settle(forwarder, sent, 1)
    forwarder.forward(packets(beat, beat), nowhere)
    assert other.get(1) == [beat]
    assert other.nothing_more() and receiver.nothing_more()
    forwarder.close()
    other.socket.close()


def test_an_output_that_leads_back_to_a_link_rests():
    """The worst mistake: forwarding to the very port that is listened on."""
    link = Receiver()
    forwarder = Forwarder([link.url])
    frames = [UAV.heartbeat() for _ in range(5)]
    forwarder.forward(packets(*frames), nowhere)
    for _ in range(3):
        link.socket.settimeout(0.1)
        try:
            forwarder.forward(packets(*link.get(5)), nowhere)
        except TimeoutError:
            break
    else:
        pytest.fail("it circles")
    assert (forwarder.counts[0].sent, forwarder.counts[0].withheld) == (5, 5)
    forwarder.close()
    link.socket.close()


def test_equal_heartbeats_a_second_apart_all_go_out(receiver):
    """At 256 messages a second a vehicle's heartbeats are equal to the byte."""
    now_s = [0.0]
    forwarder = Forwarder([receiver.url], clock=lambda: now_s[0])
    beat = UAV.heartbeat()
    for k in range(5):
        now_s[0] = float(k)
        forwarder.forward(packets(beat), nowhere)
    assert receiver.get(5) == [beat] * 5
    forwarder.close()


def test_an_old_frame_is_no_echo(receiver):
    now_s = [0.0]
    forwarder = Forwarder([receiver.url + "?rw"], uav=60, clock=lambda: now_s[0])
    frame = MavlinkEncoder(60).heartbeat()
    forwarder.forward(packets(frame), nowhere)
    receiver.get(1)
    sent: list[tuple[int, bytes, int]] = []
    receiver.answer(frame)
    settle(forwarder, sent, 1)
    assert sent == []
    now_s[0] = 5.0
    receiver.answer(frame)
    settle(forwarder, sent, 2)
    assert sent == [(0, frame, 1)]
    forwarder.close()


def test_a_link_that_fails_costs_its_frame_only(receiver):
    forwarder = Forwarder([receiver.url + "?rw"], uav=1)
    forwarder.forward(packets(UAV.heartbeat(), link=0) + packets(UAV.heartbeat(), link=1), nowhere)
    receiver.get(2)
    raw = command(MavlinkEncoder(255, 190), 1)
    receiver.answer(raw)
    sent: list[int] = []

    def send(link: int, raw: bytes, peer: int) -> None:
        if link == 0:
            raise LinkError("unplugged")
        sent.append(link)

    assert until(lambda: forwarder.forward([], send) or sent)
    assert sent == [1]
    forwarder.close()


def test_nobody_there_is_counted_and_waits_for_nobody():
    port = free_port()
    forwarder = Forwarder([f"udpout:127.0.0.1:{port}", f"tcp:127.0.0.1:{port}"])
    for _ in range(200):
        forwarder.forward(packets(UAV.heartbeat()), nowhere)
    udp, tcp = forwarder.counts
    assert udp.dropped > 0 and udp.sent + udp.dropped == 200
    assert tcp.dropped > 0 and tcp.sent + tcp.dropped == 200
    forwarder.close()


def test_a_slow_tcp_receiver_gets_whole_frames_and_the_rest_is_counted():
    port = free_port(socket.SOCK_STREAM)
    now_s = [0.0]
    forwarder = Forwarder([f"tcpin:127.0.0.1:{port}"], clock=lambda: now_s[0])
    client = socket.create_connection(("127.0.0.1", port))
    forwarder.forward([], nowhere)
    frames = [UAV.statustext("x" * 50) for _ in range(200)]
    rounds = 0
    while forwarder.counts[0].dropped == 0 and rounds < 2000:
        now_s[0] += 1.0  # or the same frames would be copies
        forwarder.forward(packets(*frames), nowhere)
        rounds += 1
    assert forwarder.counts[0].dropped > 0
    framer, got = Framer(), 0
    client.settimeout(60.0)
    while got < forwarder.counts[0].sent:
        got += len(framer.receive_bytes(client.recv(1 << 16)))
        forwarder.forward([], nowhere)
    assert framer.counts.bad == framer.counts.junk_bytes == 0
    assert got == forwarder.counts[0].sent > 1000
    dropped = forwarder.counts[0].dropped
    client.close()
    assert until(lambda: forwarder.forward(packets(UAV.heartbeat()), nowhere) or forwarder.counts[0].dropped > dropped)
    forwarder.close()


def test_a_udp_port_serves_whoever_spoke_to_it_first():
    port = free_port()
    forwarder = Forwarder([f"udpin:127.0.0.1:{port}"])
    forwarder.forward(packets(UAV.heartbeat()), nowhere)
    assert forwarder.counts[0].dropped == 1
    program = Receiver()
    program.socket.sendto(b"junk", ("127.0.0.1", port))
    forwarder.forward(packets(UAV.heartbeat()), nowhere)
    program.socket.sendto(MavlinkEncoder(255, 190).heartbeat(), ("127.0.0.1", port))
    raw = UAV.heartbeat()
    forwarder.forward([], nowhere)
    forwarder.forward(packets(raw), nowhere)
    assert program.get(1) == [raw]
    forwarder.close()
    program.socket.close()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals on this system")
def test_a_radio_gets_everything_and_answers_however_often_it_is_looked_at():
    controller, device = os.openpty()
    forwarder = Forwarder([f"{os.ttyname(device)},57600?rw"], uav=1)
    frames, sent = [UAV.heartbeat() for _ in range(5)], []
    for frame in frames:
        forwarder.forward(packets(frame), nowhere)
        forwarder.maintain()
    assert forwarder.counts[0].sent == 5
    framer, received = Framer(), []
    while len(received) < len(frames) and select.select([controller], [], [], 60.0)[0]:
        received += framer.receive_bytes(os.read(controller, 4096))
    assert received == frames
    raw = command(MavlinkEncoder(255, 190), 1)
    os.write(controller, raw)
    settle(forwarder, sent, 1)
    assert sent == [(0, raw, 1)]
    forwarder.close()
    os.close(controller)
    os.close(device)


@pytest.mark.parametrize(
    "out",
    [
        "udpout:127.0.0.1:14551?both",
        "udpout:127.0.0.1:14551?rw=",
        "udpout:127.0.0.1:14551?rw=0",
        "udpout:127.0.0.1:14551?rw=1;2",
        "udpout:127.0.0.1:14551?rw=256",
        "nonsense",
        "udpout:",
        "udpout:127.0.0.1:99999",
    ],
)
def test_bad_outputs_say_what_to_write(out):
    with pytest.raises(LinkError):
        Forwarder([out])


def test_a_port_in_use_closes_what_was_opened():
    taken = Receiver()
    with pytest.raises(LinkError, match="another"):
        Forwarder([taken.url, taken.url.replace("udpout", "udpin")])
    taken.socket.close()
