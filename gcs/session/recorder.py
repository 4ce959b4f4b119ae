"""Everything a flight leaves behind, written as it happens: each file is valid whenever the program dies.

No fault of the disk stops a flight or raises here once the files are made: what cannot be written waits in memory, and
``check`` gives the operator's events.
"""

from __future__ import annotations

import contextlib
import logging
import math
import shutil
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gcs.errors import SessionError
from gcs.health.station_alarms import STALLED_S
from gcs.mission.mission import Mission
from gcs.session.event_log import EventLog
from gcs.session.fold_order import FoldTurn, unfolded_row
from gcs.session.frame_tables import detection_rows, frame_row, look_rows, motion_row
from gcs.session.identity_log import IdentityLog
from gcs.session.line_file import LineFile
from gcs.session.metadata import SessionFile
from gcs.session.session import VIEW, create_folder
from gcs.snapshot import Event, Snapshot
from infra.files.append import Flusher
from infra.files.disk import OS_DISK, Disk
from infra.files.record_state import RecordState
from infra.program_log import LogFile, least_level
from infra.reporting import ReportGrowth
from infra.session_format import (
    DETECTIONS,
    ELSEWHERE,
    EVENTS,
    FOLDS,
    FRAMES,
    LOG,
    LOOKS,
    MOTION,
    PROGRAM_LOG,
    UNFOLDED,
    VIEW_FOLDER,
    TableFormat,
)
from infra.wall_clock import now_us
from mavlink.state import Level
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion

SYNC_S = 0.5
SETTLE_S = 0.05
"""A look at the files waits this long, all together, for lines that are just being written."""
GROWTH_S, SHORTEST_GROWTH_S = 300.0, 5.0
"""Growth is measured over the last five minutes, so that the answer is calm, and over five seconds at least."""
SLOW_S = 2.0
"""A disk that has not confirmed for this long is slow."""


class RecordingEvents:
    """Compares the states of the files with their previous ones."""

    def __init__(self) -> None:
        self._previous: dict[str, RecordState] = {}
        self._slow: set[str] = set()
        self._lost: defaultdict[str, ReportGrowth] = defaultdict(ReportGrowth)

    def update(self, t_us: int, states: Mapping[str, RecordState]) -> tuple[Event, ...]:
        """Events since the last call; ``states`` by what the operator calls the files."""
        events = []
        for name, state in states.items():
            previous = self._previous.get(name, RecordState(name=state.name))
            for level, text in self._changes(name, previous, state):
                events.append(Event(t_us=t_us, level=level, kind="recording", text=f"{name}: {text}"))
            self._previous[name] = state
        return tuple(events)

    def _changes(self, name: str, previous: RecordState, state: RecordState) -> Iterator[tuple[Level, str]]:
        if state.faults > previous.faults or (state.failing_s and state.reason != previous.reason):
            yield "alarm", f"cannot be written{state.because}; kept in memory until it can"
        if state.failing_s == 0 and (previous.failing_s > 0 or state.faults > previous.faults):
            goes_on = f", goes on in {state.name}" if state.name != previous.name else ""
            yield "info", f"written again{goes_on}"
        if self._lost[name].due(state.lost):
            yield "alarm", f"{state.lost} rows lost{state.because}"
        slow = state.sync_age_s > SLOW_S and not state.stalled_s > STALLED_S  # of that there is an alarm, for all files
        if slow != (name in self._slow):
            self._slow ^= {name}
            if slow:
                yield "warning", f"disk is slow: the last {state.sync_age_s:.0f} s would not survive a power cut"
            else:
                yield "info", "disk keeps up again"


class ViewRecorder:
    """Everything that one camera of a flight leaves behind; its methods may be called from any thread.

    Args:
        folder: where.
        make: makes a file from its path, its heading and whether it is made with its first row only.
        video: whether there is a camera.
        uav_id: of a further camera's aircraft; what is told of the fleet the first camera's events have.
        several: whether there are other cameras to hear of.

    Attributes:
        video_path: where the process of the video writes; None without a camera.
    """

    def __init__(
        self,
        folder: Path,
        make: Callable[..., LineFile],
        *,
        video: bool,
        uav_id: int = 0,
        several: bool = False,
    ) -> None:
        self.folder = folder
        self.video_path = folder / "video.mkv" if video else None

        def table(form: TableFormat, *, lazy: bool = False) -> LineFile | None:
            return make(folder / form.name, form.header, lazy=lazy) if video else None

        self._identity = IdentityLog(folder, make)
        whose = f"{folder.name}: " if VIEW.fullmatch(folder.name) else ""
        self._events = EventLog(folder / EVENTS, make, whose=whose, uav_id=uav_id)
        self._frames, self._detections, self._motion = table(FRAMES), table(DETECTIONS), table(MOTION)
        self._folds, self._unfolded = table(FOLDS), table(UNFOLDED, lazy=True)
        self._looks = table(LOOKS, lazy=True)
        self._elsewhere = table(ELSEWHERE, lazy=True) if several else None

    def frame_time(self, index: int, t_us: int) -> None:
        """Note when a frame of the recorded video was taken."""
        if self._frames:
            self._frames.write(frame_row(index, t_us))

    def detections(self, frame: int, detections: Detections) -> None:
        """Append what the detector saw in a frame, to the last digit: a replay folds the very same numbers."""
        if self._detections:
            self._detections.write(detection_rows(frame, detections))
        if self._looks and detections.looked is not None:
            self._looks.write(look_rows(frame, detections))

    def motion(self, frame: int, motion: ImageMotion) -> None:
        """Append how the camera moved from the last frame that was looked at to this one."""
        if self._motion:
            self._motion.write(motion_row(frame, motion))

    def fold(self, turn: FoldTurn) -> None:
        """Append a turn of the fold."""
        if self._folds:
            self._folds.write(turn.row)

    def heard(self, frame: int, system_id: int, of_frame: int) -> None:
        """Note which frame of another aircraft's camera was the last that a frame's names heard of."""
        if self._elsewhere:
            self._elsewhere.write(f"{frame},{system_id},{of_frame}\n")

    def unfolded(self, record: int, count: int) -> None:
        """Note records of the log that the fold has not taken in and never will.

        Args:
            record: number of the first.
        """
        if self._unfolded:
            self._unfolded.write(unfolded_row(record, count))

    def snapshot(self, snapshot: Snapshot) -> None:
        """Append a frame's identities and events."""
        self._identity.write(snapshot)
        self._events.write(snapshot.events)

    def events(self, events: tuple[Event, ...]) -> None:
        """Append events of a moment without a frame."""
        self._events.write(events)


class Recorder(ViewRecorder):
    """One session folder, open for writing; what the first camera sees is in it, further ones have a folder below.

    Args:
        parent: where the folder is made.
        mission: what flies.
        video: whether there is a camera.
        views: numbers of the further cameras, from 2 on.
        notes: what a replay has to know beside the mission (``gcs.session.metadata``).
        folder: one that was made already and has the telemetry of so far; None: a new one.
        began_us: when that was made, Unix µs.
        disk: the operating system, or a test's.

    Attributes:
        folder, tlog_path: where it all goes; the process of the links writes the latter.
        further: recorders of the further cameras, in the order of their numbers.
        began_us: when it was begun, Unix µs.
        full_in_s: until the disk is full if it fills up as in the last minutes, inf unknown.

    Raises:
        SessionError: the folder or a file cannot be made.
    """

    def __init__(
        self,
        parent: Path,
        mission: Mission,
        *,
        video: bool,
        views: Sequence[int] = (),
        notes: Mapping[str, Any] = MappingProxyType({}),
        folder: Path | None = None,
        began_us: int = 0,
        disk: Disk = OS_DISK,
    ) -> None:
        self.folder = folder or create_folder(parent)
        self.tlog_path = self.folder / LOG
        self.full_in_s = math.inf
        self.began_us = began_us or now_us()
        self._files: list[LineFile] = []
        self._log = LogFile(self.folder / PROGRAM_LOG, least_level(logging.INFO))
        try:
            started = datetime.fromtimestamp(self.began_us * 1e-6, UTC)
            self._session = SessionFile(self.folder, mission, {"started": started, **notes})
            make = partial(self._make, disk)
            super().__init__(self.folder, make, video=video, several=bool(views))
            self.further = tuple(
                ViewRecorder(self._view_folder(k), make, video=True, uav_id=mission.view[k - 2].system_id, several=True)
                for k in views
            )
        except BaseException:
            self._log.close()
            if folder is None:
                shutil.rmtree(self.folder, ignore_errors=True)  # nothing but headings is in it
            raise
        self._flusher = Flusher([file.file for file in self._files], SYNC_S)
        self._watch = RecordingEvents()
        self._space = SpaceForecast()
        self._free_bytes = shutil.disk_usage(self.folder).free

    def _make(self, disk: Disk, path: Path, header: str, *, lazy: bool = False) -> LineFile:
        file = LineFile(path, header, disk=disk, lazy=lazy)
        self._files.append(file)
        return file

    def _view_folder(self, number: int) -> Path:
        folder = self.folder / VIEW_FOLDER.format(number)
        try:
            folder.mkdir(mode=0o755)
        except OSError as error:
            raise SessionError(f"{folder}: cannot be made: {error.strerror}; choose another place") from error
        return folder

    def check(self, telemetry: RecordState | None = None) -> tuple[Event, ...]:
        """Events about files and disk since the last call; to be called once a second or more often."""
        self._session.restore()
        with contextlib.suppress(OSError):  # a folder that was deleted is being made again
            self._free_bytes = shutil.disk_usage(self.folder).free
        t_us, settled_s = now_us(), time.monotonic() + SETTLE_S
        for file in self._files:
            file.settle(max(settled_s - time.monotonic(), 0.0))
        events = self._watch.update(t_us, self.states(telemetry))
        self.full_in_s = self._space.update(time.monotonic(), self._free_bytes, self.bytes)
        return events

    def states(self, telemetry: RecordState | None = None) -> dict[str, RecordState]:
        """State of each file, by its name; ``view-2/frames.csv`` is a further camera's."""
        found = {str(file.file.path.relative_to(self.folder)): file.state for file in self._files}
        return found if telemetry is None else {self.tlog_path.name: telemetry} | found

    @property
    def free_bytes(self) -> int:
        """Space left on the disk at the last check."""
        return self._free_bytes

    @property
    def bytes(self) -> int:
        """Size of the session so far."""
        size = 0
        for folder in (self.folder, *(view.folder for view in self.further)):
            with contextlib.suppress(OSError):  # one may be deleted meanwhile
                size += sum(path.stat().st_size for path in folder.iterdir())
        return size

    def close(self, telemetry: RecordState | None = None, **notes: int) -> tuple[str, ...]:
        """Write what still waits and seal the session; returns what was lost, a line each."""
        self._flusher.stop()
        for file in self._files:
            file.close()
        states = self.states(telemetry)
        lost = {name: state.lost for name, state in states.items() if state.lost}
        log = states.get(self.tlog_path.name, RecordState(name=""))
        if not any(state.stalled_s for state in states.values()):  # it would wait, and the next start seals it too
            self._session.close({"packets": log.rows, **notes} | ({"lost": lost} if lost else {}))
        self._log.close()
        return tuple(f"{name}: {rows} rows lost{states[name].because}" for name, rows in lost.items())


class SpaceForecast:
    """Time for which the disk will last, by what was free and what was written in the last minutes."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int, int]] = deque()

    def update(self, now_s: float, free_bytes: int, written_bytes: int) -> float:
        """Take a measurement; seconds until the disk is full if it goes on so, inf while nothing grows.

        Args:
            now_s: monotonic.
            written_bytes: of the whole session so far, video included.
        """
        self._seen.append((now_s, free_bytes, written_bytes))
        while self._seen[0][0] < now_s - GROWTH_S:
            self._seen.popleft()
        then_s, then_free, then_written = self._seen[0]
        if now_s - then_s < SHORTEST_GROWTH_S:
            return math.inf
        # t = free / rate; others may fill the disk too: the faster of what we write and what goes
        grown = max(written_bytes - then_written, then_free - free_bytes, 0)
        return free_bytes * (now_s - then_s) / grown if grown else math.inf
