"""The index of a video file's frames, and a decoder that goes to any of them.

Ticks are the stream's own unit of time. The index is made without decoding.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path

import av
import av.logging
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from infra.clock_steps import restarts, set_back
from vision.errors import VideoError

ONE_FILE = (
    "matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,avi,mpegts,mpeg,mpegvideo,m4v,flv,ogg,asf,nut,mxf,gxf,dv,rm,wtv,ivf,obu,"
    "h264,hevc,vvc,av1,mjpeg,yuv4mpegpipe,gif"
)
"""Containers that are one file: a playlist would have FFmpeg open whatever its author names, pipes included."""
_MIN_ASPECT = 0.1
"""A pixel that is narrower than this is a damaged number."""
_AGREE = 3
"""Frames on either side of where time stamps begin again: those that are shown later than coded do not agree."""
_MAX_TRIED = 64
"""Most packets that are decoded to find the first picture."""
_MAX_COUNTED = 1000
"""Most packets that are read to find out which tracks are films."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameIndex:
    """Every frame's time stamp."""

    width: int
    height: int
    pts: list[int]
    """Time stamps in display order, ticks."""
    order: dict[int, int]
    """Index by time stamp."""
    key_pts: NDArray[np.int64]
    """Frames that decoding can begin at, ascending."""
    tick_us: float
    quarter_turns: int = 0
    """Quarter turns counterclockwise that the container asks for."""
    aspect: float = 1.0
    """Width of a coded pixel by its height."""
    shown_as: str = ""
    """Difference in words between how pictures are shown and how they are coded; empty as coded."""


def read_index(path: Path) -> FrameIndex:
    """Read a file through without decoding more than one frame: width and height are those that players show."""
    with closing(open_video(path)) as container:
        stream = film_stream(container)
        if stream.codec_context is None:
            raise VideoError(f"video {path}: FFmpeg does not know how its pictures are coded")
        stamps: list[int] = []
        keys: list[int] = []
        key_rows: list[int] = []
        for pts, packet in _decodable(container, stream):
            if packet.is_keyframe:
                keys.append(pts)
            if not packet.is_discard:
                key_rows += [len(stamps)] if packet.is_keyframe else []
                stamps.append(pts)
        shown = sorted(set(stamps))
        if not shown or not stream.codec_context.width:
            raise VideoError(f"video {path}: no frame with a time stamp in it; remux it, for example to .mkv")
        _check_one_film(path, stamps, key_rows, stream.time_base)
        width, height, quarter_turns, aspect, shown_as = _picture(path, stream)
        return FrameIndex(
            width=width,
            height=height,
            quarter_turns=quarter_turns,
            aspect=aspect,
            shown_as=shown_as,
            pts=shown,
            order={stamp: i for i, stamp in enumerate(shown)},
            key_pts=np.array(sorted(keys), dtype=np.int64),
            tick_us=float((stream.time_base or Fraction(1, 1_000_000)) * 1_000_000),
        )


def film_stream(container: InputContainer) -> VideoStream:
    """The film among a file's video tracks: cover pictures and tracks of one frame are passed over."""
    tracks = container.streams.video
    # how many frames a track has, MP4 and MOV tell beforehand
    moving = [track for track in tracks if track.frames != 1] or tracks
    best = container.streams.best("video")
    return next((track for track in moving if best is not None and track.index == best.index), moving[0])


def count_films(container: InputContainer) -> int:
    """Count a file's video tracks of more than one picture; where a container does not tell, by its first packets."""
    tracks = container.streams.video
    packets = islice(container.demux(*tracks), _MAX_COUNTED) if len(tracks) > 1 else ()
    first = Counter(packet.stream_index for packet in packets if packet.size)
    return sum(max(track.frames, first[track.index]) > 1 for track in tracks)


def coded_packets(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int, Packet[VideoStream]]]:
    """Time stamp and packet of every frame that is shown and needs no hidden one, in the file's order."""
    shown = ((pts, packet) for pts, packet in _stamped(container, stream) if not packet.is_discard)
    yield from _from_key(shown)


def _decodable(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int, Packet[VideoStream]]]:
    """Yield time stamp and packet of every frame that can be decoded: the first ones of a trimmed film are hidden, and
    needed."""
    return _from_key(_stamped(container, stream))


def _stamped(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int, Packet[VideoStream]]]:
    for packet in _packets(container, stream):
        pts = _stamp(packet)
        if pts is not None:
            yield pts, packet


def _from_key(packets: Iterable[tuple[int, Packet[VideoStream]]]) -> Iterator[tuple[int, Packet[VideoStream]]]:
    first: int | None = None
    for pts, packet in packets:
        if packet.is_keyframe and first is None:
            first = pts
        # frames ahead of the first key frame have nothing to be decoded from
        if first is not None and pts >= first:
            yield pts, packet


def _check_one_film(path: Path, stamps: list[int], key_rows: list[int], tick: Fraction | None) -> None:
    """See that time stamps do not begin again: frames of two films would lie between each other.

    Frames may be shown later than those behind them in the file, but none in front of a key frame later than that.

    Raises:
        VideoError: they do.
    """
    tick = tick or Fraction(1, 1_000_000)
    times = np.array(stamps, dtype=np.int64)
    behind = times < np.maximum.accumulate(times)
    keys_behind = [row for row in key_rows if behind[row] and np.count_nonzero(times[:row] >= times[row]) > 1]
    back = set_back(np.rint(times * float(tick * 1_000_000)).astype(np.int64))
    if again := [*restarts(times, round(1 / tick), _AGREE), *keys_behind, *back]:
        at = min(again)
        raise VideoError(
            f"video {path}: time stamps begin again after {at} of {len(stamps)} frames: two films in one file; cut it "
            "there, or remux it so that they go on"
        )


def _picture(path: Path, stream: VideoStream) -> tuple[int, int, int, float, str]:
    """Width, height and quarter turns of the pictures as they are shown, their pixels' aspect, and that in words."""
    coded = stream.codec_context
    width, height = coded.width, coded.height
    # how a picture is turned is told with a decoded one
    first = first_picture(path)
    turns = round(first.rotation / 90.0) % 4 if first is not None else 0
    aspect = float(stream.sample_aspect_ratio or coded.sample_aspect_ratio or 1.0)
    aspect = aspect if _MIN_ASPECT < aspect < 1.0 / _MIN_ASPECT else 1.0
    words = []
    if aspect != 1.0:
        # nothing is lost where the shorter side of a pixel is drawn out
        width, height = (round(width * aspect), height) if aspect > 1.0 else (width, round(height / aspect))
        words.append(f"pixels {aspect:.3g} times as wide as high")
    if turns:
        words.append(("turned by 90° to the left", "turned by 180°", "turned by 90° to the right")[turns - 1])
    if turns % 2:
        width, height = height, width
    note = f"coded {coded.width}×{coded.height} px, {', '.join(words)}" if words else ""
    return width, height, turns, aspect, note


def read_tags(path: Path) -> dict[str, str]:
    """The tags of a file's header by their names in capitals."""
    with closing(open_video(path)) as container:
        return {name.upper(): value for name, value in container.metadata.items()}


def first_picture(path: Path) -> VideoFrame | None:
    """The first picture of a file as it is decoded; None where none is."""
    with closing(open_video(path)) as container:
        return _first_frame(container, film_stream(container))


def _first_frame(container: InputContainer, stream: VideoStream) -> VideoFrame | None:
    """Decode the first frame; None where none does."""
    for _, packet in islice(_decodable(container, stream), _MAX_TRIED):
        try:
            for frame in stream.codec_context.decode(packet):
                return frame
        except av.FFmpegError:
            continue
    return None


class FrameReader:
    """One decoder at one place in the file."""

    def __init__(self, path: Path, index: FrameIndex) -> None:
        self._path = path
        self._index = index
        self._open()

    def close(self) -> None:
        """Release the file."""
        self._frames.close()
        self._container.close()

    def frames(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Index and image of the frames from the one that ``go`` went to."""
        for index, frame in self._frames:
            yield index, self._image(frame)

    def read(self, index: int) -> NDArray[np.uint8] | None:
        """Decode a frame, None when it does not decode."""
        if not self._ahead(index):
            self.go(index)
        for found, frame in self._frames:
            self._next = found + 1
            if found >= index:
                return self._image(frame) if found == index else None
        self._next = len(self._index.pts)
        return None

    def go(self, index: int) -> None:
        """Make ``index`` the next frame: begin to decode at a key frame before it."""
        target = self._index.pts[index]
        before = int(np.searchsorted(self._index.key_pts, target, side="right")) - 1
        step = 1
        # a container may land behind the place asked for, so what it shows is checked and asked again from earlier on
        while before > 0 and not self._land(int(self._index.key_pts[before]), target, index):
            before, step = before - step, step * 2
        if before <= 0 and index < len(self._index.pts):
            self._rewind(index)

    def _land(self, key: int, target: int, index: int) -> bool:
        """Seek to a key frame; whether decoding then begins at or before the target."""
        self._frames.close()
        try:
            self._container.seek(key, stream=self._stream, backward=True)
        except av.FFmpegError:
            return False
        packets = _packets(self._container, self._stream)
        for packet in packets:
            stamp = _stamp(packet)
            if packet.is_keyframe and stamp is not None:
                if stamp > target:
                    return False
                self._start(chain([packet], packets), index)
                return True
        return False

    def _rewind(self, index: int) -> None:
        """Start from the beginning of the file."""
        self.close()
        self._open(index)

    def _open(self, index: int = 0) -> None:
        self._container = open_video(self._path)
        self._stream = film_stream(self._container)
        # frame threads can wait for each other for ever when a decoder is given up in the middle of a frame
        self._stream.thread_type = "SLICE"
        self._start(_packets(self._container, self._stream), index)

    def _start(self, packets: Iterable[Packet[VideoStream]], index: int) -> None:
        """Decode these packets from now on and show the frames from ``index`` on."""
        self._frames = self._decode(packets, index)
        self._next = index

    def _ahead(self, index: int) -> bool:
        """Tell whether decoding on is the shortest way: no key frame lies between here and there."""
        if index < self._next or self._next >= len(self._index.pts):
            return False
        keys, pts = self._index.key_pts, self._index.pts
        return bool(np.searchsorted(keys, pts[self._next], "right") == np.searchsorted(keys, pts[index], "right"))

    def _decode(
        self, packets: Iterable[Packet[VideoStream]], start: int
    ) -> Generator[tuple[int, VideoFrame], None, None]:
        """Index and decoded frame from ``start`` on; damaged packets are skipped."""
        for packet in packets:
            yield from self._shown(packet, start)
        yield from self._shown(None, start)

    def _shown(self, packet: Packet[VideoStream] | None, start: int) -> Iterator[tuple[int, VideoFrame]]:
        """Frames that the decoder gives out for one packet, or at the end for None."""
        try:
            frames = self._stream.codec_context.decode(packet)
        except av.FFmpegError:
            return
        for frame in frames:
            stamp = frame.pts if frame.pts is not None else frame.dts
            index = -1 if stamp is None else self._index.order.get(stamp, -1)
            if index >= start:
                yield index, frame

    def _image(self, frame: VideoFrame) -> NDArray[np.uint8]:
        turns, size = self._index.quarter_turns, (self._index.width, self._index.height)
        if not turns:
            return bgr(frame, *size)
        coded = bgr(frame, *(size if turns % 2 == 0 else size[::-1]))
        return np.ascontiguousarray(np.rot90(coded, turns))


def bgr(frame: VideoFrame, width: int, height: int) -> NDArray[np.uint8]:
    """A decoded frame as an image (height, width, 3)."""
    return np.asarray(frame.to_ndarray(format="bgr24", width=width, height=height), dtype=np.uint8)


def open_video(path: Path) -> InputContainer:
    """A container with a video stream in it; FFmpeg's messages are off, as they would overwrite the screen."""
    av.logging.set_level(av.logging.PANIC)
    if not path.is_file():
        raise VideoError(f"video {path}: {'not a file' if path.exists() else 'no such file'}")
    if path.stat().st_size == 0:
        raise VideoError(f"video {path}: the file is empty")
    try:
        container: InputContainer = av.open(str(path), options={"format_whitelist": ONE_FILE})
    except (av.FFmpegError, OSError, ValueError) as error:
        raise VideoError(f"video {path}: not a video that can be read ({reason(error)})") from error
    if not container.streams.video:
        container.close()
        raise VideoError(f"video {path}: no video stream in it; is it a film, and whole?")
    return container


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[Packet[VideoStream]]:
    """The stream's packets up to the end or to where the file breaks off."""
    try:
        for packet in container.demux(stream):
            if packet.size:
                yield packet
    except av.FFmpegError:
        return


def _stamp(packet: Packet[VideoStream]) -> int | None:
    """Presentation time in ticks; the decoding time where a container has no other."""
    stamp = packet.pts if packet.pts is not None else packet.dts
    return None if stamp is None else int(stamp)


def reason(error: BaseException) -> str:
    """FFmpeg's message without the number and the path."""
    return str(getattr(error, "strerror", None) or error).strip().rstrip(".").lower()
