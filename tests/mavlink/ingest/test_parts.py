import os
import socket
import sys
import time
from contextlib import closing
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink.forwarding.outputs import OutputCounts
from mavlink.ingest.health import IngestHealth
from mavlink.ingest.health_events import HealthEvents
from mavlink.ingest.ingest_memory import IngestMemory, Slot, make_ingest_memory
from mavlink.ingest.messages import IngestRequest
from mavlink.ingest.plan import Outputs, Plan, Signing
from mavlink.links.base import LinkOptions
from mavlink.links.batch import MIXED, is_one_frame, looks_like_one_frame
from mavlink.links.flood_limiter import STRANGERS, FloodLimit
from mavlink.links.kinds import parse_url
from mavlink.links.report import LinkCounts, LinkReport
from mavlink.links.udp import UdpIn
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.framing import split
from mavlink.protocol.packet import Auth
from tests.support.ports import free_port
from tests.support.receiving import LinkReader, wait_for
from tests.support.waiting import until

HOST = "127.0.0.1"
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's socket filters")
KEY = bytes(range(32))


def udp():
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind((HOST, 0))
    sock.setblocking(False)
    return sock


def arrived(sock):
    got = []
    try:
        while True:
            got.append(sock.recv(4096))
    except BlockingIOError:
        return got


# ---- one frame


@given(st.sampled_from(["v2", "signed", "v1"]), st.integers(0, 60), st.integers(0, 255), st.integers(0, 3))
def test_the_short_check_never_takes_what_the_search_does_not(kind, place, value, extra):
    speaker = MavlinkEncoder(7, version=1 if kind == "v1" else 2, key=KEY if kind == "signed" else None)
    data = bytearray(speaker.heartbeat())
    if place < len(data):
        data[place] = value
    data = bytes(data) + b"\xfd" * extra
    if is_one_frame(data):
        assert split(data)[0] == [data] and split(data)[1].good == 1


def test_the_short_check_takes_whole_frames():
    for speaker in (MavlinkEncoder(7), MavlinkEncoder(7, key=KEY)):
        frame = speaker.heartbeat()
        assert is_one_frame(frame) and looks_like_one_frame(frame)
        assert not any(is_one_frame(frame[:n]) for n in range(len(frame)))
        assert not is_one_frame(frame + b"\0")
    too_long = bytearray(MavlinkEncoder(7).heartbeat())
    too_long[1] = DEFINITIONS[0][0] + 1
    assert not is_one_frame(bytes(too_long))


# ---- links


@LINUX
def test_without_the_batch_call_everything_is_the_same(monkeypatch):
    monkeypatch.setattr("mavlink.links.udp_link.available", lambda: False)
    with udp() as sender:
        port = free_port()
        link = UdpIn(parse_url(f"udpin:{HOST}:{port}"))
        frames = [MavlinkEncoder(k + 1).heartbeat() for k in range(100)]
        for frame in frames:
            sender.sendto(frame, (HOST, port))
            sender.sendto(b"\xfd\xff\x00", (HOST, port))
        batch = link.read_batch()
        while len(batch) < 100 and (more := link.read_batch()).frames:
            batch.frames += more.frames
        assert batch.frames == frames
        assert link.counts.packets == 100 and link.counts.junk_bytes == 300
        link.close()


def test_only_known_systems_make_a_sender_known():
    with udp() as fleet, udp() as stranger:
        port = free_port()
        link = LinkReader(UdpIn(parse_url(f"udpin:{HOST}:{port}"), LinkOptions(system_ids=(1, 2))))
        stranger.sendto(MavlinkEncoder(200).heartbeat(), (HOST, port))
        fleet.sendto(MavlinkEncoder(2).heartbeat(), (HOST, port))
        assert len(wait_for(link, 2)) == 2
        assert list(link.peers.addresses().values()) == [fleet.getsockname()]
        link.close()


# ---- shared memory


@pytest.fixture
def memory():
    fd = make_ingest_memory(4096)
    yield IngestMemory(fd)
    os.close(fd)


def test_packets_come_out_of_the_ring_as_they_went_in(memory):
    frames = [bytes([0xFD, k % 256]) * (k % 60 + 5) for k in range(400)]
    out = []
    for k in range(0, 400, 4):
        some = frames[k : k + 4]
        auths = [Auth.GOOD, Auth.BAD, Auth.OPEN, Auth.FUTURE] if k % 8 else None
        assert memory.put_packets(k % 7, 3 * k, list(range(k, k + 4)), some, [9, 8, 7, 70_000], auths)
        if k % 12 == 0:
            out += memory.take_packets()
    out += memory.take_packets()
    assert [packet.raw for packet in out] == frames and [packet.t_us for packet in out] == list(range(400))
    assert [packet.peer for packet in out[:4]] == [9, 8, 7, 70_000]
    assert [packet.record for packet in out] == [3 * (k - k % 4) + k % 4 for k in range(400)]
    assert [packet.auth for packet in out[4:8]] == [Auth.GOOD, Auth.BAD, Auth.OPEN, Auth.FUTURE]
    assert out[0].auth is Auth.OPEN and out[8].link == 1
    assert memory.take_packets() == []


def test_packets_that_are_not_in_the_log_have_no_number(memory):
    for record in (5, None, 6):
        assert memory.put_packets(0, record, [1, 2], [b"a", b"b"], [1, 1], None)
    assert [packet.record for packet in memory.take_packets()] == [5, 6, -1, -1, 6, 7]


def test_a_full_ring_counts_what_does_not_fit(memory):
    kept = sum(memory.put_packets(0, 7, [1], [b"x" * 68], [1], None) for _ in range(50))
    assert kept == 40 and memory.slots[Slot.OVERRUN] == 10
    assert len(memory.take_packets()) == 40
    assert memory.put_packets(0, 7, [1], [b"x" * 68], [1], None)


def test_how_far_it_has_heard_is_known_once_all_of_that_is_taken(memory):
    assert memory.heard_us() is None
    memory.put_packets(0, 7, [1], [b"x"], [1], None)
    memory.put_received_until(5)
    assert memory.heard_us() is None
    memory.take_packets()
    assert memory.heard_us() == 5


def test_plan_and_health_survive_the_way_between_processes():
    plan = Plan(
        urls=("udpin:0.0.0.0:14550",),
        sockets=(5,),
        memory=3,
        journal=6,
        wake=4,
        log="/tmp/x.tlog",
        system_ids=(1, 2),
        signing=Signing(keys="/keys", unsigned=(109,)),
        outputs=Outputs(urls=("udpout:127.0.0.1:1?ro",), own=255),
    )
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(plan), type=IngestRequest) == plan
    report = LinkReport(
        name="a",
        counts=LinkCounts(packets=3, dropped=1),
        addresses=((1, HOST, 5),),
        claims=((1, 11), (1, 12)),
        mixed=(1,),
        limits=(STRANGE,),
    )
    health = IngestHealth(links=(report,), troubles=("no",))
    again = IngestHealth.decode(health.encode())
    assert again.links == health.links and again.troubles == ("no",)
    total = again.plus((LinkCounts(packets=4, dropped=2, silent_s=9.0),)).links[0].counts
    assert (total.packets, total.dropped) == (7, 3)
    with pytest.raises(ValueError, match="no health"):
        IngestHealth.decode(b"{}")


@LINUX
def test_arrival_is_the_kernels():
    with udp() as sender:
        port = free_port()
        link = UdpIn(parse_url(f"udpin:{HOST}:{port}"))

        def is_stamped():
            before_us = time.time_ns() // 1000
            sender.sendto(MavlinkEncoder(1).heartbeat(), (HOST, port))
            after_us = time.time_ns() // 1000
            time.sleep(0.05)
            times_us = link.read_batch().times_us
            return times_us and before_us <= times_us[0] <= after_us + 1000

        # the kernel begins to stamp some time after the first socket asks for it; until then it stamps when it is read
        with closing(link):
            assert until(is_stamped)


# ---- what is told


STRANGE = FloodLimit(
    address="10.0.0.9:5 and 299 more addresses", system_id=STRANGERS, wanted_per_s=57_312.0, turned_away=7
)


def test_each_change_is_told_once():
    events = HealthEvents()
    link = LinkReport(name="udp", counts=LinkCounts())
    assert events.since_last(IngestHealth(links=(link,))) == []
    lost = replace(link, counts=LinkCounts(dropped=3), limits=(STRANGE,))
    told = events.since_last(IngestHealth(links=(lost,), overrun=7, troubles=("no key",)))
    assert [level for level, _ in told] == ["alarm", "alarm", "alarm", "warning"]
    assert told[0][1] == (
        "udp: strangers flood this port, 57,000 datagrams/s from 10.0.0.9:5 and 299 more addresses; "
        "only few of them are let in"
    )
    assert "3 datagrams were lost" in told[1][1] and told[3][1] == "no key"
    more = replace(lost, limits=(replace(STRANGE, address="10.0.0.8:5", turned_away=1500),))
    assert events.since_last(IngestHealth(links=(more,), overrun=7, troubles=("no key",))) == []
    over = replace(link, counts=LinkCounts(dropped=4), connected=False)
    told = events.since_last(IngestHealth(links=(over,), overrun=15))
    assert told[0] == ("alarm", "udp: lost, trying on") and "about 1,500 datagrams of strangers" in told[1][1]
    assert "15 packets were recorded and not shown" in told[2][1] and len(told) == 3
    assert events.since_last(IngestHealth(links=(replace(over, connected=True),), overrun=15)) == [
        ("info", "udp: back")
    ]


def test_that_nobody_takes_what_is_forwarded_is_told_once_and_when_it_is_taken_again():
    events, told = HealthEvents(), []
    for look in range(200):
        dropped = 8 * min(look, 120)
        told += events.since_last(IngestHealth(outputs=(OutputCounts(name="udpout", sent=look, dropped=dropped),)))
    assert told == [
        ("warning", "udpout: packets are not forwarded: nobody receives there, or too slowly"),
        ("info", "udpout: forwarded again; 960 packets so far were not"),
    ]
    (again,) = events.since_last(IngestHealth(outputs=(OutputCounts(name="udpout", dropped=961),)))
    assert again[0] == "warning"


def test_everybody_who_is_not_let_in_whole_is_told_with_address_reason_and_end():
    events = HealthEvents()
    first = FloodLimit(address="10.0.0.7:5", system_id=11, wanted_per_s=60_123.0, turned_away=1)
    router = FloodLimit(address="10.0.0.7:5", system_id=MIXED, wanted_per_s=9000.0, turned_away=1)
    link = LinkReport(name="udp", counts=LinkCounts(), limits=(first,))
    assert events.since_last(IngestHealth(links=(link,))) == [
        (
            "alarm",
            "udp: 10.0.0.7:5 as system 11 floods this port, 60,000 datagrams/s, or they are forged; "
            "only some are let in",
        )
    ]
    both = replace(link, limits=(replace(first, turned_away=4321), router))
    (told,) = events.since_last(IngestHealth(links=(both,)))
    assert "10.0.0.7:5 in datagrams of several frames floods" in told[1]
    assert events.since_last(IngestHealth(links=(replace(link, limits=(router,)),))) == [
        ("info", "udp: 10.0.0.7:5 as system 11 is let in whole again; about 4,321 datagrams were turned away")
    ]
    refused = replace(first, refused=True, turned_away=99)
    assert events.since_last(IngestHealth(links=(replace(link, limits=(router, refused)),))) == [
        (
            "alarm",
            "udp: 10.0.0.7:5 as system 11 floods this link with packets that are refused; not all of them are recorded",
        )
    ]
    assert events.since_last(IngestHealth(links=(replace(link, limits=(router,)),))) == [
        ("info", "udp: 10.0.0.7:5 as system 11 floods no more; 99 refused packets were not recorded")
    ]
    crowd = tuple(replace(first, address=f"10.0.0.7:{k}") for k in range(300))
    told = events.since_last(IngestHealth(links=(replace(link, limits=crowd),)))
    assert [level for level, _ in told] == ["alarm"] * 6 + ["info"] and told[5][1] == "295 more such senders"


def test_a_connection_that_is_being_made_is_not_lost_and_one_that_flaps_is_told_now_and_then():
    events, told = HealthEvents(), []
    link = LinkReport(name="tcp", counts=LinkCounts(), connected=False)
    for connected in [False] * 5 + [True] * 5:
        told += events.since_last(IngestHealth(links=(replace(link, connected=connected),)))
    assert told == []
    for look in range(200):
        told += events.since_last(IngestHealth(links=(replace(link, connected=look % 3 == 0),)))
    assert 4 <= len(told) <= 20 and told[:2] == [("alarm", "tcp: lost, trying on"), ("info", "tcp: back")]


def test_a_connection_that_is_never_made_is_told_once():
    events, told = HealthEvents(), []
    link = LinkReport(name="tcp", counts=LinkCounts(), connected=False)
    for _ in range(60):
        told += events.since_last(IngestHealth(links=(link,)))
    assert told == [("alarm", "tcp: no connection yet, trying on")]
