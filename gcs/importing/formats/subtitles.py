"""Subtitles: a file in SubRip's layout, in whatever state it is, as cues with their time.

A cue is a line with two times and the text up to the next one; numbers and empty lines in between may be missing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import ImportFileError
from gcs.importing.formats.text_file import text_lines

MAX_CUES = 1_000_000
"""Nine hours at 30 a second."""
_MAX_TEXT_LINES, _MAX_LINE = 24, 1000
_TIME = r"([0-9]{1,3}):([0-9]{1,2}):([0-9]{1,2})(?:[,.:]([0-9]{1,3}))?"
_TIMES = re.compile(rf"^\s*{_TIME}\s*--?>\s*{_TIME}")


@dataclass(frozen=True, slots=True)
class SubtitleCue:
    """One subtitle."""

    start_us: int
    """µs since the video's first frame."""
    text: str


def read_cues(path: Path) -> Iterator[SubtitleCue]:
    """All cues of a file, in its order, one at a time.

    Raises:
        ImportFileError: it cannot be opened, has no cue, or too many.
    """
    count = 0
    for count, cue in enumerate(cues_of(text_lines(path)), 1):
        if count > MAX_CUES:
            raise ImportFileError(f"{path}: more than {MAX_CUES} subtitles; cut it where the flight ends")
        yield cue
    if not count:
        raise ImportFileError(
            f"{path}: no subtitle in it; one begins with a line such as 00:00:01,000 --> 00:00:02,000"
        )


def cues_of(lines: Iterable[str]) -> Iterator[SubtitleCue]:
    """Cues of a file's lines; the seconds of a time may be 60, as some drones write."""
    start_us, text = -1, list[str]()
    for line in lines:
        times = _TIMES.match(line)
        if times is None:
            if start_us >= 0 and len(text) < _MAX_TEXT_LINES:
                text.append(line[:_MAX_LINE])
            continue
        if start_us >= 0:
            yield SubtitleCue(start_us, "\n".join(text))
        hours, minutes, seconds, part = times.groups()[:4]
        start_us = (int(hours) * 3600 + int(minutes) * 60 + int(seconds)) * 1_000_000
        start_us += int((part or "0").ljust(3, "0")) * 1000
        text = []
    if start_us >= 0:
        yield SubtitleCue(start_us, "\n".join(text))
