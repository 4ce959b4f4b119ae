"""Naming the boxes of a recording: a session in, its identity log and roll call out. Prints nothing."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import SessionError
from gcs.health.alarm_history import AlarmSpan
from gcs.playback.analysis import Analysis
from gcs.playback.as_flown import FlownReports
from gcs.playback.hindsight import by_hindsight
from gcs.playback.side_by_side import side_by_side
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
_ALARMS_TOLD = 5
"""Alarms that are told one by one; the page about the flight has all."""
_FILES = (IDENTITY.name, IDENTITY_EVIDENCE, EVENTS)
_NEVER_OVERWRITTEN = "exists already and is never overwritten; choose another place"


def identify_session(
    session: Session,
    out: Path,
    *,
    detect: bool = False,
    hindsight: bool | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
    note: Callable[[str], None] = lambda text: None,
    open_detector: Callable[[DetectorChoice], Detector] | None = None,
    looking_threads: int = 2,
) -> RollCall:
    """Fold a session and write ``identity.csv``, ``identity.jsonl`` and ``events.jsonl``; same input, same bytes.

    Where the video's clock proves to be far off, or a camera that nothing describes was found by the film, it is done
    again with that known from the first frame on.

    A flight's further cameras are named with the first, each by what the others learnt of the vehicles as well; their
    files come into the folders ``view-2``, … in ``out``.

    The files are there when they are whole: what is broken off leaves none.

    Args:
        session: as ``gcs.session.session.open_session`` gives it.
        out: folder of the files, which must not be there yet; made where it is missing.
        detect: look at the video even if detections were kept.
        hindsight: name each box by what is known of its track 15 s later, not as a screen would have shown it. None:
            unless the recording kept the order in which a flight took it in; then the names are as they were seen.
        report: called after every frame with the frames that are done, and all there are.
        note: called with each line that a user should read: what the recording lacks, what the camera's stream did,
            what was not known in the end.
        open_detector: loads a mission's networks, for those who name many recordings; None: they are loaded anew.
        looking_threads: which look at the next frames of a video meanwhile; 0: one thread does all.

    Returns:
        Who was named when, and in how many boxes; of further cameras in its ``other_views``.

    Raises:
        SessionError: no frame in it, files of these names in ``out``, or it cannot be written.
        ConfigError, ModelError, LogError: mission, detector or telemetry cannot be used.
    """
    sessions = (session, *(session.other_views if session.is_first_view else ()))
    outs = [out, *(out / view.path.name for view in sessions[1:])]
    for path in (folder / name for folder in outs for name in _FILES):
        if os.path.lexists(path):
            raise SessionError(f"{path}: {_NEVER_OVERWRITTEN}")
    opened = partial(Analysis, redetect=detect, open_detector=open_detector, looking_threads=looking_threads)
    with contextlib.ExitStack() as stack:
        folders = [stack.enter_context(_aside(folder)) for folder in outs]
        views = _identify([opened(view) for view in sessions], folders, report, hindsight)
        found = [(view.clock_found, view.camera_found) for view in views]
        if any(each != (None, None) for each in found):
            known = zip(sessions, found, strict=True)
            analyses = [opened(view, video_offset_s=offset_s, camera=camera) for view, (offset_s, camera) in known]
            views = _identify_again(analyses, folders, report, hindsight, views)
    for view in views:
        films = f"{view.calls.films}: " if len(views) > 1 else ""
        for text in view.notes:
            note(f"{films}{text}")
    calls, *others = (view.calls for view in views)
    calls.other_views = tuple(others)
    return calls


def _identify_again(
    analyses: Sequence[Analysis],
    folders: Sequence[Path],
    report: Callable[[int, int], None],
    hindsight: bool | None,
    before: list[_NamedView],
) -> list[_NamedView]:
    """Name all frames with what was found before; whichever leaves fewer boxes without a name is kept."""
    again = [folder / "again" for folder in folders]
    for folder in again:
        folder.mkdir()
    views = _identify(analyses, again, report, hindsight)
    # vehicles that are late each by its own have no common clock: there the first look names more
    is_better = sum(view.calls.unnamed for view in views) <= sum(view.calls.unnamed for view in before)
    for folder in again:
        for name in _FILES if is_better else ():
            (folder / name).replace(folder.parent / name)
        shutil.rmtree(folder)
    if not is_better:
        return before
    for view, known in zip(views, before, strict=True):
        view.notes[:0] = _why_again(known.clock_found, known.camera_found)
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


def _why_again(offset_s: float | None, camera: Camera | None) -> Iterator[str]:
    if offset_s is not None:
        yield f"the video's clock is {_late(offset_s)} by the whole recording: named again with that taken out"
    if camera is not None and camera.intrinsics is not None:
        across = math.degrees(camera.intrinsics.hfov)
        yield (
            f"nothing describes the camera; by the whole film it sees {across:.0f}° across and looks "
            f"{-camera.pitch_deg:.0f}° down ({camera.mount}): named again with that"
        )


def _late(offset_s: float) -> str:
    return f"{abs(offset_s):.1f} s {'late' if offset_s > 0.0 else 'early'}"


def _identify(
    analyses: Sequence[Analysis],
    folders: Sequence[Path],
    report: Callable[[int, int], None],
    hindsight: bool | None,
) -> list[_NamedView]:
    """Name all frames of each camera, side by side."""
    frames, done = sum(len(analysis.times_us) for analysis in analyses), 0
    try:
        with contextlib.ExitStack() as stack:
            views = [_NamedView(analysis, folder, stack) for analysis, folder in zip(analyses, folders, strict=True)]
            if len(analyses) > 1:
                alone = [view.analysis.moments_alone(view.reports.flown) for view in views]
                moments = side_by_side(analyses, alone, wanted=len(views))
            else:
                moments = [views[0].analysis.moments(views[0].reports.flown)]
            going = {view: view.named(moment, hindsight) for view, moment in zip(views, moments, strict=True)}
            while going:
                view = min(going, key=lambda view: view.last.t_us if view.last else 0)
                before = view.last
                if next(going[view], None) is None:
                    del going[view]
                elif view.last is not None:
                    done += view.last.frame - (before.frame if before else -1)
                    report(done, frames)
    finally:
        for analysis in analyses:
            analysis.close()
    for view in views:
        view.finish()
    return views


def _alarms(spans: Iterable[AlarmSpan], start_us: int) -> list[str]:
    """Alarms in words, the first few; names are not to be read without them."""
    told = [span.alarm for span in spans if span.alarm.level == "alarm"]
    lines = [f"alarm at {1e-6 * (alarm.since_us - start_us):.0f} s: {alarm.text}" for alarm in told[:_ALARMS_TOLD]]
    return lines if len(told) <= _ALARMS_TOLD else [*lines, f"and {len(told) - _ALARMS_TOLD} alarms more"]


class _NamedView:
    """The view of one camera, while it is named and then.

    Attributes:
        calls: who was named.
        last: what was known after the last frame.
        notes: what a user should read, one line each.
    """

    def __init__(self, analysis: Analysis, out: Path, stack: contextlib.ExitStack) -> None:
        self.analysis, self.calls, self.notes = analysis, RollCall(analysis.mission), list(analysis.warnings)
        self.last: Snapshot | None = None
        self._blind = False
        self._log = stack.enter_context(IdentityLog(out))
        self._events = stack.enter_context(contextlib.closing(EventLog(out / EVENTS)))
        self.reports, trouble = FlownReports.of(analysis.opened)
        self.notes += [trouble] if trouble else []

    def named(self, moments: Iterator[tuple[int, Snapshot]], hindsight: bool | None) -> Iterator[Snapshot]:
        """Write down the frames of a recording, one after the other."""
        snapshots = self._frames(moments)
        if not self.analysis.as_flown if hindsight is None else hindsight:
            snapshots = by_hindsight(snapshots, self.analysis.mission)
        for snapshot in snapshots:
            self.last = snapshot
            self._log.write(snapshot)
            self.calls.look(snapshot)
            self._blind |= snapshot.pose == "no attitude"
            yield snapshot

    def _frames(self, moments: Iterator[tuple[int, Snapshot]]) -> Iterator[Snapshot]:
        """Its frames; what happened, with frames and without, is taken in on the way."""
        frame = -1
        for at_us, snapshot in moments:
            self.reports.add(at_us, snapshot.events, snapshot.alarms)
            self.calls.watch(snapshot, at_us)
            self._events.write(snapshot.events)
            for event in snapshot.events:
                if event.kind == "video" and event.level == "info" and not event.over:
                    self.notes.append(event.text)
            if snapshot.frame != frame:
                frame = snapshot.frame
                yield snapshot
        self.reports.finish()

    def finish(self) -> None:
        """Add up what was seen.

        Raises:
            SessionError: nothing was.
        """
        opened = self.analysis.opened
        if self.last is None:
            raise SessionError(f"{opened.session.path}: not one frame in it")
        self.calls.end(self.analysis.frames)
        marks = read_marks(opened.session.path, self.reports.start_us)
        self.calls.tell(self.reports.spans(), (*self.reports.flown, *marks))
        seen = opened.video is not None or opened.looks is not None
        self.notes += _alarms(self.reports.spans(), int(self.analysis.times_us[0]))
        self.notes += _doubts(self.last, self.calls, blind=self._blind, seen=seen)

    @property
    def clock_found(self) -> float | None:
        """Video time minus telemetry time in the end, s, where it was so far off that names had to wait for it.

        None where it was not, and for a flight that kept its order: that is named as it was seen.
        """
        assert self.last is not None
        health, declared = self.last.health, self.analysis.mission.clock.video_offset_s
        off_s = health.time_offset_s - (0.0 if declared == "auto" else float(declared))
        known = health.fit > SURE_FIT and health.time_offset_std_s < SURE_S
        return health.time_offset_s if known and abs(off_s) > AGAIN_S and not self.analysis.as_flown else None

    @property
    def camera_found(self) -> Camera | None:
        """The camera by the film, where names had to wait for it; None for a flight that kept its order, as above."""
        return None if self.analysis.as_flown else self.analysis.found_camera


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
