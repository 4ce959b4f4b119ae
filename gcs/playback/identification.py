"""Naming the boxes of a recording: a session in, its identity log and roll call out. Prints nothing."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import SessionError
from gcs.health.alarm_history import AlarmSpan
from gcs.playback.analysis import Analysis
from gcs.playback.as_flown import FlownReports
from gcs.playback.hindsight import by_hindsight
from gcs.playback.in_step import InStep
from gcs.report.rollcall import WITHOUT_POSITION, RollCall
from gcs.session.event_log import EventLog, read_marks
from gcs.session.identity_log import IdentityLog
from gcs.session.session import Session
from gcs.snapshot import Snapshot
from infra.files.aside import make_aside, put_all_in_place, remove_aside
from infra.session_format import EVENTS, IDENTITY, IDENTITY_EVIDENCE

if TYPE_CHECKING:
    from gcs.mission.mission import Camera, DetectorChoice
    from vision.detect.detector import Detector

AGAIN_S = 0.3
"""Offset from which on the names of the first seconds wait until the video's clock is found, s."""
SURE_S, SURE_FIT = 0.1, 0.99
"""Largest 1σ of the offset, s, and least probability that film and telemetry belong together, with which it counts."""
_ENDED_US = sys.maxsize
"""Time in place of that of the next frame where there is none."""
_MAX_ALARMS = 5
"""Alarms that are reported one by one; the page about the flight has all."""
_FILES = (IDENTITY.name, IDENTITY_EVIDENCE, EVENTS)
_NEVER_OVERWRITTEN = "exists already and is never overwritten; choose another place"


def identify_session(
    session: Session,
    out: Path,
    *,
    detect: bool = False,
    hindsight: bool | None = None,
    further: bool = True,
    report: Callable[[int, int], None] = lambda done, total: None,
    note: Callable[[str], None] = lambda text: None,
    open_detector: Callable[[DetectorChoice], Detector] | None = None,
    looking_threads: int = 2,
) -> RollCall:
    """Fold a session and write ``identity.csv``, ``identity.jsonl`` and ``events.jsonl``; same input, same bytes.

    Where the video's clock proves to be far off, or a camera that nothing describes was found by the film, it is done
    again with that known from the first frame on.

    A flight's further cameras are named beside the first, each with what the others know; their files come into the
    folders ``view-2``, … in ``out``.

    The files are there when they are whole: what is broken off leaves none.

    Args:
        session: as ``gcs.session.session.open_session`` gives it.
        out: folder of the files, which must not be there yet; made where it is missing.
        detect: look at the video even if detections were kept.
        hindsight: name each box by the whole recording, not as a screen would have shown it. None:
            unless the recording kept the order in which a flight took it in; then the names are as they were seen.
        further: name what the flight's further cameras saw, too.
        report: called after every frame with the frames that are done, and all there are, of all cameras.
        note: called with each line that a user should read: what the recording lacks, what the camera's stream did,
            what was not known in the end.
        open_detector: loads a mission's networks, for those who name many recordings; None: they are loaded again.
        looking_threads: which look at the next frames of a video meanwhile; 0: one thread does all.

    Returns:
        Who was named when, and in how many boxes; of further cameras in its ``other_views``.

    Raises:
        SessionError: no frame in it, files of these names in ``out``, or it cannot be written.
        ConfigError, ModelError, LogError: mission, detector or telemetry cannot be used.
    """
    sessions = (session, *(session.other_views if further and session.is_first_view else ()))
    outs = [out, *(out / view.path.name for view in sessions[1:])]
    for path in (folder / name for folder in outs for name in _FILES):
        if os.path.lexists(path):
            raise SessionError(f"{path}: {_NEVER_OVERWRITTEN}")
    opening = partial(Analysis, redetect=detect, open_detector=open_detector, looking_threads=looking_threads)
    with contextlib.ExitStack() as stack:
        folders = [stack.enter_context(_aside(each)) for each in outs]
        views = _identify_views([partial(opening, view) for view in sessions], folders, report, hindsight)
    for view in views:
        for text in view.notes:
            note(f"{view.calls.uav_name}: {text}" if len(views) > 1 else text)
    first, *others = (view.calls for view in views)
    first.other_views = tuple(others)
    return first


def _identify_views(
    opened: Sequence[Callable[..., Analysis]],
    folders: Sequence[Path],
    report: Callable[[int, int], None],
    hindsight: bool | None,
) -> list[_NamedCamera]:
    """Name the boxes of all cameras; again, with what was found of them, where that leaves fewer without a name."""
    views = _identify_in_step(opened, folders, report, hindsight)
    found = [view.found() for view in views]
    if not any(found):
        return views
    folders_again = [folder / "again" for folder in folders]
    for folder in folders_again:
        folder.mkdir()
    opened_again = [partial(opening, **each) for opening, each in zip(opened, found, strict=True)]
    second = _identify_in_step(opened_again, folders_again, report, hindsight)
    for view, each in zip(second, found, strict=True):
        view.notes[:0] = _why_again(**each)
    # vehicles that are late each by its own have no common clock: there the first look names more
    better = sum(view.calls.unnamed for view in second) <= sum(view.calls.unnamed for view in views)
    for folder, again in zip(folders, folders_again, strict=True):
        for name in _FILES if better else ():
            (again / name).replace(folder / name)
        shutil.rmtree(again)
    return second if better else views


def _identify_in_step(
    opened: Sequence[Callable[..., Analysis]],
    folders: Sequence[Path],
    report: Callable[[int, int], None],
    hindsight: bool | None,
) -> list[_NamedCamera]:
    """Name the boxes of all cameras once, side by side: that of the earliest frame goes on first."""
    in_step = InStep() if len(opened) > 1 else None
    with contextlib.ExitStack() as stack:
        views = list[_NamedCamera]()

        def tell() -> None:
            report(sum(view.done for view in views), sum(len(view.analysis.times_us) for view in views))

        for opening, folder in zip(opened, folders, strict=True):
            view = _NamedCamera(opening(in_step=in_step), folder, hindsight, tell)
            stack.callback(view.analysis.close)
            views.append(view)
        ways = [stack.enter_context(contextlib.closing(view.identify())) for view in views]
        at_us = [next(way) for way in ways]
        while (earliest := min(at_us)) < _ENDED_US:
            k = at_us.index(earliest)
            at_us[k] = next(ways[k], _ENDED_US)
    return views


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
        remove_aside(folder)


@contextlib.contextmanager
def _as_session_error(out: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError as error:
        raise SessionError(f"{error.filename2 or error.filename}: {_NEVER_OVERWRITTEN}") from None
    except OSError as error:
        raise SessionError(f"{out}: cannot be written: {error.strerror}; choose another place") from error


class _NamedCamera:
    """One camera of a recording and the names of its boxes.

    Args:
        analysis: folds what it saw.
        folder: of the files.
        hindsight: as of :func:`identify_session`.
        tell: called after each frame that was folded.

    Attributes:
        calls: who was named.
        notes: lines that a user should read.
        done: how many frames are folded: names by hindsight come a minute and more of the recording later.
    """

    def __init__(self, analysis: Analysis, folder: Path, hindsight: bool | None, tell: Callable[[], None]) -> None:
        self.analysis, self._folder, self._tell = analysis, folder, tell
        self._hindsight = not analysis.as_flown if hindsight is None else hindsight
        self.calls, self.notes, self.done = RollCall(analysis.mission), list(analysis.warnings), 0
        self._last: Snapshot | None = None
        self._offset_s = math.nan
        """The video's offset when it was last surely known."""

    def identify(self) -> Generator[int, None, None]:
        """Name all frames; yields the time of the first before, and then that of each."""
        analysis, calls, blind = self.analysis, self.calls, False
        evidence = analysis.keep_evidence() if self._hindsight else None
        with IdentityLog(self._folder) as log, contextlib.closing(EventLog(self._folder / EVENTS)) as events:
            reports, trouble = FlownReports.of(analysis.opened)
            if trouble:
                self.notes.append(trouble)
            moments = analysis.moments(reports.flown)
            yield int(analysis.times_us[0]) if len(analysis.times_us) else 0
            snapshots = self._counted(_frames(moments, reports, calls, events, self.notes.append))
            if evidence is not None:
                snapshots = by_hindsight(snapshots, analysis.mission, evidence)
            for last in snapshots:
                log.write(last)
                calls.add_boxes(last)
                blind |= last.pose == "no attitude"
                self._last = last
                health = last.health
                if health.fit > SURE_FIT and health.time_offset_std_s < SURE_S:
                    self._offset_s = health.time_offset_s
                yield last.t_us
        if self._last is None:
            raise SessionError(f"{analysis.opened.session.path}: not one frame in it")
        calls.set_frame_count(analysis.frames, as_flown=analysis.as_flown)
        marks = read_marks(analysis.opened.session.path, reports.start_us)
        calls.set_reports(reports.spans(), (*reports.flown, *marks))
        seen = analysis.opened.video is not None or analysis.opened.looks is not None
        self.notes += _alarms(reports.spans(), int(analysis.times_us[0]))
        self.notes += _doubts(self._last, calls, blind=blind, seen=seen)

    def _counted(self, snapshots: Iterable[Snapshot]) -> Iterator[Snapshot]:
        for snapshot in snapshots:
            self.done = snapshot.frame + 1
            self._tell()
            yield snapshot

    def found(self) -> dict[str, Any]:
        """Findings that names had to wait for, as :class:`Analysis` takes them: the video's offset where it was far
        off, and the camera by the film; nothing for a flight that kept its order, which is named as it was seen.
        """
        if self.analysis.as_flown or self._last is None:
            return {}
        off_s = self._offset_s - self.analysis.mission.clock.declared_offset_s
        offset = {"video_offset_s": self._offset_s} if abs(off_s) > AGAIN_S else {}
        camera = self.analysis.found_camera
        return offset if camera is None else {**offset, "camera": camera}


def _why_again(video_offset_s: float | None = None, camera: Camera | None = None) -> Iterator[str]:
    if video_offset_s is not None:
        yield f"the video's clock is {_late(video_offset_s)} by the whole recording: named again with that taken out"
    if camera is not None and camera.intrinsics is not None:
        across = math.degrees(camera.intrinsics.hfov)
        yield (
            f"nothing describes the camera; by the whole film it sees {across:.0f}° across and looks "
            f"{-camera.pitch_deg:.0f}° down ({camera.mount}): named again with that"
        )


def _late(offset_s: float) -> str:
    return f"{abs(offset_s):.1f} s {'late' if offset_s > 0.0 else 'early'}"


def _alarms(spans: Iterable[AlarmSpan], start_us: int) -> list[str]:
    """Alarms in words, the first few; names are not to be read without them."""
    raised = [span.alarm for span in spans if span.alarm.level == "alarm"]
    lines = [f"alarm at {1e-6 * (alarm.since_us - start_us):.0f} s: {alarm.text}" for alarm in raised[:_MAX_ALARMS]]
    return lines if len(raised) <= _MAX_ALARMS else [*lines, f"and {len(raised) - _MAX_ALARMS} alarms more"]


def _frames(
    moments: Iterator[tuple[int, Snapshot]],
    reports: FlownReports,
    calls: RollCall,
    events: EventLog,
    note: Callable[[str], None],
) -> Iterator[Snapshot]:
    """The frames of a recording; what happened in it, with frames and without, is taken in on the way."""
    frame = -1
    for at_us, snapshot in moments:
        reports.add(at_us, snapshot.events, snapshot.alarms)
        calls.add_fleet(snapshot, at_us)
        events.write(snapshot.events)
        for event in snapshot.events:
            if event.kind == "video" and event.level == "info" and not event.over:
                note(event.text)
        if snapshot.frame != frame:
            frame = snapshot.frame
            yield snapshot
    reports.finish()


def _doubts(last: Snapshot, calls: RollCall, *, blind: bool, seen: bool) -> list[str]:
    """Warnings for the operator about inputs that were lacking.

    Args:
        last: what was known in the end.
        calls: what was named.
        blind: the attitude was all that lacked once.
        seen: there is a video, or what was seen in it.
    """
    doubts = []
    if not seen:
        film = "there is neither a video nor boxes seen in one: give the film with --video, its camera with --mission"
        doubts.append(film)
    uav = last.vehicles[0]
    if uav.position_state == "never":
        doubts.append(
            f"the UAV (system id {uav.system_id}) reported no position up to the last frame: nothing can be placed or "
            "named"
        )
    elif blind and calls.attitude_frames == 0:
        doubts.append("the UAV never reported its attitude: names rest on motion alone and take longer")
    unplaced: dict[str, list[str]] = {}
    for row in calls.rows():
        if row.outcome in WITHOUT_POSITION:
            unplaced.setdefault(row.remark, []).append(row.name)
    doubts += [f"{', '.join(names)} cannot be named: {remark}" for remark, names in unplaced.items()]
    if seen and not calls.boxes:
        doubts.append("not one vehicle was detected in the video" if calls.frames else "no frame was looked at")
    return doubts
