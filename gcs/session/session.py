"""A session folder: one flight in files that other people's tools can open, valid at every second.

``session.toml`` what flew, ``telemetry.tlog`` the raw packets, ``video.*`` the untouched stream, ``frames.csv`` when
each frame was taken, ``detections.csv`` what the detector saw, ``truth.csv`` (simulated or annotated),
``identity.csv`` and ``identity.jsonl`` who is who, ``events.jsonl`` what happened. Only the first is needed beside the
telemetry. A disk that failed leaves further segments of a file beside it (``telemetry.1.tlog``, ``frames.1.csv``);
they are read as one.
"""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ConfigError, SessionError
from gcs.mission.mission import NO_KEYS, Mission, load_mission, load_table
from gcs.mission.values import toml_text
from gcs.session.flight_notes import FlightNotes
from gcs.session.segmented import read_segments
from gcs.session.tables import Table
from infra.files.segments import segments
from mavlink.tlog.timestamps import times_ok
from vision.detect.detections import Detections

__all__ = [
    "FrameDetections",
    "FrameTimes",
    "Session",
    "create_folder",
    "mission_table",
    "open_session",
    "read_detections",
    "read_times",
]

MOST_MISSING, ROOMY = 100_000, 64
"""A table of n frames may lack so many at once, and be of every 64th: what a frame index asks of memory is bounded."""
VIDEO_SUFFIXES = (".mkv", ".mp4", ".ts", ".mov", ".avi")


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """What a recording consists of; every path exists."""

    path: Path
    mission: Mission | None
    """None: a bare log without a mission file; the vehicles are found in the log."""
    tlog: Path
    video: Path | None = None
    video_start_s: float = 0.0
    """When a video without frames.csv begins, seconds after the log's first message."""
    frames: Path | None = None
    detections: Path | None = None
    folds: Path | None = None
    """In which order the flight took in telemetry and pictures."""
    frame_size: tuple[int, int] | None = None
    """Width and height of the frames, px, as somebody says who knows; None: what the recording says."""
    notes: FlightNotes = field(default_factory=FlightNotes)
    truth: Path | None = None
    identity: Path | None = None

    @property
    def name(self) -> str:
        """What to call it on a screen."""
        return self.path.stem if self.path.is_file() else self.path.resolve().name


def open_session(
    path: Path,
    *,
    video: Path | None = None,
    video_start_s: float = 0.0,
    mission: Path | None = None,
    frame_size: tuple[int, int] | None = None,
) -> Session:
    """Open a session folder, or a bare tlog with an optional video and mission file.

    Args:
        path: of the folder or the log.
        video: in place of the session's own.
        video_start_s: when a video without frame times begins, seconds after the log's first message.
        mission: file, in place of the session's own.
        frame_size: width and height of the frames, px, of a recording that does not know.

    Raises:
        SessionError: nothing there, or no telemetry in it.
        ConfigError: the mission cannot be used.
    """
    if not path.exists():
        raise SessionError(f"{path}: no such session folder or telemetry log")
    for extra in (video, mission):
        if extra is not None and not extra.is_file():
            raise SessionError(f"{extra}: no such file")
    chosen = load_mission(mission) if mission else None
    if path.is_file():
        return Session(path=path, mission=chosen, tlog=path, video=video, video_start_s=video_start_s)
    tlog = path / "telemetry.tlog"
    if not segments(tlog):
        raise SessionError(f"{path}: no telemetry.tlog in this folder; a session needs one")
    toml = path / "session.toml"
    if chosen is None and toml.is_file():
        chosen = load_mission(toml)
    notes = FlightNotes()
    if toml.is_file():
        with contextlib.suppress(ConfigError):  # another mission file may stand for one that is damaged
            notes = FlightNotes.of(load_table(toml).get("session"))
    found = [path / f"video{suffix}" for suffix in VIDEO_SUFFIXES if segments(path / f"video{suffix}")]
    return Session(
        path=path,
        mission=chosen,
        tlog=tlog,
        video=video or (found[0] if found else None),
        video_start_s=video_start_s,
        frames=None if video else _existing(path / "frames.csv"),
        detections=_existing(path / "detections.csv"),
        folds=None if video else _existing(path / "folds.csv"),
        frame_size=frame_size,
        notes=notes,
        truth=_existing(path / "truth.csv"),
        identity=_existing(path / "identity.csv"),
    )


def _existing(path: Path) -> Path | None:
    return path if segments(path) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTimes:
    """What ``frames.csv`` says."""

    times_us: NDArray[np.int64]
    """(n,) Unix µs by frame index."""
    skipped: int
    """Rows that could not be used."""
    unordered: int
    """Rows whose frame is earlier than that of the row before."""


def read_times(path: Path) -> FrameTimes:
    """Read ``frames.csv``.

    A frame whose row is damaged gets the time between its neighbours, so that later frames keep their places. So does
    one whose time is not between theirs, or in company nowhere: all telemetry up to that time would be taken before it.

    Raises:
        SessionError: no table, or no row in it that can be used.
    """
    table = read_segments(path, ("frame", "time_us"))
    if not len(table):
        raise SessionError(f"{path}: no frame in it; delete the file if the video has its own time stamps")
    unordered = int(np.count_nonzero(np.diff(table["frame"]) < 0))
    frame, first = np.unique(table["frame"].astype(np.int64), return_index=True)
    time_us = table["time_us"][first].astype(np.int64)
    keep = frame < ROOMY * len(frame) + MOST_MISSING
    frame, time_us = frame[keep], time_us[keep]
    if not len(frame):
        raise SessionError(
            f"{path}: no frame in it that could be; delete the file if the video has its own time stamps"
        )
    good = _times_between(time_us) & times_ok(time_us, np.ones(len(time_us), dtype=np.bool_))
    if good.any():
        frame, time_us = frame[good], time_us[good]
    # relative to the first: a Unix time in µs and a fraction are more than a float holds
    dense = np.interp(np.arange(frame[-1] + 1), frame, time_us - time_us[0])
    return FrameTimes(
        times_us=np.round(dense).astype(np.int64) + time_us[0],
        skipped=table.skipped + len(table) - len(frame),
        unordered=unordered,
    )


def _times_between(time_us: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) which times lie between those before and after; all where those two are not in order themselves."""
    between = np.ones(len(time_us), dtype=np.bool_)
    before, here, after = time_us[:-2], time_us[1:-1], time_us[2:]
    between[1:-1] = (before > after) | ((before <= here) & (here <= after))
    return between


class FrameDetections:
    """The rows of ``detections.csv`` by frame, in the order of the file."""

    def __init__(self, table: Table) -> None:
        order = np.argsort(table["frame"], kind="stable")
        self._frame = table["frame"][order].astype(np.int64)
        self._columns = {k: v[order] for k, v in table.columns.items() if k != "frame"}
        self.skipped = table.skipped

    def at(self, frame: int) -> Detections:
        """What was seen in a frame, perhaps nothing."""
        start, stop = np.searchsorted(self._frame, (frame, frame + 1))
        return Detections(**{name: column[start:stop] for name, column in self._columns.items()})

    @property
    def extent(self) -> tuple[float, float]:
        """How far right and down the centres of boxes lie, px; 0 without any."""
        columns = self._columns
        return float(columns["cx"].max(initial=0.0)), float(columns["cy"].max(initial=0.0))

    @property
    def last(self) -> int:
        """Index of the last frame that saw anything, -1 for none."""
        return int(self._frame[-1]) if len(self._frame) else -1


def read_detections(path: Path) -> FrameDetections:
    """Read ``detections.csv``: oriented boxes in pixels and radians, heading empty where the front is unknown."""
    return FrameDetections(read_segments(path, ("frame", "cx", "cy", "w", "h", "angle", "score"), ("heading",)))


def create_folder(parent: Path, now: datetime | None = None) -> Path:
    """Make a new folder named after the time; a name that exists gets a number, nothing is ever reused."""
    stem = (now or datetime.now(UTC)).strftime("%Y-%m-%d_%H-%M-%SZ")
    for k in range(1000):
        folder = parent / (f"{stem}.{k}" if k else stem)
        try:
            folder.mkdir(mode=0o755, parents=True)  # others may not write to it, whatever the umask
        except FileExistsError:
            continue
        except OSError as error:
            raise SessionError(
                f"{folder}: cannot be made: {error.strerror}; choose another place with --sessions"
            ) from error
        return folder
    raise SessionError(f"{parent}: a thousand sessions of the same second; choose another place with --sessions")


def mission_table(mission: Mission, notes: Mapping[str, Any]) -> str:
    """The text of ``session.toml``: the mission as it flew and a ``[session]`` table of notes."""
    table: dict[str, Any] = {"session": dict(notes), "uav": _vehicle(mission, mission.uav.system_id)}
    table["ugv"] = [_vehicle(mission, i) for i in mission.ugv_ids]
    for name in ("camera", "clock", "detector", "identity"):
        part = getattr(mission, name)
        if part is not None:
            table[name] = {
                k: list(v) if isinstance(v, tuple) else v
                for k in part.__slots__
                if (v := getattr(part, k)) not in ("", None)
            }
    signing = mission.signing
    table["signing"] = {"unsigned": list(signing.unsigned), "keyless": signing.keyless}
    if signing.keys == NO_KEYS:
        # other folders of keys are the flight's computer's own
        table["signing"]["keys"] = NO_KEYS
    text = toml_text(table)
    tomllib.loads(text)
    return text


def _vehicle(mission: Mission, system_id: int) -> dict[str, Any]:
    return {"system_id": system_id, "name": mission.name_of(system_id)}
