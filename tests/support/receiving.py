"""Links and receiving processes in tests: what is sent to them, taken from them and found in their log."""

import select
import socket
import time
from pathlib import Path

from infra.files.segment import segments
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import Batch
from mavlink.links.kinds import open_link
from mavlink.links.url import LinkUrl
from mavlink.protocol.framing import split
from mavlink.tlog.log import Tlog
from tests.support.waiting import until

STEP_S = 0.05


class LinkReader:
    """A link that can also be waited for."""

    def __init__(self, link, index=0):
        self.link = link
        self._index = index

    def __getattr__(self, name):
        return getattr(self.link, name)

    def read(self, timeout_s):
        """Packets that have come; empty after the timeout and when closed."""
        stop_s = time.monotonic() + timeout_s
        while True:
            self.link.maintain()
            batch = self.link.read_batch()
            left_s = stop_s - time.monotonic()
            if batch.frames or left_s <= 0.0:
                return batch.packets(self._index)
            if self.link.fds:
                select.select(self.link.fds, [], [], min(left_s, STEP_S))
            else:
                time.sleep(min(left_s, STEP_S))


def open_reader(url, index=0):
    return LinkReader(open_link(url), index)


PEER = ".peer"


class UnixLink(Link):
    """Listens at a path, and sends to the path beside it."""

    example = "unix:/run/mavlink"

    def __init__(self, url: LinkUrl, options: LinkOptions) -> None:
        super().__init__(url, options)
        self._peer = url.device + PEER
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(url.device)

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        if not Path(rest).is_absolute():
            raise LinkError("no absolute path")
        return LinkUrl(scheme="unix", device=rest)

    @property
    def fds(self) -> tuple[int, ...]:
        return (self._socket.fileno(),)

    def read_batch(self) -> Batch:
        batch = Batch()
        try:
            data = self._socket.recv(4096)
        except BlockingIOError:
            return batch
        frames, counts = split(data)
        self._counters.add(len(data), counts)
        for frame in frames:
            batch.times_us.append(now_us())
            batch.frames.append(frame)
            batch.peers.append(1)
        return batch

    def send(self, frame: bytes, peer: int = 0) -> bool:
        try:
            self._socket.sendto(frame, self._peer)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error}") from error
        return True

    def close(self) -> None:
        self._socket.close()


HOST = "127.0.0.1"
PIECE = 200
"""Datagrams that any system's receive buffer holds, however long nobody gets to read."""


def is_free(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.bind((HOST, port))
        except OSError:
            return False
        return True


def wait_for(ingest, count, timeout_s=60.0):
    """Packets until there are enough or time is up; what has come already is taken however late it is."""
    packets, stop_s, late = [], time.monotonic() + timeout_s, False
    while len(packets) < count and not late:
        late = time.monotonic() >= stop_s
        packets += ingest.read(0.1)
    return packets


def read_to(ingest, frame):
    """Packets up to the one that has a frame."""
    packets = []
    assert until(lambda: packets.extend(ingest.read(0.01)) or any(packet.raw == frame for packet in packets))
    return packets


def recorded(folder):
    """Raw frames of all segments, in order; one of a process that died before it wrote is empty."""
    parts = [part for part in segments(folder / "telemetry.tlog") if part.stat().st_size]
    return [packet.raw for part in parts for packet in Tlog.open(part).packets()]


def steady(sock, port, frames, rate):
    """Sends frames at a rate or, on a busy machine, slower: no delay is made up for by a burst."""
    for k, frame in enumerate(frames):
        sock.sendto(frame, (HOST, port))
        if k % 20 == 19:
            time.sleep(20 / rate)


def in_pieces(frames):
    return [frames[k : k + PIECE] for k in range(0, len(frames), PIECE)]


def send(sock, port, frames, taken):
    """Sends frames, the next piece when ``taken``, a number of frames, says that all before have arrived."""
    sent = 0
    for piece in in_pieces(frames):
        for frame in piece:
            sock.sendto(frame, (HOST, port))
        sent += len(piece)
        assert until(lambda: taken() >= sent)  # noqa: B023 - asked at once


def carry(ingest, sock, port, frames):
    """Sends frames, the next piece when all before have been read, and gives their packets."""
    packets = []
    for piece in in_pieces(frames):
        for frame in piece:
            sock.sendto(frame, (HOST, port))
        packets += wait_for(ingest, len(piece))
    return packets


def bearable(ingest, rate):
    """A rate of which the system keeps two seconds in the buffer that it has granted; a datagram takes 832 bytes."""
    return min(rate, ingest.health().links[0].buffer_bytes / 832 / 2.0)
