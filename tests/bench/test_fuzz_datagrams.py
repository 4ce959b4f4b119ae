"""Hostile datagrams and streams; a million datagrams are run by ``python -m bench.fuzz datagrams``."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.fuzz.datagrams import (
    INPUTS,
    Listener,
    draw_datagram,
    fuzz_datagrams,
    lost,
    read_with_ours,
    read_with_pymavlink,
    wild_frame,
)
from bench.fuzz.frames import frame_pool
from mavlink.protocol.framing import Framer, split
from tests.support.bundled import ROOT

CORPUS = sorted((ROOT / "tests" / "corpus" / "datagram").iterdir())
KNOWN_V2 = [f for f in frame_pool(carried=False) if f[0] == 0xFD and not f[2] and f[7:10] != b"\x61\xea\0"][:1000]


@pytest.mark.slow
def test_no_datagram_raises():
    score = fuzz_datagrams(7, 6000)
    assert score.failures == []
    assert score.datagrams == 6000 and score.frames > 3000 and score.notices > 0


@pytest.mark.slow
@given(datagrams=st.lists(st.binary(max_size=300), max_size=8), step_us=st.integers(-(10**9), 10**9))
@settings(max_examples=60, deadline=None)
def test_any_bytes_in_any_order(datagrams, step_us):
    listener = Listener()
    for data in datagrams:
        listener.receive(data, step_us)
    listener.fleet.at(listener.t_us)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32), payload=st.binary(min_size=1, max_size=40))
@settings(max_examples=80, deadline=None)
def test_wild_contents_behind_right_checksums(seed, payload):
    rng = random.Random(seed)
    listener = Listener()
    for _ in range(6):
        frame = wild_frame(rng)
        assert split(frame)[1].good == 1
        listener.receive(frame + payload)
    listener.fleet.at(listener.t_us)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_kept_datagrams(path):
    data = path.read_bytes()
    listener = Listener()
    for _ in range(3):
        listener.receive(data)
    frames, counts = split(data)
    assert sum(map(len, frames)) + counts.junk_bytes == len(data)
    framer = Framer()
    assert sum(map(len, framer.receive_bytes(data) + framer.finish())) + framer.counts.junk_bytes == len(data)


# What pymavlink 2.4 loses on the same bytes: resynchronising costs it undamaged frames here.
THEIRS_LOSE = (
    "flipped magic",
    "flipped length",
    "flipped incompat",
    "7 B of noise between",
    "64 B of noise between",
    "300 B of noise between",
    "FD FF 00 between",
    "FD FF 01 between",
    "FE FF between",
    "half a frame, then others",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", INPUTS)
def test_no_undamaged_frame_of_a_stream_is_lost(name):
    parts = INPUTS[name](KNOWN_V2, random.Random(1))
    missing, invented = lost(parts, read_with_ours)
    assert missing == 0
    assert invented <= 1
    if name in THEIRS_LOSE:
        assert lost(parts, read_with_pymavlink)[0] > 5


def test_the_same_seed_draws_the_same_datagram():
    assert draw_datagram(random.Random(5)) == draw_datagram(random.Random(5))
