"""The film, copied untouched, with the names as a subtitle track that sits on the vehicles: one Matroska file.

No frame is decoded. Each is shown when it was taken, also where the session knows that better than the film. Matroska
counts thousandths of a second, and keeps subtitles as libass' lines without their times
(https://www.matroska.org/technical/subtitles.html).
"""

from __future__ import annotations

import io
from fractions import Fraction

import av
from av.packet import Packet
from av.stream import Stream
from av.subtitles.stream import SubtitleStream

from gcs.export.film_times import copying, retimed, shown_times
from gcs.export.job import ExportJob
from gcs.export.subtitles.ass import AssNames, ass_header
from gcs.export.subtitles.cues import Cue, Cues
from gcs.export.unfinished import Unfinished
from gcs.snapshot import Snapshot
from infra.plain_text import plain
from vision.video.coded_frames import CodedFilm

TIME_BASE = Fraction(1, 1000)


class MkvExport:
    """Export to MKV with subtitles: keeps the lines until the end, and copies the film then."""

    def __init__(self, job: ExportJob) -> None:
        if job.video is None:
            raise ValueError("a copy of a film needs one")
        self._film = CodedFilm(job.video)
        self._title = plain(job.name)
        self._times_ms = shown_times(job.times_us[: self._film.n], TIME_BASE)
        self._cues = Cues(self._times_ms * 1000)
        self._size = self._film.size
        self._names = AssNames(self._size)
        self._lines: list[tuple[int, int, bytes]] = []
        self._unfinished = Unfinished(job.path)

    def write(self, snapshot: Snapshot) -> None:
        """Take the names of the frame before."""
        self._take(self._cues.add(snapshot))

    def close(self) -> None:
        """Take those of the last frame, and write the file."""
        self._take(self._cues.last())
        place = str(self._unfinished.path)
        options = {"default_mode": "infer"}
        header = io.BytesIO(ass_header(self._size, self._title).encode())
        with (
            copying(self._film.path, "Matroska"),
            self._film,
            av.open(place, "w", format="matroska", options=options) as copy,
        ):
            video = copy.add_stream_from_template(self._film.stream)
            with av.open(header, format="ass") as lines:
                names = copy.add_stream_from_template(lines.streams.subtitles[0])
            names.metadata["title"] = "Names"
            copy.metadata["title"] = self._title
            written = 0
            for packet in retimed(self._film, self._times_ms, TIME_BASE):
                while written < len(self._lines) and self._lines[written][0] <= (packet.pts or 0):
                    copy.mux(_line(self._lines[written], names))
                    written += 1
                packet.stream = video
                copy.mux(packet)
            for line in self._lines[written:]:
                copy.mux(_line(line, names))
        self._unfinished.finish()

    def _take(self, cue: Cue | None) -> None:
        if cue is None:
            return
        start_ms, end_ms = cue.start_us // 1000, cue.end_us // 1000
        for layer, style, text in self._names.events(cue.snapshot):
            line = f"{len(self._lines)},{layer},{style},,0,0,0,,{text}"
            self._lines.append((start_ms, end_ms - start_ms, line.encode()))


def _line(line: tuple[int, int, bytes], stream: SubtitleStream) -> Packet[Stream]:
    packet = Packet(line[2])
    packet.stream = stream
    packet.time_base = TIME_BASE
    packet.pts = packet.dts = line[0]
    packet.duration = line[1]
    return packet
