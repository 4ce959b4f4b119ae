"""Names on their vehicles as Advanced SubStation Alpha subtitles, which players lay over the film.

Layout: the format that libass documents ("ASS File Format Guide", v4.00+). Places are in pixels of the film. Braces and
backslashes would be orders, and not every player knows a way to write them as letters, so that names get their wide
twins. Times have hundredths of a second; they are rounded down, so that no frame begins before its own names do.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gcs.export.job import ExportJob
from gcs.export.subtitles.cues import Cue, Cues, film_times_us
from gcs.export.unfinished import Unfinished
from gcs.report.box_shapes import box_bounds
from gcs.report.label_grid import Cells, Grid
from gcs.report.labels import Labelling, leader_of, place_labels
from gcs.report.overlay import DARK, box_keys, box_labels, boxes_in_order, rgb_of
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import plain

EMPTY_SIZE: Final = (1280, 720)
SQUARE_PX: Final = 4
"""Labels are placed in squares of this many pixels."""
INK: Final = (214, 222, 235)
_AS_LETTERS: Final = str.maketrans("{}\\", "｛｝＼")


def ass_header(size: tuple[int, int], title: str) -> str:
    """All of a file before its first line of dialogue.

    Args:
        size: width and height of the film, px.
        title: what it is called.
    """
    letters = _letters_px(size[1])
    dark = f"&H40{_bgr(DARK)}"
    return "\n".join(
        (
            "[Script Info]",
            f"Title: {plain(title)}",
            "ScriptType: v4.00+",
            f"PlayResX: {size[0]}",
            f"PlayResY: {size[1]}",
            "WrapStyle: 2",
            "ScaledBorderAndShadow: yes",
            "",
            "[V4+ Styles]",
            "Format: Name, Fontname, Fontsize, PrimaryColour, SecondaryColour, OutlineColour, BackColour, Bold, "
            "Italic, Underline, StrikeOut, ScaleX, ScaleY, Spacing, Angle, BorderStyle, Outline, Shadow, Alignment, "
            "MarginL, MarginR, MarginV, Encoding",
            *(
                f"Style: {name},Arial,{letters},&H00{_bgr(INK)},&H00{_bgr(INK)},{dark},{dark},"
                f"0,0,0,0,100,100,0,0,{border},{width},0,5,0,0,0,1"
                for name, border, width in (("Name", 3, 2), ("Line", 1, 1))
            ),
            "",
            "[Events]",
            "Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text",
            "",
        )
    )


class AssNames:
    """Places the names of one frame after another, so that they stay where they are.

    Args:
        size: width and height of the film, px.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._labelling: Labelling | None = None

    def events(self, snapshot: Snapshot) -> Iterator[tuple[int, str, str]]:
        """Layer, style and text of every name, and of every line from a name to its vehicle."""
        snapshot = _scaled(snapshot, self._size)
        boxes = boxes_in_order(snapshot, 0, 0)
        anchors = [_squares(box_bounds(box)) for box in boxes]
        labels = box_labels(snapshot, boxes, anchors, str.isprintable)
        self._labelling = placed = place_labels(labels, self._grid(), self._labelling)
        inks = {key: rgb_of(snapshot, box) for key, box in zip(box_keys(boxes), boxes, strict=True)}
        for place in (*placed.places, *placed.counts):
            if place.leader:
                yield 0, "Line", _line(leader_of(place), inks.get(place.key, INK))
        for place in placed.texts:
            left, top, width, height = (SQUARE_PX * number for number in place.rect)
            where = f"\\an5\\pos({left + width // 2},{top + height // 2})"
            yield 1, "Name", f"{{{where}\\c&H{_bgr(inks.get(place.key, INK))}&}}{_letters(place.text)}"

    def _grid(self) -> Grid:
        width, height = self._size
        letters = _letters_px(height)

        def measure(text: str) -> tuple[int, int]:
            across = sum(1.0 if unicodedata.east_asian_width(letter) in "WF" else 0.58 for letter in text)
            return math.ceil((across * letters + 6) / SQUARE_PX), math.ceil((letters + 6) / SQUARE_PX)

        line = measure("0")[1]
        columns, rows = width // SQUARE_PX, height // SQUARE_PX
        return Grid(columns=columns, rows=rows, measure=measure, step=(line, line), gap=1, covered=True)


class AssExport:
    """Export to ASS subtitles: one line of dialogue for each name of each frame."""

    def __init__(self, job: ExportJob) -> None:
        self._cues = Cues(film_times_us(job))
        self._title = job.name
        self._names: AssNames | None = None
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path)

    def write(self, snapshot: Snapshot) -> None:
        """Append the names of the frame before."""
        self._write(self._cues.add(snapshot))

    def close(self) -> None:
        """Append those of the last frame and close the file."""
        self._write(self._cues.last())
        if self._names is None:
            self._begin(EMPTY_SIZE)
        self._file.close()
        self._unfinished.finish()

    def _write(self, cue: Cue | None) -> None:
        if cue is None or not cue.snapshot.boxes:
            return
        names = self._names or self._begin((cue.snapshot.width, cue.snapshot.height))
        start, end = (_clock(us) for us in (cue.start_us, cue.end_us))
        for layer, style, text in names.events(cue.snapshot):
            self._file.write(f"Dialogue: {layer},{start},{end},{style},,0,0,0,,{text}\n")

    def _begin(self, size: tuple[int, int]) -> AssNames:
        self._file.write(ass_header(size, self._title))
        self._names = AssNames(size)
        return self._names


def _clock(us: int) -> str:
    seconds, hundredths = divmod(us // 10_000, 100)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{hundredths:02d}"


def _letters(text: str) -> str:
    return plain(text).translate(_AS_LETTERS)


def _letters_px(height: int) -> int:
    return round(22 * max(0.75, height / 900))


def _bgr(rgb: tuple[int, int, int]) -> str:
    red, green, blue = rgb
    return f"{blue:02X}{green:02X}{red:02X}"


def _squares(rect: tuple[float, float, float, float]) -> Cells:
    x, y, w, h = (number / SQUARE_PX for number in rect)
    left, top = math.floor(x), math.floor(y)
    return left, top, math.ceil(x + w) - left, math.ceil(y + h) - top


def _line(ends: tuple[float, float, float, float], ink: tuple[int, int, int]) -> str:
    """A strip two pixels wide as a drawing."""
    x, y, to_x, to_y = (SQUARE_PX * number for number in ends)
    length = math.hypot(to_x - x, to_y - y) or 1.0
    # n = the direction turned by 90°
    n_x, n_y = -(to_y - y) / length, (to_x - x) / length
    corners = ((x + n_x, y + n_y), (to_x + n_x, to_y + n_y), (to_x - n_x, to_y - n_y), (x - n_x, y - n_y))
    drawn = " l ".join(f"{corner_x:.0f} {corner_y:.0f}" for corner_x, corner_y in corners)
    return f"{{\\an7\\pos(0,0)\\c&H{_bgr(ink)}&\\p1}}m {drawn}{{\\p0}}"


def _scaled(snapshot: Snapshot, size: tuple[int, int]) -> Snapshot:
    """Return the snapshot with boxes in pixels of the film: the frames of a flight may have had several sizes."""
    if (snapshot.width, snapshot.height) == size or not (snapshot.width and snapshot.height):
        return snapshot
    across, down = size[0] / snapshot.width, size[1] / snapshot.height
    boxes = (
        replace(box, cx=box.cx * across, cy=box.cy * down, w=box.w * across, h=box.h * down) for box in snapshot.boxes
    )
    return replace(snapshot, width=size[0], height=size[1], boxes=tuple(boxes))
