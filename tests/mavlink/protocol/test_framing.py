import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.dialect import DEFINITIONS, message_name
from mavlink.protocol.framing import FrameCounts, Framer, checksum, split
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2, Packet
from tests.support.frames import EVERY_VERSION, some_frames


def unknown_frame(payload=b"\x01\x02\x03", message_id=60_001, extra=77):
    frame = bytes([0xFD, len(payload), 0, 0, 9, 7, 1]) + message_id.to_bytes(3, "little") + payload
    return frame + checksum(frame, extra).to_bytes(2, "little")


@pytest.mark.parametrize("frame", EVERY_VERSION[::7])
def test_one_frame_in_a_datagram(frame):
    assert split(frame) == ([frame], FrameCounts(good=1))


def test_header_is_read_as_the_dialect_reads_it():
    parser = ardupilotmega.MAVLink(None)
    for frame in EVERY_VERSION:
        (message,) = parser.parse_buffer(frame)
        packet = Packet(5, frame)
        assert packet.message_id == message.get_msgId()
        assert (packet.system_id, packet.component_id) == (message.get_srcSystem(), message.get_srcComponent())
        assert packet.seq == message.get_seq()
        assert checksum(frame, DEFINITIONS[packet.message_id][1]) == message.get_crc()


def test_signed_and_version():
    assert [Packet(0, EVERY_VERSION[i]).signed for i in (0, 40, 80)] == [False, False, True]
    assert [EVERY_VERSION[i][0] for i in (0, 40, 80)] == [MAGIC_V2, MAGIC_V1, MAGIC_V2]


def test_several_frames_and_text_in_one_datagram():
    a, b = some_frames(2)
    frames, counts = split(b"\n\nInit ArduCopter V4.6" + a + b"Init Gyro*" + b + b"\0")
    assert frames == [a, b]
    assert counts == FrameCounts(good=2, junk_bytes=22 + 10 + 1)


def test_nothing_crosses_a_datagram():
    a, b = some_frames(2)
    assert split(a[:10]) == ([], FrameCounts(junk_bytes=10))
    assert split(a[10:] + b)[0] == [b]


@pytest.mark.parametrize("poison", [b"\xfd\xff\x00", b"\xfd\xff\x01", b"\xfe\xff", b"\xfd", b"\xfd\x00" * 5])
def test_poison_in_front_of_every_tenth_frame_costs_none(poison):
    frames = some_frames(500)
    stream = b"".join(poison * (i % 10 == 0) + frame for i, frame in enumerate(frames))
    assert split(stream)[0] == frames
    framer = Framer()
    got = [frame for i in range(0, len(stream), 100) for frame in framer.receive_bytes(stream[i : i + 100])]
    assert got + framer.finish() == frames


@pytest.mark.parametrize("byte", range(10))
@pytest.mark.parametrize("version", [1, 2])
def test_flipped_header_bytes_lose_no_undamaged_frame(byte, version):
    rng = random.Random(byte)
    frames = some_frames(400, version=version)
    damaged = {i for i in range(len(frames)) if i % 10 == 3}
    stream = bytearray()
    for i, frame in enumerate(frames):
        hurt = bytearray(frame)
        if i in damaged:
            hurt[byte] ^= rng.randrange(1, 256)
        stream += hurt
    framer = Framer()
    got = [
        f for i in range(0, len(stream), 333) for f in framer.receive_bytes(bytes(stream[i : i + 333]))
    ] + framer.finish()
    for i, frame in enumerate(frames):
        if i not in damaged:
            assert frame in got
    # a damaged frame may still look like one of an unknown message, never like a good one
    assert framer.counts.good == len(frames) - len(damaged)


def test_wrong_checksum_is_counted_once():
    frame = bytearray(some_frames(4)[1])
    frame[14] ^= 1
    assert split(bytes(frame)) == ([], FrameCounts(bad=1, junk_bytes=len(frame)))


def test_payload_longer_than_defined_is_refused():
    frame = bytes([0xFD, 10, 0, 0, 1, 7, 1, 0, 0, 0]) + bytes(10) + b"\0\0"
    right = checksum(frame, DEFINITIONS[0][1]).to_bytes(2, "little")
    assert split(frame[:-2] + right)[1].good == 0


def test_foreign_incompatibility_flag_is_refused():
    frame = bytearray(some_frames(1)[0])
    frame[2] = 0x02
    frame[-2:] = checksum(bytes(frame), DEFINITIONS[0][1]).to_bytes(2, "little")
    assert split(bytes(frame))[0] == []


def test_unknown_message_is_kept_raw_between_good_ones():
    a, b = some_frames(2)
    frames, counts = split(a + unknown_frame() + unknown_frame(b"\xfd\xfe" * 9) + b)
    assert frames == [a, unknown_frame(), unknown_frame(b"\xfd\xfe" * 9), b]
    assert counts == FrameCounts(good=2, unknown=2)
    assert split(unknown_frame())[1] == FrameCounts(unknown=1)
    assert message_name(60_001) == "UNKNOWN_60001"


def test_unknown_message_with_a_checksum_that_no_extra_makes_right_is_noise():
    a, b = some_frames(2)
    frame = unknown_frame()
    wrong = [frame[:-2] + crc.to_bytes(2, "little") for crc in range(0, 65_536, 37)]
    kept = sum(len(split(a + other + b)[0]) == 3 for other in wrong)
    assert 0 < kept < len(wrong) / 128
    assert all(len(split(a + unknown_frame(extra=extra) + b)[0]) == 3 for extra in range(256))


def test_unknown_message_never_swallows_a_good_frame():
    a, b = some_frames(2)
    fake = unknown_frame(b"\x01" + a + b"\x02")
    frames, counts = split(fake + b)
    assert frames == [a, b]
    assert counts.unknown == 0


def test_unknown_after_noise_needs_a_good_frame_behind_it():
    (a,) = some_frames(1)
    assert split(b"noise" + unknown_frame() + a)[0] == [unknown_frame(), a]
    assert split(b"noise" + unknown_frame())[0] == []


@given(cuts=st.lists(st.integers(0, 6000), max_size=30), noise=st.binary(max_size=30))
@settings(max_examples=40, deadline=None)
def test_stream_gives_the_same_frames_however_it_is_cut(cuts, noise):
    stream = b"".join(frame + noise * (i % 5 == 0) for i, frame in enumerate(EVERY_VERSION))
    whole = Framer()
    expected = whole.receive_bytes(stream) + whole.finish()
    framer = Framer()
    got = []
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    for start, stop in pairwise(edges):
        got += framer.receive_bytes(stream[start:stop])
    got += framer.finish()
    assert [f for f in got if f in EVERY_VERSION] == EVERY_VERSION == [f for f in expected if f in EVERY_VERSION]
    counted = framer.counts
    assert sum(map(len, got)) + counted.junk_bytes == len(stream)


@given(st.binary(max_size=600))
@settings(max_examples=150, deadline=None)
def test_any_bytes_are_accounted_for(data):
    frames, counts = split(data)
    assert sum(map(len, frames)) + counts.junk_bytes == len(data)
    assert counts.good + counts.unknown == len(frames)


@pytest.mark.parametrize("missing", [1, 5, 12])
def test_frame_cut_in_its_signature_does_not_swallow_the_next(missing):
    a, b, c = some_frames(3, key=b"k" * 32)
    stream = a[:-missing] + b + c
    assert split(stream)[0] == [b, c]
    assert Framer().receive_bytes(stream) == [b, c]


def test_framer_waits_for_the_rest_of_a_frame():
    (frame,) = some_frames(1)
    framer = Framer()
    assert [framer.receive_bytes(bytes([byte])) for byte in frame[:-1]] == [[]] * (len(frame) - 1)
    assert framer.receive_bytes(frame[-1:]) == [frame]
    assert framer.counts == FrameCounts(good=1)
