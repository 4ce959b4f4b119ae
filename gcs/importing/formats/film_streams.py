"""Streams that a video file carries beside its pictures: subtitles, KLV, and messages (SEI) among the coded pictures.

The file is read through once without decoding, in a process of its own, which FFmpeg may bring down. Times are µs since
the video's first frame.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import av
import msgspec

from gcs.export.motion_imagery.misb import SETS_KEY
from gcs.importing.formats.sei import unregistered_messages
from gcs.importing.formats.subtitles import MAX_CUES, SubtitleCue
from gcs.importing.formats.timed_bytes import TimedBytes
from infra.plain_text import plain
from infra.processes.bounded import UnreadError, answer_parent, ask_child
from vision.errors import VideoError
from vision.video.frame_index import film_stream, open_video

_MAX_BYTES = 256 << 20
"""Maximum bytes of everything that is kept: three hours of messages with each picture."""
_MAX_MESSAGES = MAX_CUES
_MORE_BYTES, _TIMES_ITS_SIZE = 3 * _MAX_BYTES, 3
"""Bytes of memory that a film may take: this, as what is kept is read, told and sent, and this many times its size."""
_READING_S, _READING_BYTES_A_SECOND = 60.0, 1_000_000
"""Longest time to read a film through: this many s, and its size at this pace."""
_WITH_MESSAGES = ("h264", "hevc")
_DJI_NAMES = ("DJI meta", "djmd")


class FilmStreams(msgspec.Struct, tag=True):
    """Streams that were found."""

    cues: list[SubtitleCue] = []
    klv: list[TimedBytes] = []
    """Packets with a set of MISB ST 0601, perhaps behind others."""
    messages: list[TimedBytes] = []
    """User data of the pictures, each beginning with its UUID."""
    unread: list[str] = []
    """Streams that carry something of which the layout is not published."""
    dropped: int = 0
    """Messages beyond what is kept."""


class _Question(msgspec.Struct):
    path: bytes
    """Path as the system has it: names need not be UTF-8."""


def read_streams(path: Path) -> FilmStreams:
    """Read a video file through.

    Raises:
        VideoError: no such file, or no video in it; FFmpeg does not read it in bounds.
    """
    size = path.stat().st_size if path.is_file() else 0
    most_bytes, most_s = _MORE_BYTES + _TIMES_ITS_SIZE * size, _READING_S + size / _READING_BYTES_A_SECOND
    try:
        return ask_child(__name__, _Question(os.fsencode(path)), FilmStreams, most_bytes=most_bytes, most_s=most_s)
    except UnreadError as error:
        raise VideoError(f"video {path}: {error}") from error
    except OSError as error:
        raise VideoError(f"video {path}: no process starts to read it: {error.strerror}") from error


def _read(question: _Question) -> FilmStreams:
    path = Path(os.fsdecode(question.path))
    try:
        return _read_through(path)
    except VideoError as error:
        # who asked knows the path, which may be longer than what is told
        raise VideoError(str(error).removeprefix(f"video {path}: ")) from error


def _read_through(path: Path) -> FilmStreams:
    rows: list[tuple[str, float, bytes]] = []
    found, size, first_s = FilmStreams(), 0, math.inf
    with closing(open_video(path)) as container:
        video = film_stream(container)
        found.unread += _unread(container.streams.data)
        for stream, t_s, data in _packets(container, [video, *container.streams.subtitles, *container.streams.data]):
            if stream is video:
                first_s = min(first_s, t_s)
            for kind, part in _parts(stream, data):
                size += len(part)
                if size > _MAX_BYTES or len(rows) >= _MAX_MESSAGES:
                    found.dropped += 1
                else:
                    rows.append((kind, t_s, part))
    for kind, t_s, part in rows:
        t_us = round((t_s - first_s) * 1e6) if math.isfinite(first_s) else 0
        if kind == "text":
            found.cues.append(SubtitleCue(max(t_us, 0), part.decode("utf-8", "replace")))
        else:
            (found.klv if kind == "klv" else found.messages).append(TimedBytes(t_us, part))
    return found


def _unread(streams: Iterable[Any]) -> Iterator[str]:
    """Streams that are known and that nobody describes."""
    for stream in streams:
        words = " ".join(str(value) for value in stream.metadata.values())
        if any(name in words for name in _DJI_NAMES):
            yield f"the track {plain(words)[:60]!r}: DJI does not publish its layout"


def _parts(stream: Any, data: bytes) -> Iterator[tuple[str, bytes]]:  # noqa: ANN401 - untyped streams
    """Parts of a packet that count, with their kind."""
    # there is none for what FFmpeg has no decoder of
    codec = stream.codec_context.name if stream.codec_context is not None else ""
    if stream.type == "video":
        if codec in _WITH_MESSAGES:
            hevc = codec == "hevc"
            size = _length_size(stream.codec_context.extradata, hevc=hevc)
            yield from (("message", part) for part in unregistered_messages(data, size, hevc=hevc))
    elif stream.type == "subtitle":
        # a subtitle in MP4 has its length in front, and boxes about style behind
        if codec == "mov_text":
            data = data[2 : 2 + int.from_bytes(data[:2], "big")]
        if data:
            yield "text", data
    elif SETS_KEY in data:
        yield "klv", data


def _packets(container: Any, streams: list[Any]) -> Iterator[tuple[Any, float, bytes]]:  # noqa: ANN401 - untyped streams
    """Stream, seconds and content of each packet up to the end or to where the file breaks off.

    Data without time stamps, as MISB ST 1402 allows, have the time of the pictures that they stand beside.
    """
    picture_s = math.nan
    try:
        for packet in container.demux(*streams):
            stamp = packet.pts if packet.pts is not None else packet.dts
            t_s = picture_s if stamp is None or not packet.time_base else float(stamp * packet.time_base)
            if packet.stream is streams[0]:
                picture_s = t_s
            # of a trimmed film what is hidden is not shown, nor counted from
            if packet.size and math.isfinite(t_s) and not packet.is_discard:
                yield packet.stream, t_s, bytes(packet)
    except (av.FFmpegError, ValueError):
        return


def _length_size(extradata: bytes | None, *, hevc: bool) -> int:
    """Bytes of the length before each coded unit, by the decoder's configuration; 0: start codes."""
    if not extradata or extradata[0] != 1:
        return 0
    # ISO/IEC 14496-15: lengthSizeMinusOne is in the fifth byte of avcC, in the 22nd of hvcC
    place = 21 if hevc else 4
    return (extradata[place] & 3) + 1 if len(extradata) > place else 4


if __name__ == "__main__":
    answer_parent(_Question, _read)
