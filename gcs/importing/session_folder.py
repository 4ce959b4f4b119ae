"""The session folder of an imported flight: telemetry, frame times, the untouched video, and session.toml."""

from __future__ import annotations

import heapq
import os
import shutil
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.errors import ImportFileError
from gcs.importing.film import ImportedFilm
from gcs.importing.messages import TlogRecord
from gcs.mission.mission import Mission
from gcs.session.metadata import PROGRAM, mission_table
from gcs.session.session import VIDEO_SUFFIXES
from infra.session_format import FRAMES, LOG, METADATA
from sim.session import new_session, write_frames

__all__ = ["write_imported"]

_TIME = struct.Struct(">Q")
_OTHER_NAMES = {".m2ts": ".ts", ".mts": ".ts", ".m4v": ".mp4", ".lrf": ".mp4"}
"""Of containers that are the same under another name."""


def write_imported(
    folder: Path,
    film: ImportedFilm,
    film_us: int,
    streams: Sequence[Iterable[TlogRecord]],
    mission: Mission,
    notes: Mapping[str, Any],
) -> None:
    """Write the folder; the video is linked where the disk can, else copied.

    Args:
        folder: must not exist.
        film: what was filmed.
        film_us: Unix µs of its first frame.
        streams: records, each in order of time.
        mission: who flies.
        notes: where each number came from, for session.toml.

    Raises:
        SessionWriteError: the folder exists or cannot be made.
        ImportFileError: the video's container is none that a session has.
    """
    suffix = film.path.suffix.lower()
    suffix = _OTHER_NAMES.get(suffix, suffix)
    if suffix not in VIDEO_SUFFIXES:
        raise ImportFileError(f"{film.path}: a session's video is one of {', '.join(VIDEO_SUFFIXES)}; remux it")
    text = mission_table(mission, {"format": 1, "program": PROGRAM, "imported": dict(notes)})
    with new_session(folder) as made:
        with (made / LOG).open("xb") as log:
            for t_us, raw in heapq.merge(*streams, key=lambda record: record[0]):
                log.write(_TIME.pack(t_us) + raw)
        write_frames(made / FRAMES.name, film.elapsed_us + film_us)
        _link(film.path, made / f"video{suffix}")
        (made / METADATA).write_text(text, encoding="utf-8")


def _link(source: Path, target: Path) -> None:
    """The same file under another name; on another disk a copy."""
    try:
        os.link(source.resolve(), target)
    except OSError:
        shutil.copyfile(source, target)
