"""Proof that what a sender sends is video: its datagrams are held until a picture comes out of them.

A picture is asked for, not a header: whoever sends what looks like video and never decodes has shown nothing.
"""

from __future__ import annotations

import contextlib
import io
from collections import deque
from typing import Literal, TypeAlias, cast

import av
from av.codec.context import CodecContext
from av.container import InputContainer
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream as CodedStream

from vision.stream.rtp import MPEG_TS, Depacketizer, Unit, parse
from vision.stream.source import Codec

Kind: TypeAlias = Literal["mpegts", "mpegts in rtp", "rtp"]

SEARCH = {"analyzeduration": "10000000", "probesize": "50000000", "fpsprobesize": "0"}
"""Time to find out what a stream holds: key frames may be far apart. One whose size is known opens at once."""
HELD_BYTES = 16 << 20
"""Most that is held of one sender: ten seconds of 12 Mbit/s, which has a key frame by then."""
GUESS_S = 2.0
"""Wait for the first picture of a guessed codec before the other one is tried."""
_TS_BYTES, _TS_SYNC = 188, 0x47
_DAMAGE = (av.FFmpegError, OSError, ValueError, MemoryError)


def looks_like(data: bytes, codec: Codec) -> Kind | None:
    """Kind of stream that a datagram could be of, None when it is of nothing that can be received.

    Args:
        codec: what the source was said to be, empty: to be found out.
    """
    if codec == "mpegts" or (not codec and data[0] == _TS_SYNC and len(data) % _TS_BYTES == 0):
        return "mpegts"
    packet = parse(data)
    if packet is None:
        return None
    return "mpegts in rtp" if packet.kind == MPEG_TS else "rtp"


def mpegts_payload(data: bytes) -> bytes:
    """The transport stream's packets in a datagram, without the header of RTP where there is one."""
    if data[0] == _TS_SYNC and len(data) % _TS_BYTES == 0:
        return data
    packet = parse(data)
    return b"" if packet is None else packet.payload


class Trial:
    """One sender's datagrams, until a picture was decoded and from then on until it has its turn.

    Args:
        codec: named by the source, empty: to be found out.
        began_s: Unix time.

    Attributes:
        held: datagrams with their Unix times of arrival, from the last place that decoding could begin at.
        proven: whether a picture came out.
        heard_s: Unix time of the last datagram.
        count: datagrams so far, held or let go.
        looks: how often it was looked at.
    """

    def __init__(self, kind: Kind, codec: Codec, began_s: float) -> None:
        self.kind = kind
        self.began_s = self.heard_s = began_s
        self.held: deque[tuple[bytes, float]] = deque()
        self.proven = False
        self.looks = self.count = 0
        self._named = codec
        self._bytes = 0
        self._depacketizer = Depacketizer(codec)
        self._guessed_s = began_s
        self._decoder: VideoCodecContext | None = None
        self._units: deque[Unit] = deque()
        self._ends: deque[int] = deque(maxlen=2)
        self._fresh = False

    @property
    def codec(self) -> Codec:
        """Codec of RTP: as given, or found out."""
        return self._depacketizer.codec

    def add(self, data: bytes, arrival_s: float) -> None:
        """Hold one more datagram."""
        self.held.append((data, arrival_s))
        self.heard_s = arrival_s
        self.count += 1
        self._bytes += len(data)
        self._fresh = True
        if self.kind == "rtp" and not self.proven:
            self._add_rtp(data, arrival_s)
        if self._bytes > HELD_BYTES:
            self._let_go(len(self.held) // 2)
            if self.kind == "rtp":  # what is left begins anywhere
                self._clear_units()
                self.proven = False

    def look(self) -> None:
        """Try to decode what came since the last look."""
        if self._fresh and not self.proven:
            self._fresh = False
            self.looks += 1
            self.proven = self._decodes_units() if self.kind == "rtp" else self._decodes_mpegts()

    # ---- MPEG-TS

    def _decodes_mpegts(self) -> bool:
        file = io.BytesIO(b"".join(mpegts_payload(data) for data, _ in self.held))
        try:
            with av.open(file, "r", format="mpegts", options=dict(SEARCH)) as container:
                return bool(container.streams.video) and _shows(container)
        except _DAMAGE:
            return False

    # ---- RTP

    def _add_rtp(self, data: bytes, arrival_s: float) -> None:
        packet = parse(data)
        if packet is None:
            return
        if not self._named and arrival_s - self._guessed_s > GUESS_S:
            self._depacketizer.codec, self._guessed_s, self._decoder = "", arrival_s, None
        units = self._depacketizer.add(packet)
        for unit in units:
            if unit.key or self._units or self._decoder is not None:
                self._units.append(unit)
        if units and not self._units and self._decoder is None:
            # a frame that decoding cannot begin with; a datagram of the one before may still have been late
            if len(self._ends) == 2:
                gone = self._ends[0]
                self._let_go(gone)
                self._ends[1] -= gone
            self._ends.append(len(self.held) - 1)

    def _clear_units(self) -> None:
        self._units.clear()
        self._ends.clear()
        self._decoder = None

    def _decodes_units(self) -> bool:
        while self._units:
            unit = self._units.popleft()
            if self._decoder is None:
                self._decoder = cast(VideoCodecContext, CodecContext.create(self.codec, "r"))
            with contextlib.suppress(*_DAMAGE):
                if self._decoder.decode(cast("Packet[CodedStream]", Packet(unit.data))):
                    self._clear_units()
                    return True
        return False

    def _let_go(self, n: int) -> None:
        for _ in range(n):
            self._bytes -= len(self.held.popleft()[0])


def _shows(container: InputContainer) -> bool:
    """Tell whether a picture comes out of a container's first video."""
    stream = container.streams.video[0]
    if stream.codec_context is None:  # coded in a way that FFmpeg does not know
        return False
    stream.codec_context.thread_count = 1
    for packet in container.demux(stream):
        with contextlib.suppress(*_DAMAGE):
            if stream.codec_context.decode(packet):
                return True
    return False
