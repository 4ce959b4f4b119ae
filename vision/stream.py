"""Live video: the newest picture for whoever asks, every packet into a file, a time for every picture.

One thread reads, records and decodes. Who asks too seldom gets the newest picture only; the others are counted and
still listed, since the recording has them. URLs are FFmpeg's: ``udp://127.0.0.1:5600`` (MPEG-TS), ``rtsp://…``, ``tcp://…``,
``/dev/video0``; ``rtp://0.0.0.0:5600`` is plain RTP with H.264 (``?codec=H265`` for H.265); a file plays as if live.
"""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import av
import av.logging
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream as CodedStream

from vision.arrival import JUMP_S, ArrivalClock
from vision.errors import VideoError
from vision.pictures import bgr, reason
from vision.recording import PictureOrder, Recording
from vision.video import Frame

__all__ = ["VideoStream"]

OPEN_TIMEOUT_S = 3.0
READ_TIMEOUT_S = 2.0
CLOSE_TIMEOUT_S = 2.3
PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Before the next attempt to connect; the last repeats."""
STALL_S = 1.0
LAG_S = 0.7
"""Packets that come this late are recorded but not decoded, up to the next key picture: decoding had fallen behind."""
WAITED_S = 0.003
"""A packet that one had to wait this long for was not buffered while the connection was opened."""
PROBED = 600
"""Most packets held back while those buffered at opening are drained."""


class VideoStream:
    """A live source.

    Args:
        url: see the module.
        record_path: .mkv to be created, None to record nothing.
        offset_s: video time minus telemetry time, s; taken from every picture's time.
        on_frame: called from the reading thread with index and Unix µs of every recorded picture, in order.

    Attributes:
        connected: whether packets are coming in.
        ended: whether a file came to its end.
        received: pictures listed so far.
        skipped: pictures that were decoded and that nobody asked for in time.
        undecoded: packets recorded but never decoded, because of damage or because decoding had fallen behind.
        reconnects: connections after the first.
        error: last trouble in a line, empty when there was none.

    Raises:
        VideoError: the recording exists already. Trouble with the source is no error: it is tried again.
    """

    def __init__(
        self,
        url: str,
        record_path: Path | None = None,
        offset_s: float = 0.0,
        *,
        on_frame: Callable[[int, int], None] | None = None,
    ) -> None:
        self.url = url
        self.connected = False
        self.ended = False
        self.received = self.skipped = self.undecoded = self.reconnects = 0
        self.error = ""
        self._offset_s = offset_s
        self._on_frame = on_frame
        self._recording = None if record_path is None else Recording(record_path)
        self._order = PictureOrder()
        self._epoch_s: float | None = None
        self._last_us = 0
        self._heard_s = time.monotonic()
        self._stop = threading.Event()
        self._fresh = threading.Condition()
        self._newest: tuple[int, int, VideoFrame] | None = None
        self._thread = threading.Thread(target=self._run, name="video", daemon=True)
        self._thread.start()

    @property
    def stalled(self) -> bool:
        """Whether nothing has come for a second."""
        return not self.ended and time.monotonic() - self._heard_s > STALL_S

    @property
    def recording_error(self) -> str:
        """Why the recording broke off, empty while it is well."""
        return "" if self._recording is None else self._recording.error

    def latest(self, timeout_s: float) -> Frame | None:
        """The newest picture that was not given out yet; None when none comes within ``timeout_s``."""
        with self._fresh:
            if not self._fresh.wait_for(lambda: self._newest is not None or self._over(), timeout_s):
                return None
            newest, self._newest = self._newest, None
        if newest is None:
            return None
        index, t_us, picture = newest
        return Frame(index=index, t_us=t_us, image=bgr(picture, picture.width, picture.height))

    def close(self) -> None:
        """Stop reading and seal the recording; returns within 2.5 s, may be called twice."""
        self._stop.set()
        with self._fresh:
            self._fresh.notify_all()
        self._thread.join(CLOSE_TIMEOUT_S)

    def __enter__(self) -> VideoStream:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def _over(self) -> bool:
        return self._stop.is_set() or self.ended

    def _run(self) -> None:
        """Connect, read until it breaks, and again with growing pauses."""
        attempt = 0
        while not self._over():
            heard = self._connect()
            attempt = 0 if heard else attempt + 1
            if not self._over():
                self._stop.wait(PAUSES_S[min(attempt, len(PAUSES_S) - 1)])
        if self._recording is not None:
            self._recording.close()
        with self._fresh:
            self._fresh.notify_all()

    def _connect(self) -> bool:
        """One connection from open to break; whether a packet came."""
        try:
            container = _open(self.url)
        except VideoError as error:
            self.error = str(error)
            return False
        before = self.received
        try:
            self.reconnects += self._epoch_s is not None
            _Connection(self, container).run()
            self.ended = _is_file(self.url)
        except av.FFmpegError as error:
            self.error = f"video {self.url}: {reason(error)}"
        finally:
            self.connected = False
            container.close()
        return self.received > before


class _Connection:
    """Packets of one connection: their times, the recording, the decoder."""

    def __init__(self, owner: VideoStream, container: InputContainer) -> None:
        self._owner = owner
        self._container = container
        self._stream = container.streams.video[0]
        # slices only: threads over frames would hold pictures back
        self._stream.thread_type = "SLICE"
        self._clock = ArrivalClock()
        self._tick_s = float(self._stream.time_base or 1e-6)
        self._paced = _is_file(owner.url)
        self._first: tuple[float, float] | None = None
        self._opened_s = time.time()
        self._bare = True
        self._placed: dict[int, tuple[int, int]] = {}
        self._decoding = False
        self._key_pts: int | None = None
        self._stamp_s: float | None = None
        self._base_s: float | None = None

    def run(self) -> None:
        """Until the source ends, breaks or is closed."""
        owner = self._owner
        held: list[tuple[Packet[CodedStream], float]] | None = [] if not self._paced else None
        asked_s = time.monotonic()
        for packet in self._container.demux(self._stream):
            if owner._stop.is_set():
                break
            if not packet.size:
                continue
            waited_s = time.monotonic() - asked_s
            arrival_s = self._arrive(packet)
            owner.connected, owner._heard_s = True, time.monotonic()
            if held is None:
                self._settle([(packet, arrival_s)])
            else:
                # packets buffered while opening came earlier than now: hold them until one comes that is on time
                held.append((packet, arrival_s))
                if waited_s > WAITED_S or len(held) >= PROBED:
                    self._settle(held)
                    held = None
            asked_s = time.monotonic()
        self._settle(held or [])
        self._show(None)
        self._list(owner._order.flush())

    def _arrive(self, packet: Packet[CodedStream]) -> float:
        """Unix time of arrival; a file's packets arrive at the pace of their time stamps."""
        if self._paced and packet.dts is not None:
            decoded_s = packet.dts * self._tick_s
            self._first = self._first or (decoded_s, time.monotonic())
            self._owner._stop.wait(max(decoded_s - self._first[0] - (time.monotonic() - self._first[1]), 0.0))
        return time.time()

    def _settle(self, packets: list[tuple[Packet[CodedStream], float]]) -> None:
        """Learn the arrivals of packets that came together, then use the packets."""
        self._stamp(packets)
        stamped = [(packet, arrival_s) for packet, arrival_s in packets if packet.pts is not None]
        for packet, arrival_s in stamped:
            self._clock.see((packet.pts or 0) * self._tick_s, arrival_s)
        for packet, arrival_s in stamped:
            self._take(packet, arrival_s)

    def _stamp(self, packets: list[tuple[Packet[CodedStream], float]]) -> None:
        """Give a time to packets without: RTP's first comes so, and raw streams never have any."""
        following: list[int] = []
        for packet, arrival_s in reversed(packets):
            if packet.pts is None and packet.dts is not None:
                packet.pts = packet.dts
            if packet.pts is not None:
                self._bare = False
            elif following:
                step = following[1] - following[0] if len(following) > 1 else round(1 / 30 / self._tick_s)
                packet.pts = packet.dts = following[0] - max(step, 1)
            elif self._bare:
                packet.pts = packet.dts = round((arrival_s - self._opened_s) / self._tick_s)
            if packet.pts is not None:
                following = [packet.pts, *following[:1]]

    def _take(self, packet: Packet[CodedStream], arrival_s: float) -> None:
        """Record, number, time and decode one packet, from the first key picture on."""
        owner, order, pts = self._owner, self._owner._order, packet.pts or 0
        stamp_s = pts * self._tick_s
        if self._stamp_s is not None and abs(stamp_s - self._stamp_s) > JUMP_S:
            self._renew()
        self._stamp_s = stamp_s
        if self._key_pts is None and packet.is_keyframe:
            self._key_pts = pts
        # pictures shown before the first key picture have nothing to be decoded from
        if self._key_pts is None or pts < self._key_pts or order.repeats(pts):
            return
        taken_s = self._clock.unix_s(stamp_s) - owner._offset_s
        owner._epoch_s = taken_s if owner._epoch_s is None else owner._epoch_s
        if owner._recording is not None:
            if self._base_s is None:
                self._base_s = taken_s - owner._epoch_s - stamp_s
            owner._recording.write(packet, self._stream, stamp_s + self._base_s)
        self._list(order.add(pts, pts if packet.dts is None else packet.dts))
        late = not self._paced and self._clock.lag_s(stamp_s, arrival_s) > LAG_S
        self._decoding = (self._decoding or packet.is_keyframe) and not (late and not packet.is_keyframe)
        if self._decoding:
            self._show(packet)
        else:
            owner.undecoded += 1

    def _renew(self) -> None:
        """The sender's time stamps began anew."""
        self._list(self._owner._order.flush())
        self._placed.clear()
        self._key_pts = self._base_s = None

    def _list(self, released: list[tuple[int, int]]) -> None:
        """Give pictures whose place is certain their time, and tell it."""
        owner = self._owner
        for index, pts in released:
            t_us = round((self._clock.unix_s(pts * self._tick_s) - owner._offset_s) * 1e6)
            owner._last_us = t_us = max(t_us, owner._last_us + 1)
            self._placed[pts] = index, t_us
            owner.received += 1
            if owner._on_frame is not None:
                owner._on_frame(index, t_us)
        while len(self._placed) > 256:
            del self._placed[next(iter(self._placed))]

    def _show(self, packet: Packet[CodedStream] | None) -> None:
        """Decode; the last picture that comes out is the newest."""
        owner = self._owner
        try:
            pictures = self._stream.codec_context.decode(packet)
        except av.FFmpegError:
            owner.undecoded += 1
            return
        for picture in pictures:
            place = self._placed.get(picture.pts if picture.pts is not None else -1)
            if place is None and picture.pts is not None:
                stamp_us = round((self._clock.unix_s(picture.pts * self._tick_s) - owner._offset_s) * 1e6)
                place = owner._order.place(picture.pts), stamp_us
            if place is not None:
                with owner._fresh:
                    owner.skipped += owner._newest is not None
                    owner._newest = (*place, picture)
                    owner._fresh.notify_all()


def _open(url: str) -> InputContainer:
    """Connect, silently and in bounded time."""
    av.logging.set_level(av.logging.PANIC)
    timeout = (OPEN_TIMEOUT_S, READ_TIMEOUT_S)
    try:
        container: InputContainer
        if url.startswith("rtp://"):
            options = {"protocol_whitelist": "file,udp,rtp,data"}
            container = av.open(io.BytesIO(_sdp(url)), format="sdp", options=options, timeout=timeout)
        elif url.startswith("/dev/video"):
            container = av.open(url, format="v4l2", timeout=timeout)
        else:
            container = av.open(url, options=_options(url), timeout=timeout)
    except (av.FFmpegError, OSError, ValueError) as error:
        raise VideoError(f"video {url}: cannot be opened ({reason(error)}); is it being sent?") from error
    if not container.streams.video:
        container.close()
        raise VideoError(f"video {url}: no video stream in it")
    return container


def _options(url: str) -> dict[str, str]:
    """What keeps delay low and bursts whole."""
    if url.startswith("rtsp"):
        return {"rtsp_transport": "tcp"}
    if url.startswith("udp"):
        return {"buffer_size": "4194304", "overrun_nonfatal": "1", "analyzeduration": "1500000"}
    return {}


def _is_file(url: str) -> bool:
    return "://" not in url and not url.startswith("/dev/")


def _sdp(url: str) -> bytes:
    """The session description that plain RTP comes without."""
    parts = urlsplit(url)
    codec = parse_qs(parts.query).get("codec", ["H264"])[0].upper()
    host = parts.hostname or "0.0.0.0"
    lines = ["v=0", f"o=- 0 0 IN IP4 {host}", "s=video", f"c=IN IP4 {host}", "t=0 0"]
    lines += [f"m=video {parts.port or 5600} RTP/AVP 96", f"a=rtpmap:96 {codec}/90000"]
    return ("\r\n".join(lines) + "\r\n").encode()
