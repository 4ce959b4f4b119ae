"""RTP taken apart: what FFmpeg packed must come out as its encoder made it, whatever the network did in between."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest

from tests.support.video_senders import CODECS, COUNT, KEY_EVERY, pack
from vision.stream.rtp import Depacketizer, guess_codec, parse


@pytest.fixture(scope="module", params=list(CODECS))
def packed(request):
    return request.param, *pack(request.param)


def nals(unit):
    """NAL units without start codes."""
    return [
        piece.rstrip(b"\0") for piece in unit.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1") if piece.rstrip(b"\0")
    ]


def feed(datagrams, codec=""):
    depacketizer = Depacketizer(codec)
    units = [unit for data in datagrams if (packet := parse(data)) for unit in depacketizer.add(packet)]
    return depacketizer, units


def renumbered(data, sequence=None, time=None, source=None):
    head = bytearray(data)
    for at, kind, value in ((2, "!H", sequence), (4, "!I", time), (8, "!I", source)):
        if value is not None:
            struct.pack_into(kind, head, at, value % (1 << (16 if kind == "!H" else 32)))
    return bytes(head)


def test_access_units_come_out_as_they_went_in(packed):
    codec, encoded, datagrams = packed
    depacketizer, units = feed(datagrams)
    assert depacketizer.codec == codec and depacketizer.lost == 0
    assert len(datagrams) > 1.5 * COUNT  # large frames were cut in pieces
    assert len(units) == COUNT and all(unit.whole for unit in units)
    assert [nals(unit.data) for unit in units] == [nals(unit) for unit in encoded]
    assert {k for k, unit in enumerate(units) if unit.key} >= set(range(0, COUNT, KEY_EVERY))
    assert not units[1].key
    assert np.diff([unit.time for unit in units]).tolist() == [90_000 // 25] * (COUNT - 1)


def test_datagrams_in_the_wrong_order_are_put_right(packed):
    _, encoded, datagrams = packed
    mixed, rng = list(datagrams), random.Random(2)
    for at in range(4, len(mixed) - 4, 4):
        if rng.random() < 0.5:
            mixed[at], mixed[at + 1] = mixed[at + 1], mixed[at]
    assert mixed != datagrams
    depacketizer, units = feed(mixed)
    assert depacketizer.lost == 0
    assert [nals(unit.data) for unit in units] == [nals(unit) for unit in encoded]


def test_a_lost_datagram_costs_its_own_frame(packed):
    _, encoded, datagrams = packed
    drop = set(random.Random(3).sample(range(10, len(datagrams) - 10), 5))
    depacketizer, units = feed([data for k, data in enumerate(datagrams) if k not in drop])
    assert depacketizer.lost == 5
    whole = {unit.time for unit in units if unit.whole}
    by_time = {(k * 90_000 // 25): nals(unit) for k, unit in enumerate(encoded)}
    assert all(nals(unit.data) == by_time[unit.time - units[0].time] for unit in units if unit.whole)
    # the frame that lost it and at most the one after, when its end was lost
    assert len(whole) >= COUNT - 10


def test_numbers_run_over_and_another_sender_begins_anew(packed):
    _, encoded, datagrams = packed
    first = parse(datagrams[0])
    over = [
        renumbered(data, parse(data).sequence - first.sequence - 20, parse(data).time - first.time - 9000)
        for data in datagrams
    ]
    other = [renumbered(data, parse(data).sequence + 31000, source=77) for data in datagrams]
    depacketizer, units = feed(over + other)
    assert depacketizer.lost == 0 and len(units) == 2 * COUNT
    assert np.diff([unit.time for unit in units[:COUNT]]).tolist() == [3600] * (COUNT - 1)
    assert [nals(unit.data) for unit in units[COUNT:]] == [nals(unit) for unit in encoded]


def test_damage_never_raises(packed):
    codec, _, datagrams = packed
    rng = random.Random(4)
    for _ in range(30):
        broken = []
        for data in datagrams:
            body = bytearray(data)
            for _ in range(rng.randrange(4)):
                body[rng.randrange(len(body))] ^= 1 << rng.randrange(8)
            broken.append(bytes(body[: rng.randrange(len(body) + 1)]) if rng.random() < 0.2 else bytes(body))
        _, units = feed(broken, codec)
        assert all(isinstance(unit.data, bytes) for unit in units)
    for _ in range(2000):
        noise = rng.randbytes(rng.randrange(64))
        packet = parse(noise)
        if packet is not None:
            Depacketizer(rng.choice(["", "h264", "hevc"])).add(packet)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(11),
        b"\x47" + bytes(187),
        b"\x80\xc8" + bytes(20),
        b"\x80\x60" + bytes(10),
        b"\xa0\x60" + bytes(11) + b"\xff",
    ],
    ids=["empty", "short", "mpeg-ts", "rtcp", "no payload", "padding longer than the packet"],
)
def test_what_is_no_rtp_is_none(data):
    assert parse(data) is None


@pytest.mark.parametrize(
    ("payload", "codec"),
    [
        ("6742c01e", "h264"),
        ("7c85", "h264"),
        ("78000a", "h264"),
        ("4001", "hevc"),
        ("6201", "hevc"),
        ("4101", ""),
        ("", ""),
    ],
)
def test_the_codec_shows_in_the_first_bytes(payload, codec):
    assert guess_codec(bytes.fromhex(payload)) == codec
