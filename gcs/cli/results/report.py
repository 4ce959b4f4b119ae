"""``gcs report``: one page about a flight."""

from __future__ import annotations

import hashlib
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gcs.batch.flights import input_files, mission_files
from gcs.cli.output.console import FRAME_SIZE, VideoStart, parse_frame_size, print_note
from gcs.cli.output.progress import progress
from gcs.errors import GcsError, ScoreError
from gcs.playback.analysis import Analysis
from gcs.playback.as_flown import FlownReports
from gcs.playback.moments import TICK_US
from gcs.report.page.flight_report import Provenance, flight_report
from gcs.report.page.flight_summary import FlightSummary
from gcs.report.page.stills import Stills
from gcs.report.score import Matched, match_files
from gcs.session.event_log import read_marks
from gcs.session.identity_log import IdentityLog
from gcs.session.line_file import open_new
from gcs.session.session import Session, open_session
from infra.session_format import IDENTITY


def report(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="HTML page to write.")],
    detect: Annotated[bool, typer.Option("--detect", help="Detect vehicles anew, whatever was recorded.")] = False,
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
) -> None:
    """Write a page about a flight: who was named when and how surely, map, pictures."""
    if out.exists():
        raise GcsError(f"{out}: exists already and is never overwritten; choose another name")
    size = parse_frame_size(frame_size)
    opened = open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size)
    analysis = Analysis(opened, redetect=detect)
    try:
        reports, trouble = FlownReports.of(analysis.opened)
        if trouble:
            print_note(trouble)
        record = FlightSummary(analysis.mission, reports.start_us, reports.stop_us, _frame_s(analysis))
        stills = Stills()
        matched = _fold(analysis, reports, record, stills)
        options = "looked at the video again" if detect else "as recorded"
        about = Provenance(
            name=opened.name,
            lacks=tuple(_lacks(analysis, record, matched)),
            settings={
                "Rollcall": version("rollcall-gcs"),
                "Python": sys.version.split()[0],
                "recorded by": opened.notes.program or "another program, or the simulator",
                "detections": options,
                "names": "as the screens showed them; gcs identify may know more by hindsight",
                **{f"network, {what}": digest for what, digest in opened.notes.models.items()},
            },
            files={path.name: _digest(path) for path in [*_read_files(opened), *mission_files(opened.mission)]},
            imported=opened.notes.imported,
            spans=opened.notes.spans,
        )
    finally:
        analysis.close()
    with open_new(out) as page:
        page.write(flight_report(record, stills, matched, about))
    print_note(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


def _frame_s(analysis: Analysis) -> float:
    """Usual time between two frames, or moments where there are none."""
    steps_us = np.diff(np.sort(analysis.times_us))
    return float(np.median(steps_us)) * 1e-6 if len(steps_us) and np.median(steps_us) > 0 else TICK_US * 1e-6


def _fold(analysis: Analysis, reports: FlownReports, record: FlightSummary, stills: Stills) -> Matched | None:
    """Fold the recording into record and pictures; returns its names beside the truth, None without one."""
    truth = analysis.opened.session.truth
    with tempfile.TemporaryDirectory(prefix="rollcall-report-") as folder:
        with IdentityLog(Path(folder)) as log, progress("report") as report_progress:
            frame = -1
            for at_us, snapshot in analysis.with_images(analysis.moments(reports.flown)):
                reports.add(at_us, snapshot.events, snapshot.alarms)
                record.add(at_us, snapshot)
                if snapshot.frame != frame:
                    frame = snapshot.frame
                    stills.add(snapshot)
                    log.write(snapshot)
                report_progress(*((each - reports.start_us) // 1_000_000 for each in (at_us, reports.stop_us)))
            reports.finish()
        marks = read_marks(analysis.opened.session.path, reports.start_us)
        record.set_reports(reports.spans(), (*reports.events(), *marks))
        record.rollcall.set_frame_count(analysis.frames, as_flown=analysis.as_flown)
        if truth is None:
            return None
        try:
            return match_files(truth, Path(folder) / IDENTITY.name)[0]
        except ScoreError as error:
            print_note(f"the names are not compared with the truth: {error}")
            return None


def _read_files(session: Session) -> list[Path]:
    paths = {view.path for view in (session, *session.other_views)}
    if not session.path.is_file():
        paths.add(session.tlog.parent)
    files = [file for path in sorted(paths) for file in input_files(path)]
    return [*files, *([session.video] if session.video and session.video not in files else [])]


def _lacks(analysis: Analysis, record: FlightSummary, matched: Matched | None) -> Iterator[str]:
    yield from analysis.warnings
    session = analysis.opened.session
    if session.video is None:
        yield "no video: there are no pictures, and detections cannot be looked at again"
    if session.mission is None:
        yield "no mission file: names of vehicles are those that their telemetry tells"
    if matched is None:
        yield "no truth (truth.csv): how right the names were is not known"
    calls = record.rollcall
    if unposed := calls.frames - calls.attitude_frames:
        yield f"in {unposed} of {calls.frames} frames it is not known where the camera was, or how it looked"


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise GcsError(f"{path}: cannot be read: {error.strerror}") from error
