"""Who is let in over a UDP port, and how much of whom: places, allowances, the filter in the kernel and the limiter."""

import math
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavlink.links.batch import MIXED
from mavlink.links.bpf import attach, detach, program
from mavlink.links.fair_shares import (
    LIKELY_PER_S,
    OTHER_PER_S,
    READ_PER_S,
    SENDER_PER_S,
    PassedTraffic,
    Shares,
    fair_level,
)
from mavlink.links.flood_limiter import STRANGERS, TICK_S, FloodLimiter
from mavlink.links.peers import ADDRESSES_PER_SYSTEM, NUMBERED, TRUSTED, WAITING, WAITING_US, Peers, key_of
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.ports import needs_socket_filters, udp_socket

HOST = "127.0.0.1"
KEY = bytes(range(32))


def arrived(sock):
    got = []
    try:
        while True:
            got.append(sock.recv(4096))
    except BlockingIOError:
        return got


# ---- who is known


def peer(peers, k):
    return peers.number(key_of((f"192.0.2.{k % 250}", 1 + k // 250)))


def test_a_key_is_the_kernels_own_spelling_of_an_address():
    peers = Peers()
    number = peers.number(key_of(("192.0.2.7", 14551)))
    peers.trust({(number, 11)}, 1)
    assert number == 1 and peers.number(key_of(("192.0.2.7", 14551))) == 1
    assert peers.addresses() == {1: ("192.0.2.7", 14551)} and peers.address(1) == "192.0.2.7:14551"
    assert peers.source((1, 11)) == (0xC0000207, 14551, 11)
    assert peers.address(2) == ""


def test_a_crowd_of_strangers_pushes_out_its_own():
    peers = Peers()
    fleet = {(peer(peers, k), k + 1) for k in range(100)}
    for t_us in range(10):
        peers.trust(fleet, t_us)
        peers.update_trust(t_us)
    for k in range(3 * NUMBERED):
        peers.trust({(peer(peers, 1000 + k), k % 256)}, 100)
        if k % 1000 == 0:
            peers.update_trust(101)
    peers.update_trust(101)
    assert len(peers.trusted) <= TRUSTED and len(peers.numbers) <= NUMBERED
    assert fleet <= peers.trusted.keys()
    assert {(peer(peers, k), k + 1) for k in range(100)} == fleet
    assert set(peers.addresses()) == {number for number, _ in peers.trusted}


def test_a_crowd_that_speaks_as_one_vehicle_gets_few_places_and_those_heard_longest_keep_theirs():
    peers = Peers()
    vehicle, rebooted = (peer(peers, 1), 11), (peer(peers, 2), 11)
    crowd = {(peer(peers, 10 + k), 11) for k in range(50)}
    peers.trust({vehicle}, 0)
    peers.update_trust(0)
    for t_us in range(1, 10):
        peers.trust({vehicle, *crowd}, t_us)
        peers.update_trust(t_us)
    assert vehicle in peers.trusted and len(peers.trusted) == ADDRESSES_PER_SYSTEM
    # one that was never silent takes the place of one that spoke once
    late = max(peers.trusted, key=lambda claim: claim[0])
    for t_us in range(10, 40):
        peers.trust({vehicle, rebooted, *crowd} - {late}, t_us)
        peers.update_trust(t_us)
    assert late not in peers.trusted and vehicle in peers.trusted and len(peers.trusted) == ADDRESSES_PER_SYSTEM


def test_trust_ends_with_silence_and_its_place_is_free():
    peers = Peers()
    claims = {(peer(peers, k), 11) for k in range(ADDRESSES_PER_SYSTEM)}
    waiting = (peer(peers, 99), 11)
    peers.trust(claims, 0)
    peers.trust({waiting}, 0)
    peers.update_trust(0)
    assert waiting not in peers.trusted
    peers.trust({waiting}, 59_000_000)
    peers.update_trust(59_000_000)
    changes = peers.changes
    peers.trust({waiting}, 60_000_000)
    peers.update_trust(60_000_001)
    assert list(peers.trusted) == [waiting] and peers.changes > changes
    peers.update_trust(120_000_002)
    assert not peers.trusted and not peers.addresses()


def test_those_who_wait_for_a_place_are_few_and_soon_forgotten():
    peers = Peers()
    claims = [(peer(peers, k), 11) for k in range(ADDRESSES_PER_SYSTEM + 2 * WAITING)]
    peers.trust(set(claims[:ADDRESSES_PER_SYSTEM]), 0)
    peers.trust(set(claims[ADDRESSES_PER_SYSTEM:]), 0)
    peers.update_trust(0)
    assert len(peers._waiting) == WAITING
    peers.trust({claims[0]}, WAITING_US + 1)
    peers.update_trust(WAITING_US + 1)
    assert not peers._waiting and len(peers.trusted) == ADDRESSES_PER_SYSTEM


def test_another_process_goes_on_with_what_is_known():
    peers, after = Peers(), Peers()
    claims = {(peer(peers, 1), 11), (peer(peers, 1), 12), (peer(peers, 2), 13)}
    peers.trust(claims, 0)
    peers.note_mixed({peer(peers, 1)})
    after.restore(peers.addresses(), tuple(peers.trusted), tuple(peers.mixed), peers.last, 5)
    assert after.systems() == peers.systems() == {**dict.fromkeys(claims, 1), (peer(peers, 1), MIXED): 2}
    assert after.addresses() == peers.addresses() and after.last == peers.last


# ---- the filter in the kernel


FRAMES = {
    "v2": MavlinkEncoder(7).heartbeat(),
    "signed": MavlinkEncoder(7, key=KEY).heartbeat(),
    "v1": MavlinkEncoder(7, version=1).heartbeat(),
}
STRANGE_FLAG = FRAMES["v2"][:2] + b"\2" + FRAMES["v2"][3:]
JUNK = [b"", b"\xfd", b"\xfd\xff\x00", b"\xfd\xff\x01", b"x" * 100, FRAMES["v2"][:-1], FRAMES["v1"] + b"\0"]
JUNK += [STRANGE_FLAG, FRAMES["v1"] + FRAMES["v2"], b"\xfe" * 9]


@needs_socket_filters
@pytest.mark.parametrize("others", [0, 300])
def test_the_filter_knows_senders_by_address_and_system_and_what_looks_like_a_frame(others):
    frames = list(FRAMES.values())
    crowd = [(0x7F000001, 1 + k, 7) for k in range(others)] + [(0x0A000000 + k, 5, 7) for k in range(others)]
    with udp_socket() as here, udp_socket() as known, udp_socket() as stranger:
        to = here.getsockname()
        address = (0x7F000001, known.getsockname()[1])

        def heard(sock):
            for data in [*frames, *JUNK]:
                sock.sendto(data, to)
            return arrived(here)

        for likely, other in [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)]:
            strange = frames * bool(likely) + JUNK * bool(other)
            attach(here, program([*crowd, (*address, 7)], {}, likely, other))
            assert heard(stranger) == strange
            assert heard(known) == frames + JUNK * bool(other)
            attach(here, program([*crowd, (*address, MIXED)], {}, likely, other))
            assert heard(known) == frames * bool(likely) + JUNK
            attach(here, program([*crowd, (*address, 8)], {}, likely, other))
            assert heard(known) == strange
            attach(here, program([*crowd, (*address, 7)], {(*address, 7): 0.0, (0x7F000001, 1, 9): 0.5}, likely, other))
            assert heard(known) == JUNK * bool(other)
        detach(here)
        detach(here)
        stranger.sendto(b"anybody", to)
        assert arrived(here) == [b"anybody"]


@needs_socket_filters
@pytest.mark.parametrize("own", [False, True])
def test_a_share_passes_at_random(own):
    with udp_socket() as here, udp_socket() as sender:
        here.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        shares = {(0x7F000001, sender.getsockname()[1], MIXED): 0.25} if own else {}
        attach(here, program([], shares, 1.0, 1.0 if own else 0.25))
        for _ in range(2000):
            sender.sendto(b"x", here.getsockname())
        assert 380 < len(arrived(here)) < 620  # six sigma


def test_a_program_that_the_kernel_would_not_take_is_refused():
    with pytest.raises(ValueError, match="4096"):
        program([(k, 1, 1) for k in range(5000)], {}, 1.0, 1.0)


# ---- how much of what is let in


@given(st.lists(st.floats(0.0, 1e6), max_size=30), st.floats(1.0, 1e6))
def test_a_fair_division_gives_all_or_the_same(wanted, total):
    level = fair_level(wanted, total)
    given_ = [min(rate, level) for rate in wanted]
    if sum(wanted) <= total:
        assert sum(given_) == pytest.approx(sum(wanted))
    else:
        assert sum(given_) == pytest.approx(total, rel=1e-6) and math.isfinite(level)


def settle(shares, offered, seconds=5.0, late=False):
    """Steady rates for a while: {sender, or "likely" or "other": (datagrams, good frames a second)}; what is let in."""
    passed = dict.fromkeys(offered, 0.0)
    for k in range(round(seconds / TICK_S)):
        seen = {}
        for who, (rate, good) in offered.items():
            share = (
                getattr(shares, who).share
                if isinstance(who, str)
                else shares.limited[who].share
                if who in shares.limited
                else 1
            )
            seen[who] = (round(rate * share * TICK_S), round(good * share * TICK_S))
            passed[who] += rate * share * TICK_S
        known = {who: counts for who, counts in seen.items() if not isinstance(who, str)}
        traffic = PassedTraffic(
            likely=seen.get("likely", (0, 0))[0],
            other=seen.get("other", (0, 0))[0],
            frames={who: good for who, (_, good) in known.items() if good},
            read={who: read for who, (read, _) in known.items()},
            late=late,
        )
        shares.adapt(traffic, {}, TICK_S, 10.0 + k * TICK_S)
    return {who: total / seconds for who, total in passed.items()}


def test_strangers_are_let_in_as_often_as_can_be_borne():
    shares = Shares()
    assert settle(shares, {"likely": (LIKELY_PER_S, 0), "other": (OTHER_PER_S, 0)}) == {
        "likely": pytest.approx(LIKELY_PER_S),
        "other": pytest.approx(OTHER_PER_S),
    }
    assert shares.likely.share == shares.other.share == 1.0
    settle(shares, {"likely": (60_000, 0), "other": (60_000, 0)})
    assert shares.likely.share * 60_000 == pytest.approx(LIKELY_PER_S, rel=0.1)
    assert shares.other.share * 60_000 == pytest.approx(OTHER_PER_S, rel=0.1)
    settle(shares, {"likely": (100, 0), "other": (10, 0)})
    assert shares.likely.share == shares.other.share == 1.0


def test_a_known_sender_is_limited_alone_and_a_burst_of_his_is_not():
    shares, fleet = Shares(), {(k, k): (120, 120) for k in range(20)}
    assert settle(shares, fleet | {(99, 11): (SENDER_PER_S, SENDER_PER_S)})[99, 11] == pytest.approx(SENDER_PER_S)
    assert not shares.limited
    settle(shares, fleet | {(99, 11): (10 * SENDER_PER_S, 10 * SENDER_PER_S)}, seconds=TICK_S)
    assert all(part.share == 1.0 for part in shares.limited.values())
    got = settle(shares, fleet | {(99, 11): (60_000, 60_000)}, seconds=20.0)
    assert [got[k, k] for k in range(20)] == [pytest.approx(120)] * 20
    assert got[99, 11] == pytest.approx(SENDER_PER_S, rel=0.3)
    settle(shares, fleet, seconds=5.0)
    shares.forget(1e9, {})
    assert not shares.limited


def test_junk_that_claims_to_be_a_vehicle_does_not_count_as_its_frames():
    shares = Shares()
    assert settle(shares, {(1, 11): (29_000, 120)})[1, 11] == 29_000
    assert not shares.limited
    got = settle(shares, {(1, 11): (3 * READ_PER_S, 120), (2, 12): (120, 120)}, seconds=20.0)
    assert got[1, 11] == pytest.approx(READ_PER_S, rel=0.1) and got[2, 12] == pytest.approx(120)


def test_a_machine_that_is_late_reads_less_of_those_who_flood_and_all_of_the_others():
    shares, fleet = Shares(), {(k, k): (200, 200) for k in range(100)}
    got = settle(shares, fleet | {(1, 11): (60_000, 120)}, seconds=20.0, late=True)
    assert got[1, 11] == pytest.approx(SENDER_PER_S, rel=0.3)
    assert [got[k, k] for k in range(100)] == [pytest.approx(200)] * 100
    got = settle(shares, {(1, 11): (10_000, 120)}, seconds=20.0)
    assert got[1, 11] > 5_000 and shares.read_per_s == pytest.approx(READ_PER_S)


def test_a_large_fleet_is_let_in_whole():
    shares, fleet = Shares(), {(k, k): (200, 200) for k in range(100)}
    settle(shares, fleet)
    assert not shares.limited


# ---- the limiter


@needs_socket_filters
def test_a_gate_that_cannot_work_lets_everybody_in():
    with udp_socket() as here, udp_socket() as stranger:
        limiter, peers = FloodLimiter(here), Peers()
        peers.systems = lambda: {(k, 1): 1 for k in range(5000)}  # more than the kernel takes
        peers.source = lambda sender: (sender[0], 1, 1)
        limiter.adapt(0.1, 0.1, PassedTraffic(100_000, 100_000, {}, {}), peers)
        assert limiter.is_unsupported and not list(limiter.limits(peers, ""))
        stranger.sendto(b"x", here.getsockname())
        assert arrived(here) == [b"x"]


@needs_socket_filters
def test_what_is_turned_away_is_not_called_lost_and_is_counted():
    with udp_socket() as here, udp_socket() as stranger:
        limiter, peers = FloodLimiter(here), Peers()
        limiter.adapt(0.1, 0.1, PassedTraffic(0, 1_000_000, {}, {}), peers)
        for _ in range(500):
            stranger.sendto(b"junk", here.getsockname())
        limiter.adapt(0.2, 0.1, PassedTraffic(0, len(arrived(here)), {}, {}), peers)
        assert limiter.turned_away > 400 and limiter.dropped == 0
        (limit,) = limiter.limits(peers, "here")
        assert (limit.address, limit.system_id, limit.turned_away) == ("here", STRANGERS, limiter.turned_away)
