"""One open connection to a source: coded packets, whatever the transport.

Datagrams come from a port of ours (``vision.stream.port``), all else is opened by FFmpeg, with limits to its patience.
"""

from __future__ import annotations

import io
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TypeAlias, cast

import av
import av.logging
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from vision.errors import VideoError
from vision.stream.exposure_times import Exposures, klv_time_s, sei_time_s, sender_report
from vision.stream.port import Port
from vision.stream.rtp import MPEG_TS, TICK_HZ, Depacketizer, Unit, parse
from vision.stream.source import Source
from vision.video.frame_index import ONE_FILE, reason

__all__ = ["OPEN_TIMEOUT_S", "READ_TIMEOUT_S", "Input", "datagrams", "listen", "open_input"]

OPEN_TIMEOUT_S = 3.0
"""Longest wait for a connection, seconds."""
READ_TIMEOUT_S = 2.0
"""Longest wait for the next packet, seconds."""
SEARCH = {"analyzeduration": "10000000", "probesize": "50000000", "fpsprobesize": "0"}
"""Time to find out what a stream holds: key frames may be far apart. One whose size is known opens at once."""
READ_BYTES = 32768
"""Most bytes that FFmpeg asks for at once."""
PATIENCE_S = 6.0
"""Wait for the first frame in RTP before it is reported that none can be decoded."""
GUESS_S = 2.0
"""Wait for the first frame of a guessed codec before the other one is tried."""
_PRODUCER_TIME = struct.Struct("=qi")
"""FFmpeg's AVProducerReferenceTime: Unix µs, flags."""
REORDERED = 2
"""Frames that a stream with B-frames holds back, where no decoding times are given."""

Packets: TypeAlias = "Iterator[Packet[CodedStream]]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """Packets of a connection and what decodes them."""

    stream: CodedStream
    tick_s: float
    """Unit of the packets' time stamps."""
    packets: Packets
    container: InputContainer
    arrival_s: Callable[[], float] = time.time
    """Unix time at which the packet that came out last came in."""
    live: Callable[[], bool] = lambda: True
    """False once nothing more comes and only what was held back is handed out."""
    drains: bool = False
    """Whether it ends by itself when it is time to stop, and hands out its last packet then."""
    exposures: Exposures = field(default_factory=Exposures)
    """Exposure times that the stream itself carries."""


def open_input(source: Source) -> Input:
    """Connect by FFmpeg.

    Raises:
        VideoError: nothing there, no answer within the time, no video in it.
    """
    av.logging.set_level(av.logging.PANIC)
    begin_s = time.monotonic()
    try:
        container = _open(source)
    except (av.FFmpegError, OSError, ValueError) as error:
        late = time.monotonic() - begin_s >= OPEN_TIMEOUT_S
        why = f"no answer within {OPEN_TIMEOUT_S:g} s" if late else reason(error)
        raise VideoError(f"video {source.text}: cannot be opened ({why}); is it being sent?") from error
    return _input(source, container)


def datagrams(source: Source, port: Port, go_on: Callable[[], bool]) -> Input | None:
    """The next connection on a port, waited for without end; None when it is time to stop.

    Raises:
        VideoError: what comes is no video that is known here.
    """
    av.logging.set_level(av.logging.PANIC)
    first = port.wait()
    if not first:
        return None
    packet = parse(first)
    if source.codec == "mpegts" or (source.codec == "" and _is_mpegts(first)):
        return _of_port(port, _mpegts(source, _Bytes(port, lambda data: 0)))
    if packet is not None and packet.kind == MPEG_TS:
        return _of_port(port, _mpegts(source, _Bytes(port, _rtp_header)))
    return _rtp(source, port, go_on)


def _of_port(port: Port, opened: Input) -> Input:
    return replace(opened, arrival_s=lambda: port.arrival_s, live=lambda: port.live)


def _open(source: Source) -> InputContainer:
    timeout = (OPEN_TIMEOUT_S, READ_TIMEOUT_S)
    container: InputContainer
    if source.kind == "camera":
        # what the camera compresses itself is recorded as it is; raw frames only where it offers nothing else
        formats = [source.options] if "input_format" in source.options else []
        formats = formats or [dict(source.options) | {"input_format": name} for name in ("h264", "mjpeg", "yuyv422")]
        for last, options in enumerate(formats, 1 - len(formats)):
            try:
                container = av.open(source.address, format="video4linux2", options=dict(options), timeout=timeout)
            except (FileNotFoundError, PermissionError):
                raise
            except (av.FFmpegError, OSError, ValueError):
                if last == 0:
                    raise
            else:
                return container
    options = dict(source.options)
    if source.kind == "session":
        options |= {"protocol_whitelist": "file,udp,rtp,data"}
        container = av.open(source.address, format="sdp", options=options, timeout=timeout)
    else:
        if source.kind == "file":
            options |= {"format_whitelist": ONE_FILE}
        container = av.open(source.address, options=options, timeout=timeout)
    return container


def _input(source: Source, container: InputContainer) -> Input:
    if not container.streams.video:
        container.close()
        raise VideoError(f"video {source.text}: no video stream in it")
    stream = container.streams.video[0]
    # slices only: threads over frames would hold frames back
    stream.thread_type = "SLICE"
    tick_s = float(stream.time_base or 1e-6)
    drains = source.kind == "datagrams"
    opened = Input(stream=stream, tick_s=tick_s, packets=iter(()), container=container, drains=drains)
    return replace(opened, packets=_video_packets(opened, container))


def _video_packets(opened: Input, container: InputContainer) -> Packets:
    """Packets of the video; metadata beside it is evaluated."""
    for packet in container.demux([opened.stream, *container.streams.data]):
        if packet.stream is opened.stream:
            yield cast("Packet[CodedStream]", packet)
        elif packet.pts is not None and packet.time_base is not None:
            taken_s = klv_time_s(bytes(packet))
            if taken_s is not None:
                opened.exposures.add("KLV", float(packet.pts * packet.time_base), taken_s, time.time())


def listen(opened: Input, packet: Packet[CodedStream], arrival_s: float) -> None:
    """Read the exposure time of a packet's frame: from its own time stamp, and from what the RTSP server reported.

    Args:
        opened: the connection.
        packet: with a presentation time.
        arrival_s: Unix time at which it came.
    """
    stamp_s, taken_s = (packet.pts or 0) * opened.tick_s, sei_time_s(bytes(packet))
    if taken_s is not None:
        opened.exposures.add("SEI", stamp_s, taken_s, arrival_s)
    elif packet.has_sidedata("prft"):
        wall_us, _ = _PRODUCER_TIME.unpack_from(bytes(packet.get_sidedata("prft")))
        opened.exposures.add("RTCP", stamp_s, wall_us * 1e-6, arrival_s)


class _Bytes:
    """What FFmpeg reads from: the datagrams of one connection behind their headers."""

    def __init__(self, port: Port, header: Callable[[bytes], int]) -> None:
        self._port = port
        self._header = header
        self._rest = b""

    def read(self, size: int) -> bytes:
        """At most ``size`` bytes, none at the end."""
        while not self._rest:
            data = self._port.read()
            if not data:
                return b""
            self._rest = data[self._header(data) :]
        piece, self._rest = self._rest[:size], self._rest[size:]
        return piece


def _is_mpegts(data: bytes) -> bool:
    return data[0] == 0x47 and len(data) % 188 == 0


def _rtp_header(data: bytes) -> int:
    packet = parse(data)
    return len(data) if packet is None else len(data) - len(packet.payload)


def _mpegts(source: Source, file: _Bytes) -> Input:
    try:
        container = av.open(file, "r", format="mpegts", options=dict(SEARCH), buffer_size=READ_BYTES)
    except (av.FFmpegError, OSError, ValueError) as error:
        raise VideoError(f"video {source.text}: what comes cannot be read ({reason(error)})") from error
    return _input(source, container)


def _rtp(source: Source, port: Port, go_on: Callable[[], bool]) -> Input | None:
    """Open at the first frame that decoding can begin with."""
    depacketizer, decided, exposures = Depacketizer(source.codec), threading.Event(), Exposures()
    units = _units(port, depacketizer, decided, exposures, guess=source.codec == "")
    received = False
    for unit in units:
        received = True
        if not unit.key:
            continue
        try:
            probe = av.open(io.BytesIO(unit.data), "r", format=depacketizer.codec, options={"fpsprobesize": "0"})
            opened = _input(source, probe)
        except (av.FFmpegError, OSError, ValueError):
            continue
        if opened.stream.codec_context.width:
            decided.set()
            packets = _packets(unit, units, bool(opened.stream.codec_context.has_b_frames))
            return _of_port(port, replace(opened, tick_s=1 / TICK_HZ, packets=packets, exposures=exposures))
        opened.container.close()
    if not go_on():
        return None
    if received:
        raise VideoError(
            f"video {source.text}: RTP comes, but no frame yet that decoding can begin with; let the sender repeat "
            "its SPS and PPS with every key frame, or name its .sdp file instead"
        )
    raise VideoError(
        f"video {source.text}: what comes is neither MPEG-TS nor RTP with H.264 or H.265 that can be decoded"
    )


def _units(
    port: Port, depacketizer: Depacketizer, decided: threading.Event, exposures: Exposures, *, guess: bool
) -> Iterator[Unit]:
    """Access units; until the codec is decided, it is guessed again from time to time, and at last given up."""
    began_s = guessed_s = time.monotonic()
    while data := port.read():
        if not decided.is_set():
            if time.monotonic() - began_s > PATIENCE_S:
                return
            if guess and time.monotonic() - guessed_s > GUESS_S:
                depacketizer.codec, guessed_s = "", time.monotonic()
        for report, arrival_s in ((data, port.arrival_s), *port.reports()):
            reported = sender_report(report)
            stamp = depacketizer.full_time(reported.source, reported.time) if reported is not None else None
            if reported is not None and stamp is not None:
                exposures.add("RTCP", stamp / TICK_HZ, reported.unix_s, arrival_s)
        datagram = parse(data)
        if datagram is not None:
            yield from depacketizer.add(datagram)


def _packets(first: Unit, units: Iterator[Unit], reordered: bool) -> Packets:
    """Access units as FFmpeg's packets; RTP carries presentation times, no decoding times."""
    shown: list[int] = []
    yield _packet(first, shown, reordered)
    for unit in units:
        yield _packet(unit, shown, reordered)


def _packet(unit: Unit, shown: list[int], reordered: bool) -> Packet[CodedStream]:
    packet = cast("Packet[CodedStream]", Packet(unit.data))
    pts = unit.time
    shown[:] = [*shown, pts][-(REORDERED + 1 if reordered else 1) :]
    packet.pts, packet.dts, packet.time_base = pts, min(shown), Fraction(1, TICK_HZ)
    packet.is_keyframe, packet.is_corrupt = unit.key, not unit.whole
    return packet
