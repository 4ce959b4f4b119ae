"""A film as H.264 that can be shown frame by frame as it comes, for files in which each message is one picture.

Such players decode a message and show it: no frame may wait for a later one (no B-frames), pictures are in Annex B with
start codes, and every key frame has the parameter sets with it. A film that is so is copied; others are coded again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Final

import av
from av.bitstream import BitStreamFilterContext

from vision.video.coded_frames import CodedFilm
from vision.video.video import VideoFile

SEQUENCE: Final = 7
"""Type of the NAL unit with a stream's parameters (ITU-T H.264, table 7-1)."""
KEY: Final = 5
_UNITS = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)


def pictures_of(path: Path, note: Callable[[str], None]) -> Iterator[tuple[int, bytes]]:
    """Index and H.264 data of every frame of a film, in the order in which they are shown.

    Args:
        note: told in a line when the film is coded again, and why.

    Raises:
        VideoError: no video.
    """
    with CodedFilm(path) as film:
        why = _why_not(film)
        if not why:
            yield from _copied(film, note)
            return
    note(f"the film is coded again, since {why}")
    yield from _coded(path)


def _why_not(film: CodedFilm) -> str:
    """Why a film cannot be copied, empty when it can."""
    if film.stream.codec_context.name != "h264":
        return f"it is {film.stream.codec_context.name} and not H.264"
    if film.shown_as:
        return f"its pictures are {film.shown_as}"
    with CodedFilm(film.path) as ahead:
        if any(later.index < frame.index for frame, later in pairwise(ahead.frames())):
            return "it has B-frames"
    with CodedFilm(film.path) as ahead:
        first = next(_copied(ahead, lambda line: None), (0, b""))[1]
    units = _types(first)
    return "" if KEY in units and SEQUENCE in units else "its first frame is no key frame with its parameters"


def _copied(film: CodedFilm, note: Callable[[str], None]) -> Iterator[tuple[int, bytes]]:
    """With the parameters of the first key frame at those that have none."""
    annex_b = BitStreamFilterContext("h264_mp4toannexb", film.stream)
    parameters, damaged = b"", 0
    for frame in film.frames():
        try:
            data = b"".join(bytes(packet) for packet in annex_b.filter(frame.packet))
        except av.error.InvalidDataError:
            damaged += 1
            continue
        types = _types(data)
        if SEQUENCE in types and not parameters:
            parameters = _before_picture(data)
        if KEY in types and SEQUENCE not in types:
            data = parameters + data
        yield frame.index, data
    if damaged:
        note(f"{damaged} frames of the film are damaged and were left out")


def _coded(path: Path) -> Iterator[tuple[int, bytes]]:
    encoder: av.VideoCodecContext | None = None
    waiting: list[int] = []
    with VideoFile.open(path) as film:
        for frame in film.frames():
            height, width = (side - side % 2 for side in frame.image.shape[:2])
            if encoder is None:
                encoder = av.VideoCodecContext.create("libx264", "w")
                encoder.width, encoder.height, encoder.pix_fmt = width, height, "yuv420p"
                encoder.time_base = Fraction(1, 1000)
                encoder.gop_size, encoder.max_b_frames = 30, 0
                encoder.options = {"preset": "veryfast", "crf": "20", "tune": "zerolatency"}
            picture = av.VideoFrame.from_ndarray(frame.image[:height, :width], format="bgr24")
            picture.pts = frame.index
            waiting.append(frame.index)
            for packet in encoder.encode(picture):
                yield waiting.pop(0), bytes(packet)
        for packet in encoder.encode(None) if encoder else ():
            yield waiting.pop(0), bytes(packet)


def _types(data: bytes) -> set[int]:
    return {unit[0] & 31 for unit in _UNITS.findall(data)}


def _before_picture(data: bytes) -> bytes:
    """All units ahead of the first of a picture's own."""
    for unit in _UNITS.finditer(data):
        if unit[1][0] & 31 in (1, KEY):
            start = unit.start()
            return data[: start - 1 if start and data[start - 1] == 0 else start]
    return data
