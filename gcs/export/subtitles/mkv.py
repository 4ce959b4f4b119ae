"""The film, copied untouched, with the names as a subtitle track that sits on the vehicles: one Matroska file.

No frame is decoded. Each is shown when it was taken, also where the session knows that better than the film. Matroska
counts thousandths of a second, and keeps subtitles as libass' lines without their times
(https://www.matroska.org/technical/subtitles.html).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from fractions import Fraction

import av
import numpy as np
from av.packet import Packet
from av.stream import Stream
from av.subtitles.stream import SubtitleStream
from av.video.stream import VideoStream
from numpy.typing import NDArray

from gcs.export.job import ExportJob
from gcs.export.subtitles.ass import EMPTY_SIZE, AssNames, ass_header
from gcs.export.subtitles.cues import Cue, Cues
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import plain
from vision.video.coded_frames import CodedFilm

__all__ = ["MkvExport", "decoding_times", "shown_ms"]

TIME_BASE = Fraction(1, 1000)


class MkvExport:
    """Keeps the lines until the end, and copies the film then."""

    def __init__(self, job: ExportJob) -> None:
        if job.video is None:
            raise ValueError("a copy of a film needs one")
        self._film = CodedFilm(job.video)
        self._title = plain(job.name)
        self._times_ms = shown_ms(job.times_us, self._film.n)
        self._cues = Cues(self._times_ms * 1000)
        coded = self._film.stream.codec_context
        self._size = (coded.width, coded.height) if coded.width and coded.height else EMPTY_SIZE
        self._names = AssNames(self._size)
        self._lines: list[tuple[int, int, bytes]] = []
        self._file = open_new(job.path)

    def write(self, snapshot: Snapshot) -> None:
        """Take the names of the frame before."""
        self._take(self._cues.add(snapshot))

    def close(self) -> None:
        """Take those of the last frame, and write the file."""
        self._take(self._cues.last())
        # FFmpeg by itself would write over what is there, and through a link
        place = f"/dev/fd/{self._file.fileno()}"
        options = {"default_mode": "infer"}
        header = io.BytesIO(ass_header(self._size, self._title).encode())
        with self._film, self._file, av.open(place, "w", format="matroska", options=options) as copy:
            video = copy.add_stream_from_template(self._film.stream)
            with av.open(header, format="ass") as lines:
                names = copy.add_stream_from_template(lines.streams.subtitles[0])
            names.metadata["title"] = "Names"
            copy.metadata["title"] = self._title
            written = 0
            for packet in self._frames():
                while written < len(self._lines) and self._lines[written][0] <= (packet.pts or 0):
                    copy.mux(_line(self._lines[written], names))
                    written += 1
                packet.stream = video
                copy.mux(packet)
            for line in self._lines[written:]:
                copy.mux(_line(line, names))

    def _take(self, cue: Cue | None) -> None:
        if cue is None:
            return
        start_ms, end_ms = cue.start_us // 1000, cue.end_us // 1000
        for layer, style, text in self._names.events(cue.snapshot):
            line = f"{len(self._lines)},{layer},{style},,0,0,0,,{text}"
            self._lines.append((start_ms, end_ms - start_ms, line.encode()))

    def _frames(self) -> Iterator[Packet[VideoStream]]:
        """The film's packets, at the session's times."""
        with CodedFilm(self._film.path) as ahead:
            order = [frame.index for frame in ahead.frames() if frame.index < len(self._times_ms)]
        stamps_ms = decoding_times(self._times_ms[order])
        taken = 0
        for frame in self._film.frames():
            if frame.index >= len(self._times_ms):
                continue
            packet = frame.packet
            packet.time_base = TIME_BASE
            packet.pts, packet.dts = int(self._times_ms[frame.index]), int(stamps_ms[taken])
            packet.duration = 0
            taken += 1
            yield packet


def shown_ms(times_us: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """(m,) when each of at most n frames is shown, ms after the first: later ones later, whatever clocks did."""
    elapsed: NDArray[np.int64] = np.round((times_us[:n] - times_us[:1]) / 1000).astype(np.int64)
    count = np.arange(len(elapsed))
    return np.asarray(np.maximum.accumulate(elapsed - count) + count, dtype=np.int64)


def decoding_times(shown: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) times to decode frames at, in that order: ascending, none after its frame is shown.

    Args:
        shown: (n,) when each is shown, in the order of decoding.
    """
    ascending = np.sort(shown)
    return np.asarray(ascending - max(0, int((ascending - shown).max(initial=0))), dtype=np.int64)


def _line(line: tuple[int, int, bytes], stream: SubtitleStream) -> Packet[Stream]:
    packet = Packet(line[2])
    packet.stream = stream
    packet.time_base = TIME_BASE
    packet.pts = packet.dts = line[0]
    packet.duration = line[1]
    return packet
