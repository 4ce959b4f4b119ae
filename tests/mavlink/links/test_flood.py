"""Floods of strangers, of senders who claim to be a known vehicle, and of junk from its own address, which anybody can
forge: what comes through, in packets into a socket, with a clock that goes on only when the test says so."""

import itertools
import random
from contextlib import ExitStack

import pytest

from mavlink.links.base import LinkOptions
from mavlink.links.fair_shares import HOLD_S, SENDER_BURST_S, SENDER_PER_S
from mavlink.links.flood_limiter import TICK_S
from mavlink.links.kinds import parse_url
from mavlink.links.udp import UdpIn
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.ports import free_port, needs_socket_filters, udp_socket
from tests.support.receiving import HOST

FEW = 150
"""Datagrams that any system's receive buffer holds."""


class Field:
    """Eight vehicles that send at a steady rate, and others who may do so from the same ports."""

    RATE = 10  # of each, a tick

    def __init__(self, stack, *, keys=False):
        self.now_s, self.keys = 1000.0, keys
        self.port = free_port()
        url = parse_url(f"udpin:{HOST}:{self.port}")
        options = LinkOptions(system_ids=range(11, 19), trusts_checksums=not keys)
        self.link = UdpIn(url, options, clock_s=lambda: self.now_s)
        self.link._span_s = lambda: 0.0  # the kernel's stamps follow another clock than this test's
        stack.callback(self.link.close)
        self.sockets = {k: stack.enter_context(udp_socket()) for k in range(11, 19)}
        self.speakers = {k: MavlinkEncoder(k) for k in self.sockets}
        self.sent = dict.fromkeys(self.sockets, 0)
        self.heard = dict.fromkeys(self.sockets, 0)
        self.of_flood = self.waiting = 0
        self.mine = set()
        self.limits = []
        self.modes = itertools.count(1)
        self.stack = stack

    def tick(self, flood=()):
        """A tenth of a second: ``flood`` is pairs of socket and datagram, sent between the vehicles' frames."""
        flood = list(flood)
        self.mine = set()
        for part in range(self.RATE):
            for sock, data in flood[part :: self.RATE]:
                self.put(sock, data)
            for k, sock in self.sockets.items():
                frame = self.speakers[k].heartbeat(custom_mode=next(self.modes))
                self.mine.add(frame)
                self.sent[k] += 1
                self.put(sock, frame)
            self.take()
        self.now_s += TICK_S
        self.link.maintain()
        self.limits.append({(limit.address, limit.system_id) for limit in self.link.limits()})

    def put(self, sock, data):
        sock.sendto(data, (HOST, self.port))
        self.waiting += 1
        if self.waiting >= FEW:
            self.take()

    def take(self):
        self.waiting = 0
        while (batch := self.link.read_batch()).frames:
            verified = set()
            for peer_number, raw in zip(batch.peers, batch.frames, strict=True):
                if raw in self.mine:
                    self.heard[raw[5]] += 1
                    verified.add((peer_number, raw[5]))
                else:
                    self.of_flood += 1
            if self.keys and verified:
                self.link.trust(verified, 0)

    def lost(self, k):
        return self.sent[k] - self.heard[k]


def bad(frame):
    return frame[:-1] + bytes([frame[-1] ^ 1])


CLAIM = [MavlinkEncoder(11).heartbeat(custom_mode=1_000_000 + k) for k in range(16)]
BAD = [bad(frame) for frame in CLAIM]
PAIRS = [a + b for a, b in zip(CLAIM, BAD, strict=True)]
SHORT = [random.Random(k).randbytes(8) for k in range(16)]
BESIDE = [bad(MavlinkEncoder(99).heartbeat(custom_mode=k)) for k in range(16)]


def crowd(field, ports, datagrams, count):
    socks = [field.stack.enter_context(udp_socket()) for _ in range(ports)]
    return lambda: [(socks[k % ports], datagrams[k % len(datagrams)]) for k in range(count)]


def spoofed(field, as_, datagrams, count, beside=0):
    sock = field.sockets[as_]
    stranger = crowd(field, 1, BESIDE, beside)
    return lambda: [(sock, datagrams[k % len(datagrams)]) for k in range(count)] + stranger()


ATTACKS = {
    "300 ports as system 11": lambda f: crowd(f, 300, CLAIM, 1200),
    "one port as system 11": lambda f: crowd(f, 1, CLAIM, 1200),
    "several frames a datagram from 40 ports": lambda f: crowd(f, 40, PAIRS, 600),
    "junk from its own port beside a flood": lambda f: spoofed(f, 11, SHORT, 600, beside=600),
    "bad frames from its own port beside a flood": lambda f: spoofed(f, 11, BAD, 600, beside=1000),
    "as system 11 from the port of another vehicle": lambda f: spoofed(f, 12, CLAIM, 1200),
}


@pytest.mark.slow_but_first
@needs_socket_filters
@pytest.mark.parametrize("keys", [False, True])
@pytest.mark.parametrize("attack", ATTACKS)
def test_a_flood_costs_no_vehicle_a_packet_and_is_told_as_long_as_it_lasts(attack, keys):
    with ExitStack() as stack:
        field = Field(stack, keys=keys)
        for _ in range(5):
            field.tick()
        flood = ATTACKS[attack](field)
        for _ in range(20):
            field.tick(flood())
        told = field.limits[-15:]
        for _ in range(round(HOLD_S / TICK_S) + 12):
            field.tick()
        assert {k: field.lost(k) for k in field.sockets} == dict.fromkeys(field.sockets, 0)
        assert all(told), "a flood that goes on is over"
        assert not field.limits[-1], "a flood that is over goes on"
        assert field.link.counts.dropped == 0


@needs_socket_filters
def test_where_nothing_tells_a_vehicle_from_who_imitates_it_both_have_their_part():
    with ExitStack() as stack:
        field = Field(stack)
        for _ in range(5):
            field.tick()
        flood = spoofed(field, 11, CLAIM, 1200)
        before = field.heard[11]
        for _ in range(30):
            field.tick(flood())
        assert {k: field.lost(k) for k in field.sockets if k != 11} == dict.fromkeys(range(12, 19), 0)
        address = f"{HOST}:{field.sockets[11].getsockname()[1]}"
        assert all((address, 11) in limits for limits in field.limits[-20:])
        part = (field.heard[11] - before) / (field.sent[11] - 5 * field.RATE)
        assert part == pytest.approx(field.of_flood / (30 * 1200), abs=0.15)
        assert field.of_flood < 1.2 * SENDER_PER_S * (SENDER_BURST_S + 3.0)


@needs_socket_filters
def test_a_vehicle_that_reboots_in_a_flood_is_heard_again_whole():
    with ExitStack() as stack:
        field = Field(stack)
        for _ in range(5):
            field.tick()
        flood = crowd(field, 300, CLAIM, 1200)
        for k in range(30):
            if k == 10:
                field.sockets[12] = stack.enter_context(udp_socket())
                field.sent[12] = field.heard[12] = 0
            field.tick(flood())
        assert field.lost(12) < 10 * field.RATE
        lost = field.lost(12)
        for _ in range(5):
            field.tick(flood())
        assert field.lost(12) == lost
