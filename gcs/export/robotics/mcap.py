"""The recording as MCAP with Foxglove's schemas: film, boxes and names on it, vehicles in space and on a map, events.

    /camera/video              foxglove.CompressedVideo    H.264, frame "camera"
    /camera/annotations        foxglove.ImageAnnotations   oriented boxes and names, pixels
    /scene                     foxglove.SceneUpdate        vehicles seen, as cubes where they stand, frame "enu"
    /vehicles/SYSTEM_ID/fix    foxglove.LocationFix        where each vehicle and the UAV reports to be
    /log                       foxglove.Log                events
    /identity                  JSON                        rows as in identity.jsonl, a list for each frame

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas. Strangers are drawn without a name. Topics have
the vehicles' ids and not their names, which may hold anything.

Players of files in which each message is one picture decode a message and show it: no frame may wait for a later one
(no B-frames), pictures are in Annex B with start codes, and every key frame has the parameter sets with it. A film that
is so is copied; others are coded again.
"""

from __future__ import annotations

import errno
import re
from collections import deque
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Final

import av
import foxglove
from av.bitstream import BitStreamFilterContext
from foxglove import channels
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import CompressedVideo

from gcs.export.job import ExportJob
from gcs.export.robotics.foxglove_channels import FoxgloveChannels
from gcs.export.robotics.foxglove_views import stamp_of
from gcs.export.unfinished import Unfinished
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Snapshot
from infra.plain_text import plain
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
    """Return why a film cannot be copied, empty when it can."""
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
    """Return the pictures, with the parameters of the first key frame at those that have none."""
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


class McapExport:
    """Export to MCAP, one file; the film's pictures are written as their frames come, all of them also where frames are
    left out."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._context = foxglove.Context()
        options = MCAPWriteOptions(compression_threads=0)
        self._file = foxglove.open_mcap(self._unfinished.path, context=self._context, writer_options=options)
        self._file.write_metadata("rollcall", {"recording": plain(job.name)})
        self._video = channels.CompressedVideoChannel("/camera/video", context=self._context)
        self._channels = FoxgloveChannels(self._context)
        self._times_us = job.times_us
        self._pictures: Iterator[tuple[int, bytes]] = pictures_of(job.video, job.note) if job.video else iter(())
        self._next: deque[tuple[int, bytes]] = deque()

    def write(self, snapshot: Snapshot) -> None:
        """Append one frame."""
        self._show(snapshot.frame)
        self._channels.write(snapshot)
        for event in snapshot.events:
            text = text_with_sender(event, snapshot.name_of)
            self._channels.write_words(event.t_us, snapshot.t_us, event.level, event.kind, text)

    def close(self) -> None:
        """Append what is left of the film, and put the file into its place."""
        self._show(len(self._times_us))
        try:
            self._file.close()
        except RuntimeError as error:  # foxglove has no other, and tells here what it could not write before
            raise OSError(errno.EIO, plain(str(error))) from error
        self._unfinished.finish()

    def _show(self, frame: int) -> None:
        """Write the film's pictures up to a frame."""
        while self._next or self._take():
            index, data = self._next[0]
            if index > frame:
                return
            self._next.popleft()
            if index < len(self._times_us):
                t_us = int(self._times_us[index])
                picture = CompressedVideo(timestamp=stamp_of(t_us), frame_id="camera", data=data, format="h264")
                self._video.log(picture, log_time=1000 * t_us)

    def _take(self) -> bool:
        self._next.extend(picture for picture in [next(self._pictures, None)] if picture)
        return bool(self._next)
