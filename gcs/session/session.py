"""A session folder: one flight in files that other people's tools can open, valid at every second.

``session.toml`` what flew, ``telemetry.tlog`` the raw packets, ``video.*`` the untouched stream, ``frames.csv`` when
each frame was taken, ``detections.csv`` what the detector saw, ``truth.csv`` (simulated or annotated),
``identity.csv`` and ``identity.jsonl`` who is who, ``events.jsonl`` what happened. Only the first is needed beside the
telemetry. A disk that failed leaves further segments of a file beside it (``telemetry.1.tlog``, ``frames.1.csv``);
they are read as one.

A flight with several cameras has the files of the first one there, and of each other one the same files in a folder
``view-2``, ``view-3``, …, which is opened as a session of its own: telemetry and ``session.toml`` are those above it.
"""

from __future__ import annotations

import contextlib
import os
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from gcs.errors import ConfigError, SessionError
from gcs.mission.fleet_changes import with_all
from gcs.mission.mission import Mission, load_mission, load_table
from gcs.session.event_log import read_changes
from gcs.session.metadata import FlightNotes
from gcs.snapshot import FleetChange
from infra.files.safe_open import open_to_read
from infra.files.segment import segments
from infra.session_format import DETECTIONS, FOLDS, FRAMES, IDENTITY, LOG, METADATA, MOTION, TRUTH, VIEW_FOLDER

VIEW = re.compile(VIEW_FOLDER.format("([2-9]|[1-9][0-9]{1,2})"))
"""Name of the folder of a further camera."""

VIDEO_SUFFIXES = (".mkv", ".mp4", ".ts", ".mov", ".avi")


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """Parts that a recording consists of; every path exists."""

    path: Path
    mission: Mission | None
    """Everyone who was ever in it; None: a bare log without a mission file, the vehicles are found in the log."""
    tlog: Path
    began: Mission | None = None
    """Fleet as the flight began, where the operator changed that in flight; None: it is ``mission`` throughout."""
    changes: tuple[FleetChange, ...] = ()
    """Changes by the operator, in order."""
    video: Path | None = None
    video_start_s: float = 0.0
    """Start of a video without frames.csv, seconds after the log's first message."""
    frames: Path | None = None
    detections: Path | None = None
    motion: Path | None = None
    """Motion of the camera between frames, by their pixels."""
    folds: Path | None = None
    """File with the order in which the flight took in telemetry and frames."""
    frame_size: tuple[int, int] | None = None
    """Width and height of the frames, px, as given by the user; None: as recorded."""
    notes: FlightNotes = field(default_factory=FlightNotes)
    truth: Path | None = None
    identity: Path | None = None
    mission_file: Path | None = None
    """Mission file that was given in place of the session's own, for all cameras; None: none."""

    @property
    def folder(self) -> Path:
        """Folder with what this camera recorded."""
        return self.path.parent if self.path.is_file() else self.path

    @property
    def other_views(self) -> tuple[Session, ...]:
        """Recordings of the flight's other cameras, whichever this one is; without those that recorded nothing.

        Raises:
            SessionError, ConfigError: one of them cannot be opened.
        """
        views = map(self.opened_beside, self.other_folders)
        return tuple(view for view in views if view.video or view.frames)

    def opened_beside(self, folder: Path) -> Session:
        """The recording of another camera of the flight, with the same mission.

        Raises:
            SessionError, ConfigError: it cannot be opened.
        """
        return open_session(folder, mission=self.mission_file)

    @property
    def other_folders(self) -> tuple[Path, ...]:
        """Folders of the flight's other cameras, whether they can be opened or not."""
        if self.mission is None or not self.mission.view or self.path.is_file():
            return ()
        home, own = self.tlog.parent, self.path.resolve()
        folders = (home, *(home / VIEW_FOLDER.format(k + 2) for k in range(len(self.mission.view))))
        return tuple(folder for folder in folders if folder.is_dir() and folder.resolve() != own)

    @property
    def unnamed_views(self) -> tuple[str, ...]:
        """Folders in a flight's own of further cameras that the mission does not have, so that they are not opened."""
        if self.path.is_file() or not self.is_first_view:
            return ()
        known = len(self.mission.view) + 1 if self.mission else 1
        names = (each.name for each in self.path.iterdir() if each.is_dir())
        return tuple(sorted(name for name in names if (found := VIEW.fullmatch(name)) and int(found[1]) > known))

    @property
    def is_first_view(self) -> bool:
        """True of what a flight's only or first camera recorded."""
        return self.path.is_file() or self.tlog.parent == self.path

    @property
    def name(self) -> str:
        """Name on a screen."""
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
        video: in place of the session's own.
        video_start_s: when a video without frame times begins, seconds after the log's first message.
        mission: file, in place of the session's own.
        frame_size: width and height of the frames, px, of a recording that does not know.

    Raises:
        SessionError: nothing there, or no telemetry in it.
        ConfigError: the mission cannot be used.
    """
    if not (path.is_dir() or path.is_file()):
        raise SessionError(f"{path}: no such session folder or telemetry log")
    for extra in (video, mission):
        if extra is not None and not extra.is_file():
            raise SessionError(f"{extra}: no such file")
    chosen = load_mission(mission) if mission else None
    if path.is_file():
        return Session(path=path, mission=chosen, tlog=path, video=video, video_start_s=video_start_s)
    number = _view_number(path)
    home = path if number == 1 else path.resolve().parent
    tlog = home / LOG
    if not segments(tlog):
        raise SessionError(f"{path}: no {LOG} in this folder; a session needs one")
    if chosen is not None and chosen.view:
        chosen = _seen_by(number, chosen, path)
    toml, began, changes = home / METADATA, None, tuple[FleetChange, ...]()
    if chosen is None and toml.is_file():
        chosen = _seen_by(number, load_mission(toml), path)
        if changes := read_changes(path):  # by the frames of this camera
            began, chosen = chosen, with_all(chosen, changes)
    notes = FlightNotes()
    if toml.is_file():
        with contextlib.suppress(ConfigError):  # another mission file may replace one that is damaged
            notes = FlightNotes.from_table(load_table(toml).get("session"))
    found = [path / f"video{suffix}" for suffix in VIDEO_SUFFIXES if segments(path / f"video{suffix}")]
    # a flight whose camera never gave a picture has tables without a row: it is telemetry alone
    filmed = bool(video or found) or not notes.flown or _has_rows(path / FRAMES.name)
    return Session(
        path=path,
        mission=chosen,
        began=began,
        changes=changes,
        tlog=tlog,
        video=video or (found[0] if found else None),
        video_start_s=video_start_s,
        frames=None if video or not filmed else _existing(path / FRAMES.name),
        detections=_existing(path / DETECTIONS.name) if filmed else None,
        motion=None if video else _existing(path / MOTION.name),
        folds=None if video else _existing(path / FOLDS.name),
        frame_size=frame_size,
        notes=notes,
        truth=_existing(path / TRUTH.name),
        identity=_existing(path / IDENTITY.name),
        mission_file=mission,
    )


def _view_number(path: Path) -> int:
    """Number of the camera whose folder this is, 1 for a whole session's."""
    found = VIEW.fullmatch(path.resolve().name)
    return int(found[1]) if found and not segments(path / LOG) else 1


def _seen_by(number: int, mission: Mission, path: Path) -> Mission:
    """The mission as one of its cameras has it.

    Raises:
        SessionError: it has no such camera.
    """
    if number > len(mission.view) + 1:
        raise SessionError(f"{path}: its mission has {len(mission.view)} [[view]]; this needs {number - 1}")
    return mission if number == 1 else mission.views[number - 1]


def _existing(path: Path) -> Path | None:
    return path if segments(path) else None


def _has_rows(path: Path) -> bool:
    """Tell whether a table has anything below its head; one that cannot be read may have."""
    for part in segments(path):
        try:
            with os.fdopen(open_to_read(part), "rb") as file:
                if file.readline() and file.readline():
                    return True
        except OSError:
            return True
    return False


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
