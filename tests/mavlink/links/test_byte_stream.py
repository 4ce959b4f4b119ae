"""Byte streams: what three bytes of noise hide by claiming the next 280 comes out in a moment, and on closing."""

import os
import random
import socket
import time
from contextlib import contextmanager

import pytest

from mavlink.links.base import LinkOptions
from mavlink.links.batch import Batch
from mavlink.links.byte_stream import PATIENCE_S, FrameStream
from mavlink.links.counters import Counters
from mavlink.links.kinds import open_link
from mavlink.links.stream_link import patience_s
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.framing import Framer, checksum
from tests.support.frames import EVERY_VERSION, some_frames
from tests.support.ports import free_port
from tests.support.receiving import HOST, open_reader, recorded, wait_for
from tests.support.waiting import until

NOISE = [
    b"\xfd\xff\x00",
    b"\xfd\xff\x01",
    b"\xfe\xff",
    b"\xfd\x40",
    b"\xfe\x09\x00\x01\x01\x00",
    b"\xfd",
    b"\xfd\xff\x00" * 7,
]
PTY = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals on this system")


class Line:
    """One stream whose clock stands still until it is told to go on."""

    def __init__(self):
        self.now_s = 100.0
        self.counters = Counters()
        self.stream = FrameStream(self.counters, 1, clock_s=lambda: self.now_s)

    def take(self, data=None, after_s=0.0):
        self.now_s += after_s
        batch = Batch()
        self.stream.add(data, round(self.now_s * 1e6), batch)
        return batch.frames


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("noise", NOISE)
def test_noise_hides_nothing_for_longer_than_a_moment(noise, version):
    line, frames = Line(), some_frames(3, version=version)
    got = line.take(noise + b"".join(frames))
    got += line.take(after_s=0.9 * PATIENCE_S) + line.take(after_s=0.2 * PATIENCE_S)
    assert got == frames
    assert line.counters.snapshot().packets == 3 and line.counters.snapshot().junk_bytes == len(noise)
    assert not line.stream.overdue


def test_a_frame_that_comes_in_pieces_with_long_pauses_is_not_given_up():
    line, (frame, other) = Line(), some_frames(2)
    for byte in frame[:-1]:
        assert line.take(bytes([byte]), after_s=3 * PATIENCE_S) == []
        assert line.take(after_s=PATIENCE_S) == []
    assert line.take(frame[-1:], after_s=60.0) == [frame]
    assert line.take(other) == [other] and line.counters.snapshot().junk_bytes == 0


def test_a_frame_that_carries_another_is_one_frame_as_long_as_its_bytes_come_in_time():
    inner, carrier = some_frames(1)[0], bytearray(MavlinkEncoder(7).statustext("x" * 50))
    carrier[15 : 15 + len(inner)] = inner
    carrier[-2:] = checksum(bytes(carrier), DEFINITIONS[253][1]).to_bytes(2, "little")
    carrier, line = bytes(carrier), Line()
    assert line.take(carrier[:-4]) == [] == line.take(after_s=0.9 * PATIENCE_S)
    assert line.take(carrier[-4:]) == [carrier]


def test_what_is_hidden_comes_out_when_its_own_last_bytes_do():
    line, (frame,) = Line(), some_frames(1)
    assert line.take(b"\xfd\xff\x00" + frame[:20]) == []
    assert line.take(after_s=1.0) == [] and not line.stream.overdue
    assert line.take(frame[20:], after_s=1.0) == [frame]


def test_the_end_of_a_stream_hides_nothing():
    line, frames = Line(), some_frames(3)
    assert line.take(b"\xfd\xff\x00" + b"".join(frames)) == [] and line.take(b"") == frames


@pytest.mark.parametrize("seed", range(5))
def test_however_noise_pieces_and_pauses_fall_every_frame_comes_once_and_in_order(seed):
    rng, line, got = random.Random(seed), Line(), []
    stream = b"".join(rng.choice(NOISE) * (rng.random() < 0.3) + frame for frame in EVERY_VERSION)
    while stream:
        size = rng.randrange(1, 400)
        got += line.take(stream[:size], after_s=rng.choice([0.0, 0.05, 1.0]))
        got += line.take(after_s=rng.choice([0.0, PATIENCE_S]))
        stream = stream[size:]
    got += line.take(after_s=2 * PATIENCE_S)
    assert [frame for frame in got if frame in EVERY_VERSION] == EVERY_VERSION
    assert len(got) <= len(EVERY_VERSION) + 2  # noise may look like a frame of an unknown message


def test_giving_up_keeps_what_may_still_be_finished():
    framer, (a, b) = Framer(), some_frames(2)
    assert framer.receive_bytes(b"\xfd\xff\x00" + a + b[:-3]) == []
    assert framer.skip_unfinished() == [a]
    assert framer.waiting == len(b) - 3
    assert framer.receive_bytes(b[-3:]) == [b]


# ---- from the front door


@contextmanager
def tcp_in(started):
    port = free_port(socket.SOCK_STREAM)
    ingest = started(f"tcpin:{HOST}:{port}")
    with socket.create_connection((HOST, port)) as sock:
        yield ingest, sock.sendall, sock.close


@contextmanager
def tcp_out(started):
    with socket.create_server((HOST, 0)) as server:
        server.settimeout(60.0)
        ingest = started(f"tcp:{HOST}:{server.getsockname()[1]}")
        sock, _ = server.accept()
        with sock:
            yield ingest, sock.sendall, sock.close


@contextmanager
def serial(started):
    controller, device = os.openpty()
    ingest = started(f"{os.ttyname(device)},57600")
    ends = [controller, device]

    def close():
        while ends:
            os.close(ends.pop())

    yield ingest, lambda data: os.write(controller, data), close
    ingest.stop()
    close()


LINKS = [tcp_in, tcp_out, pytest.param(serial, marks=PTY)]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("link", LINKS)
def test_three_bytes_of_noise_hide_nothing_on_a_link_that_then_falls_silent(link, started, tmp_path):
    frames = some_frames(3)
    with link(started) as (ingest, send, _):
        send(frames[0] + b"\xfd\xff\x00" + frames[1] + frames[2])
        assert [packet.raw for packet in wait_for(ingest, 3)] == frames
        ingest.stop()
    assert recorded(tmp_path) == frames


@pytest.mark.slow_but_first
@pytest.mark.parametrize("link", LINKS)
def test_three_bytes_of_noise_hide_nothing_when_the_other_end_closes(link, started, tmp_path):
    frames = some_frames(3)
    with link(started) as (ingest, send, close):
        send(frames[0])
        assert len(wait_for(ingest, 1)) == 1
        send(b"\xfd\xff\x00" + frames[1] + frames[2])
        if link is serial:  # a port that is gone takes with it what nobody has read
            assert until(lambda: ingest.health().links[0].counts.bytes >= len(b"".join(frames)))
        close()
        assert [packet.raw for packet in wait_for(ingest, 2)] == frames[1:]
        ingest.stop()
    assert recorded(tmp_path) == frames


@pytest.mark.slow_but_first
@pytest.mark.parametrize("link", LINKS)
def test_what_noise_hides_is_recorded_when_the_flight_ends(link, started, tmp_path):
    frames = some_frames(3)
    with link(started) as (ingest, send, _):
        send(frames[0])
        assert len(wait_for(ingest, 1)) == 1
        send(b"\xfd\xff\x00" + frames[1] + frames[2])
        assert until(lambda: ingest.health().links[0].counts.bytes >= len(b"".join(frames)))
        ingest.stop()
    assert recorded(tmp_path) == frames


@PTY
def test_a_serial_line_with_noise_before_every_tenth_frame_loses_none(started, tmp_path):
    frames = [MavlinkEncoder(k % 7 + 1).heartbeat(custom_mode=k) for k in range(1487)]
    with serial(started) as (ingest, send, _):
        packets = []
        for k in range(0, len(frames), 50):
            send(b"".join(NOISE[i % 3] * (i % 10 == 0) + frame for i, frame in enumerate(frames[k : k + 50])))
            packets += wait_for(ingest, max(k - len(packets), 0))
        packets += wait_for(ingest, len(frames) - len(packets))
        ingest.stop()
    assert [packet.raw for packet in packets] == frames == recorded(tmp_path)


def test_a_slow_line_is_waited_for_longer():
    assert [patience_s(baud) for baud in (115_200, 1200)] == [PATIENCE_S, pytest.approx(2 * 2800 / 1200)]


def test_who_takes_nothing_is_still_listened_to():
    frames = some_frames(2)
    link = open_reader(f"tcpin:{HOST}:{free_port(socket.SOCK_STREAM)}")
    with socket.create_connection((HOST, link.port)) as client:
        client.sendall(frames[0])
        assert len(wait_for(link, 1)) == 1
        while link.send(bytes(1 << 16)):
            continue  # the client reads none of it
        client.sendall(frames[1])
        assert [packet.raw for packet in wait_for(link, 1)] == [frames[1]] and link.clients == 1
    link.close()


def test_a_connection_that_broke_is_read_to_its_end():
    frames = some_frames(2)
    link = open_reader(f"tcpin:{HOST}:{free_port(socket.SOCK_STREAM)}")
    with socket.create_connection((HOST, link.port)) as client:
        client.sendall(frames[0])
        assert len(wait_for(link, 1)) == 1
        client.sendall(b"\xfd\xff\x00" + frames[1])
    while link.send(b"x"):
        time.sleep(0.001)  # until the client's system has answered that nobody is there
    assert [packet.raw for packet in wait_for(link, 1)] == [frames[1]]
    assert until(lambda: (link.read(0.0), link.clients)[1] == 0)
    link.close()


def test_three_bytes_of_noise_hide_nothing_that_a_program_behind_an_output_says():
    port, frames = free_port(socket.SOCK_STREAM), some_frames(2)
    output = open_link(f"tcpin:{HOST}:{port}", LinkOptions(is_output=True))
    got = []
    with socket.create_connection((HOST, port)) as program:
        program.sendall(b"\xfd\xff\x00" + b"".join(frames))
        assert until(lambda: got.extend(output.read_batch().frames) or len(got) == 2)
    assert got == frames
    output.close()
