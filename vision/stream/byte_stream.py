"""Bytes of a TCP, HTTP or SRT connection, each with the time at which it came.

Raw H.264, raw H.265 and MJPEG have no time stamps; those that FFmpeg makes up suppose 25 pictures a second. Their
pictures are dated by when their first byte came, which also undoes what a demuxer holds back.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from fractions import Fraction
from typing import TypeAlias

import av
from av.container import InputContainer
from av.format import Flags
from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from vision.stream.source import Source
from vision.stream.srt_relay import SrtRelay, kept_back_s

Packets: TypeAlias = "Iterator[Packet[CodedStream]]"

TICK_HZ = 1_000_000
_AT_ONCE = {"probesize": "32", "analyzeduration": "0"}
_MAX_ARRIVALS = 1 << 16
"""Most pieces of a connection whose arrival is kept while no picture comes: a minute at a thousand datagrams a
second."""
_SYNC, _TS_PACKET = b"G", 188
"""Byte that each packet of a transport stream begins with, and how long it is."""
_PARTS, _JPEG, _START_CODES = b"--", b"\xff\xd8\xff", (b"\0\0\1", b"\0\0\0\1")
"""Bytes that multipart MJPEG, a bare JPEG and raw video begin with."""


def has_no_stamps(container: av.container.InputContainer) -> bool:
    """Tell whether the time stamps of a container's packets are FFmpeg's own."""
    return Flags.no_timestamps in Flags(container.format.flags)


class Arrivals:
    """Times at which the bytes of a connection came, by their offset in it."""

    def __init__(self) -> None:
        self._end = 0
        self._came: deque[tuple[int, float]] = deque(maxlen=_MAX_ARRIVALS)

    def add(self, size: int, at_s: float) -> None:
        """Count bytes that came at a Unix time."""
        self._end += size
        self._came.append((self._end, at_s))

    def of(self, offset: int | None) -> float:
        """Return the time at which the byte at an offset came, which is asked for in order; of an unknown one the last.

        A container hands a picture out when the next one came, and perhaps the one after that.
        """
        while offset is not None and len(self._came) > 1 and self._came[0][0] <= offset:
            self._came.popleft()
        return self._came[0 if offset is not None else -1][1]


class ByteStream:
    """File that FFmpeg reads from instead of the address.

    Attributes:
        arrival_s: Unix time at which the packet that was dated last came.

    Raises:
        av.FFmpegError, OSError: it cannot be connected to, or breaks off.
    """

    def __init__(self, source: Source, timeout: tuple[float, float]) -> None:
        self.arrival_s = self._kept_back_s = 0.0
        self._line: SrtRelay | InputContainer
        if source.address.startswith("srt:"):
            self._line, self._kept_back_s = SrtRelay(source.address, timeout), kept_back_s(source.address)
        else:
            options = dict(source.options) | _AT_ONCE
            self._line = av.open(source.address, format="data", options=options, timeout=timeout)
        self._chunks: Iterator[bytes] = map(bytes, self._line.demux())
        self._rest = b""
        self.arrivals = Arrivals()

    def begins_as_stream(self) -> bool:
        """Tell whether the first bytes look like pictures one after the other, or like a transport stream."""
        head = self._rest or self._receive()
        packets = head[::_TS_PACKET]
        as_pictures = head.lstrip(b"\r\n").startswith((_PARTS, _JPEG, *_START_CODES))
        return as_pictures or packets == _SYNC * len(packets)

    def read(self, size: int) -> bytes:
        """Read at most ``size`` bytes, none at the end."""
        data = self._rest or self._receive()
        self._rest = data[size:]
        return data[:size]

    def dated(self, packets: Packets) -> Packets:
        """Packets with the time at which their first byte came, Unix µs, instead of their time stamps."""
        last = 0
        for packet in packets:
            self.arrival_s = self.arrivals.of(packet.pos)
            last = max(round(self.arrival_s * TICK_HZ), last + 1)
            packet.pts = packet.dts = last
            packet.time_base = Fraction(1, TICK_HZ)
            yield packet

    def close(self) -> None:
        """Hang up."""
        self._line.close()

    def _receive(self) -> bytes:
        self._rest = next(self._chunks, b"")
        self.arrivals.add(len(self._rest), time.time() - self._kept_back_s)
        return self._rest
