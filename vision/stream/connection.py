"""One open connection to a source: coded packets, whatever the transport.

Datagrams come from a port of ours (``vision.stream.port``), all else is opened by FFmpeg, with limits to its patience.
Where a stream has no time stamps its packets are dated by arrival (``vision.stream.byte_stream``).

A redirect of an HTTP server is followed to the same host alone: its server may move a stream there or begin to encrypt;
that it has this computer ask another host, or open a file, is refused.
"""

from __future__ import annotations

import io
import ssl
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TypeAlias, cast
from urllib.parse import urljoin, urlsplit

import av
import av.logging
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from infra.plain_text import plain
from infra.secrets import concealed
from vision.errors import VideoError
from vision.stream.byte_stream import TICK_HZ as ARRIVAL_HZ
from vision.stream.byte_stream import Arrivals, ByteStream, has_no_stamps
from vision.stream.exposure_times import Exposures, klv_time_s, sei_time_s, sender_report
from vision.stream.messages import Sender
from vision.stream.port import Port
from vision.stream.rtp import TICK_HZ, Depacketizer, Unit, parse
from vision.stream.source import Codec, Source
from vision.stream.stamps import HeldBack
from vision.stream.trial import SEARCH, mpegts_payload
from vision.video.frame_index import ONE_FILE, reason

OPEN_TIMEOUT_S = 3.0
"""Longest wait for a connection, seconds."""
WAIT_S = 30.0
"""Longest wait for others to connect, before it is started again, seconds."""
READ_TIMEOUT_S = 2.0
"""Longest wait for the next packet, seconds."""
HTTP = ("http:", "https:")
BYTE_STREAMS = ("tcp:", "srt:", *HTTP)
ONE_STREAM = {"format_whitelist": f"{ONE_FILE},mpjpeg"}
"""Formats that others may send: a playlist or a session would have FFmpeg ask any host and open any port."""
MAX_REDIRECTS = 4
"""Most redirects on the same host, one after the other."""
READ_BYTES = 32768
"""Most bytes that FFmpeg asks for at once."""
_REFUSED = {
    "Format not on whitelist": "it is no film but perhaps a playlist or a session, whose addresses are not followed: "
    "give the one that is meant",
    "not on whitelist": "it sends on to another address, which is not followed: give that one if it is meant",
}
"""Messages by words of FFmpeg's errors."""
_PRODUCER_TIME = struct.Struct("=qi")
"""FFmpeg's AVProducerReferenceTime: Unix µs, flags."""
REORDERED = 2
"""Frames that a stream with B-frames holds back, where no decoding times are given."""
Packets: TypeAlias = "Iterator[Packet[CodedStream]]"
SCHEMES = ("http", "https")
_MAX_SHOWN = 200


def redirected(source: Source, timeout_s: float) -> Source | None:
    """The source at the address to which its server redirects; None where it does not.

    The server is asked without a password.

    Raises:
        VideoError: the server names another host, or something else than HTTP.
    """
    named = _named(source.address, timeout_s)
    if not named:
        return None
    parts = urlsplit(source.address)
    goal = urlsplit(urljoin(source.address, named))
    if goal.scheme not in SCHEMES or goal.hostname != parts.hostname:
        shown = plain(concealed(goal.geturl()))[:_MAX_SHOWN]
        raise VideoError(
            f"video {source.text}: its server sends on to {shown}, which is not followed: only what is on the same "
            "host is; give that address if it is meant"
        )
    user, at, _ = parts.netloc.rpartition("@")
    place = goal.netloc.rpartition("@")[2]
    return replace(source, address=goal._replace(netloc=f"{user}{at}{place}", fragment="").geturl())


def _named(address: str, timeout_s: float) -> str:
    """The address in the server's answer, empty where there is none."""
    # only after a failure: each process of a stream would load it
    from http.client import HTTPConnection, HTTPException, HTTPSConnection

    parts = urlsplit(address)
    unverified = ssl.create_default_context()  # as FFmpeg asks: cameras sign their certificates themselves
    unverified.check_hostname, unverified.verify_mode = False, ssl.CERT_NONE
    try:
        place = parts.hostname or "", parts.port
        line = (
            HTTPSConnection(*place, timeout=timeout_s, context=unverified)
            if parts.scheme == "https"
            else HTTPConnection(*place, timeout=timeout_s)
        )
        with closing(line):
            line.request("GET", parts._replace(scheme="", netloc="", fragment="").geturl() or "/")
            answer = line.getresponse()
            return answer.headers.get("Location", "") if 300 <= answer.status < 400 else ""
    except (OSError, HTTPException, ValueError):
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """Packets of a connection and what decodes them."""

    stream: CodedStream
    tick_s: float
    """Unit of the packets' time stamps."""
    packets: Packets
    container: InputContainer
    arrival_s: Callable[[Packet[CodedStream]], float] = lambda _: time.time()
    """Unix time at which a packet came in, asked for as it comes out."""
    live: Callable[[], bool] = lambda: True
    """False once nothing more comes and only what was held back is handed out."""
    shown: Callable[[], None] = lambda: None
    """Callback for when a frame was decoded, or was left out on purpose."""
    drains: bool = False
    """True if it ends by itself when it is time to stop, and hands out its last packet then."""
    exposures: Exposures = field(default_factory=Exposures)
    """Exposure times that the stream itself carries."""
    line: ByteStream | None = None
    """File that the container reads from, where that is not FFmpeg's own."""

    def close(self) -> None:
        """Hang up."""
        self.container.close()
        if self.line is not None:
            self.line.close()


def open_input(source: Source) -> Input | None:
    """Connect by FFmpeg; None where others are to connect and nobody has yet.

    Raises:
        VideoError: nothing there, no answer within the time, no video in it, or it is said to be on another host.
    """
    av.logging.set_level(av.logging.PANIC)
    for _ in range(MAX_REDIRECTS):
        begin_s = time.monotonic()
        try:
            return _open_line(source) or _input(source, _open(source))
        except (av.FFmpegError, OSError, ValueError) as error:
            late = time.monotonic() - begin_s >= _patience_s(source)
            if late and source.waits:
                return None
            goal = None if late or not source.address.startswith(HTTP) else redirected(source, OPEN_TIMEOUT_S)
            if goal is None:
                why = f"no answer within {OPEN_TIMEOUT_S:g} s" if late else _why(error)
                raise VideoError(f"video {source.text}: cannot be opened ({why}); is it being sent?") from error
            source = goal
    raise VideoError(f"video {source.text}: its server sends on and on")


def _why(error: Exception) -> str:
    """FFmpeg's reason, in words where it is one of ours."""
    for refused, words in _REFUSED.items():
        if refused in str(error):
            return words
    return reason(error)


def _open_line(source: Source) -> Input | None:
    """Read a TCP, HTTP or SRT connection here, so that its pictures can be dated; None of what FFmpeg has to read."""
    if not source.address.startswith(BYTE_STREAMS):
        return None
    line = ByteStream(source, (_patience_s(source), READ_TIMEOUT_S))
    try:
        # playlists and files over HTTP are read in pieces
        if source.address.startswith(HTTP) and not line.begins_as_stream():
            line.close()
            return None
        opened = replace(
            _input(source, av.open(line, "r", options=SEARCH | ONE_STREAM, buffer_size=READ_BYTES)), line=line
        )
    except BaseException:
        line.close()
        raise
    if not has_no_stamps(opened.container):
        return replace(opened, arrival_s=lambda packet: line.arrivals.of(packet.pos))
    return replace(
        opened, tick_s=1 / ARRIVAL_HZ, packets=line.dated(opened.packets), arrival_s=lambda _: line.arrival_s
    )


def datagrams(source: Source, port: Port, go_on: Callable[[], bool]) -> Input | None:
    """The next connection on a port, waited for without end; None when it is time to stop.

    Raises:
        VideoError: what comes is no video that is known here.
    """
    av.logging.set_level(av.logging.PANIC)
    trial = port.wait()
    if trial is None:
        in_vain = port.senders.undecodable() if go_on() else None
        if in_vain is not None:
            raise VideoError(_undecodable(source, *in_vain))
        return None
    if trial.kind == "rtp":
        return _rtp(source, port, trial.codec)
    file = _Bytes(port)
    return replace(_of_port(port, _mpegts(source, file)), arrival_s=lambda packet: file.arrivals.of(packet.pos))


def _undecodable(source: Source, sender: Sender, rtp: bool) -> str:
    if rtp:
        return (
            f"video {source.text}: RTP comes from {sender}, but no frame yet that decoding can begin with; let the "
            "sender repeat its SPS and PPS with every key frame, or name its .sdp file instead"
        )
    return (
        f"video {source.text}: what comes from {sender} is neither MPEG-TS nor RTP with H.264 or H.265 that can be "
        "decoded"
    )


def _of_port(port: Port, opened: Input) -> Input:
    return replace(opened, arrival_s=lambda _: port.arrival_s, live=lambda: port.live, shown=port.senders.shown)


def _patience_s(source: Source) -> float:
    return WAIT_S if source.waits else OPEN_TIMEOUT_S


def _open(source: Source) -> InputContainer:
    timeout = (_patience_s(source), READ_TIMEOUT_S)
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
        if source.kind == "file" or source.address.startswith(HTTP):
            options |= ONE_STREAM
        container = av.open(source.address, options=options, timeout=timeout)
    return container


def _input(source: Source, container: InputContainer) -> Input:
    if not container.streams.video:
        container.close()
        raise VideoError(f"video {source.text}: no video stream in it")
    stream = container.streams.video[0]
    if stream.codec_context is None:
        container.close()
        raise VideoError(f"video {source.text}: FFmpeg does not know how its pictures are coded")
    # slices only: threads over frames would hold frames back
    stream.thread_type = "SLICE"
    tick_s = float(stream.time_base or 1e-6)
    drains = source.kind == "datagrams"
    opened = Input(stream=stream, tick_s=tick_s, packets=iter(()), container=container, drains=drains)
    if source.kind == "session" or source.address.startswith("rtsp"):
        opened = replace(opened, arrival_s=HeldBack(tick_s))
    return replace(opened, packets=_video_packets(opened, bare=has_no_stamps(container) and not source.paced))


def _video_packets(opened: Input, *, bare: bool) -> Packets:
    """Packets of the video, ``bare`` without time stamps; metadata beside it is evaluated."""
    for packet in opened.container.demux([opened.stream, *opened.container.streams.data]):
        if packet.stream is opened.stream:
            if bare:
                packet.pts = packet.dts = None
            yield cast("Packet[CodedStream]", packet)
        elif packet.pts is not None and packet.time_base is not None:
            taken_s = klv_time_s(bytes(packet))
            if taken_s is not None:
                opened.exposures.add("KLV", float(packet.pts * packet.time_base), taken_s, time.time())


def listen(opened: Input, packet: Packet[CodedStream], arrival_s: float) -> None:
    """Read the exposure time of a packet's frame: from its own time stamp, and from what the RTSP server reported.

    Args:
        arrival_s: Unix time at which it came.
    """
    stamp_s, taken_s = (packet.pts or 0) * opened.tick_s, sei_time_s(bytes(packet))
    if taken_s is not None:
        opened.exposures.add("SEI", stamp_s, taken_s, arrival_s)
    elif packet.has_sidedata("prft"):
        wall_us, _ = _PRODUCER_TIME.unpack_from(bytes(packet.get_sidedata("prft")))
        opened.exposures.add("RTCP", stamp_s, wall_us * 1e-6, arrival_s)


class _Bytes:
    """File that FFmpeg reads from: the transport stream in the datagrams of one connection."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._rest = b""
        self.arrivals = Arrivals()

    def read(self, size: int) -> bytes:
        """Read at most ``size`` bytes, none at the end."""
        while not self._rest:
            data = self._port.read()
            if not data:
                return b""
            self._rest = mpegts_payload(data)
            self.arrivals.add(len(self._rest), self._port.arrival_s)
        piece, self._rest = self._rest[:size], self._rest[size:]
        return piece


def _mpegts(source: Source, file: _Bytes) -> Input:
    try:
        container = av.open(file, "r", format="mpegts", options=dict(SEARCH), buffer_size=READ_BYTES)
    except (av.FFmpegError, OSError, ValueError) as error:
        raise VideoError(f"video {source.text}: what comes cannot be read ({reason(error)})") from error
    return _input(source, container)


def _rtp(source: Source, port: Port, codec: Codec) -> Input | None:
    """Open at the first frame that decoding can begin with; None when the connection ends before."""
    depacketizer, exposures = Depacketizer(codec), Exposures()
    units = _units(port, depacketizer, exposures)
    for unit in units:
        if not unit.key:
            continue
        try:
            probe = av.open(io.BytesIO(unit.data), "r", format=depacketizer.codec, options={"fpsprobesize": "0"})
            opened = _input(source, probe)
        except (av.FFmpegError, OSError, ValueError):
            continue
        if opened.stream.codec_context.width:
            packets = _packets(unit, units, bool(opened.stream.codec_context.has_b_frames))
            return _of_port(port, replace(opened, tick_s=1 / TICK_HZ, packets=packets, exposures=exposures))
        opened.close()
    return None


def _units(port: Port, depacketizer: Depacketizer, exposures: Exposures) -> Iterator[Unit]:
    """Access units, and the exposure times that reports give them."""
    while data := port.read():
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
