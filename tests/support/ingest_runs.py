"""A receiving process in tests: what is sent to it, taken from it and found in its log."""

import socket
import time

from infra.files.segments import segments
from mavlink.tlog.log import Tlog
from tests.support.waiting import until

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


def wait_for(ingest, count, timeout_s=10.0):
    """Packets until there are enough or time is up; what has come already is taken however late it is."""
    packets, stop_s, late = [], time.monotonic() + timeout_s, False
    while len(packets) < count and not late:
        late = time.monotonic() >= stop_s
        packets += ingest.read(0.1)
    return packets


def recorded(folder):
    """Raw frames of all segments, in order; one of a process that died before it wrote is empty."""
    parts = [part for part in segments(folder / "telemetry.tlog") if part.stat().st_size]
    return [packet.raw for part in parts for packet in Tlog.open(part).packets()]


def steady(sock, port, frames, rate):
    """Sends frames at a steady rate."""
    began = time.monotonic()
    for k, frame in enumerate(frames):
        sock.sendto(frame, (HOST, port))
        if k % 20 == 19:
            time.sleep(max(0.0, began + k / rate - time.monotonic()))


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


def bearable(ingest, rate):
    """A rate of which the system keeps two seconds in the buffer that it has granted; a datagram takes 832 bytes."""
    return min(rate, ingest.health().links[0].buffer_bytes / 832 / 2.0)
