"""Naming the boxes of a recording: a session in, its identity log and roll call out. Prints nothing."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import SessionError
from gcs.playback.analysis import Analysis
from gcs.report.rollcall import RollCall
from gcs.session.event_log import EventLog
from gcs.session.identity_log import IdentityLog
from gcs.session.session import Session
from gcs.snapshot import Snapshot
from infra.files.aside import make_aside, put_all_in_place
from infra.session_format import EVENTS, IDENTITY, IDENTITY_EVIDENCE

if TYPE_CHECKING:
    from gcs.mission.mission import DetectorChoice
    from vision.detect.detector import Detector

__all__ = ["identify_session"]

_FILES = (IDENTITY.name, IDENTITY_EVIDENCE, EVENTS)
_NEVER_OVERWRITTEN = "exists already and is never overwritten; choose another place"


def identify_session(
    session: Session,
    out: Path,
    *,
    detect: bool = False,
    report: Callable[[int, int], None] = lambda done, total: None,
    note: Callable[[str], None] = lambda text: None,
    open_detector: Callable[[DetectorChoice], Detector] | None = None,
    looking_threads: int = 2,
) -> RollCall:
    """Fold a session and write ``identity.csv``, ``identity.jsonl`` and ``events.jsonl``; same input, same bytes.

    The files are there when they are whole: what is broken off leaves none.

    Args:
        session: as ``gcs.session.session.open_session`` gives it.
        out: folder of the files, which must not be there yet; made where it is missing.
        detect: look at the video even if detections were kept.
        report: called after every frame with the frames that are done, and all there are.
        note: called with each line that a user should read: what the recording lacks, what the camera's stream did,
            what was not known in the end.
        open_detector: loads a mission's networks, for those who name many recordings; None: they are loaded anew.
        looking_threads: which look at the next frames of a video meanwhile; 0: one thread does all.

    Returns:
        Who was named when, and in how many boxes.

    Raises:
        SessionError: no frame in it, files of these names in ``out``, or it cannot be written.
        ConfigError, ModelError, LogError: mission, detector or telemetry cannot be used.
    """
    for name in _FILES:
        if os.path.lexists(out / name):
            raise SessionError(f"{out / name}: {_NEVER_OVERWRITTEN}")
    with _aside(out) as folder:
        analysis = Analysis(session, redetect=detect, open_detector=open_detector, looking_threads=looking_threads)
        return _identify(analysis, folder, report, note)


@contextlib.contextmanager
def _aside(out: Path) -> Iterator[Path]:
    """A folder whose files come into ``out`` at the end; an error leaves none."""
    with _as_session_error(out):
        folder = make_aside(out)
    try:
        yield folder
        with _as_session_error(out):
            put_all_in_place(folder, out, last=IDENTITY.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _as_session_error(out: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError as error:
        raise SessionError(f"{error.filename2 or error.filename}: {_NEVER_OVERWRITTEN}") from None
    except OSError as error:
        raise SessionError(f"{out}: cannot be written: {error.strerror}; choose another place") from error


def _identify(
    analysis: Analysis, out: Path, report: Callable[[int, int], None], note: Callable[[str], None]
) -> RollCall:
    for text in analysis.warnings:
        note(text)
    calls = RollCall(analysis.mission)
    last: Snapshot | None = None
    blind = False
    try:
        with IdentityLog(out) as log, contextlib.closing(EventLog(out / EVENTS)) as events:
            for last in analysis.snapshots(images=False):
                log.write(last)
                events.write(last.events)
                calls.add(last)
                for event in last.events:
                    if event.kind == "video" and event.level == "info":
                        note(event.text)
                report(calls.frames, len(analysis.times_us))
                blind |= last.pose == "no attitude"
    finally:
        analysis.close()
    if last is None:
        raise SessionError(f"{analysis.opened.session.path}: not one frame in it")
    for text in _doubts(last, calls, blind=blind):
        note(text)
    return calls


def _doubts(last: Snapshot, calls: RollCall, *, blind: bool) -> list[str]:
    """What an operator should know about inputs that were lacking; blind: the attitude was all that lacked once."""
    doubts = []
    uav = last.vehicles[0]
    if uav.position_state == "never":
        doubts.append(f"the UAV (system id {uav.system_id}) never reported a position: nothing can be placed or named")
    elif blind and calls.attitude_frames == 0:
        doubts.append("the UAV never reported its attitude: names rest on motion alone and take longer")
    silent = [row.name for row in last.vehicles[1:] if row.position_state == "never"]
    if silent:
        doubts.append(f"no position was ever reported by {', '.join(silent)}: they cannot be named")
    if not calls.boxes:
        doubts.append("not one vehicle was detected in the video")
    return doubts
