"""Names as SubRip and WebVTT subtitles, which nearly every player and every browser shows.

SubRip has no places: a cue lists the names from left to right, and counts strangers. WebVTT puts each name at its
vehicle, in hundredths of the picture (https://www.w3.org/TR/webvtt1/).
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from gcs.export.job import ExportJob
from gcs.export.subtitles.cues import Cue, Cues, film_times_us
from gcs.export.unfinished import Unfinished
from gcs.report.box_shapes import box_bounds, drawable
from gcs.report.overlay import label_of
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import plain

_SRT_LETTERS = str.maketrans("<>{}\\&", "＜＞｛｝＼＆")
"""SubRip has no way to write them as letters; these are their wide twins."""
_VTT_LETTERS = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


class TextCues(ABC):
    """Writes the cues of a text file as their frames come."""

    header = ""

    def __init__(self, job: ExportJob) -> None:
        self._cues = Cues(film_times_us(job))
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path, self.header)

    def write(self, snapshot: Snapshot) -> None:
        """Append the names of the frame before."""
        self._write(self._cues.add(snapshot))

    def close(self) -> None:
        """Append those of the last frame and close the file."""
        self._write(self._cues.last())
        self._file.close()
        self._unfinished.finish()

    def _write(self, cue: Cue | None) -> None:
        if cue is not None:
            self._file.write(self.text_of(cue))

    @abstractmethod
    def text_of(self, cue: Cue) -> str:
        """Text of a cue in the file."""


class SrtExport(TextCues):
    """Export to SRT subtitles: one cue a frame in which anything was seen."""

    _count = 0

    def text_of(self, cue: Cue) -> str:
        """One numbered cue, nothing without boxes."""
        snapshot = cue.snapshot
        if not snapshot.boxes:
            return ""
        named = sorted((box for box in snapshot.boxes if box.system_id), key=lambda box: box.cx)
        words = [plain(label_of(snapshot, box)).translate(_SRT_LETTERS) for box in named]
        strangers = len(snapshot.boxes) - len(named)
        words += [f"{strangers} ?"] if strangers else []
        self._count += 1
        times = " --> ".join(_clock(us, ",") for us in (cue.start_us, cue.end_us))
        return f"{self._count}\n{times}\n{'   '.join(words)}\n\n"


class VttExport(TextCues):
    """Export to WebVTT subtitles: one cue for each box of each frame, above its vehicle."""

    header = "WEBVTT\n\n"

    def text_of(self, cue: Cue) -> str:
        """Text of as many cues as boxes, of the same time."""
        snapshot = cue.snapshot
        times = " --> ".join(_clock(us, ".") for us in (cue.start_us, cue.end_us))
        cues = []
        for box in filter(drawable, snapshot.boxes):
            _, top, _, _ = box_bounds(box)
            across, down = box.cx / max(1, snapshot.width), top / max(1, snapshot.height)
            place = f"position:{_percent(across)},center line:{_percent(down)},end align:center"
            cues.append(f"{times} {place}\n{plain(label_of(snapshot, box)).translate(_VTT_LETTERS)}\n\n")
        return "".join(cues)


def _percent(share: float) -> str:
    return f"{min(max(100.0 * share, 0.0), 100.0):.2f}%"


def _clock(us: int, point: str) -> str:
    seconds, thousandths = divmod(us // 1000, 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}{point}{thousandths:03d}"
