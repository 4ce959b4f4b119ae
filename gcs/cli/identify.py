"""``gcs identify``: a recording in, identities out, no screen."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FRAME_SIZE, NO_NAMES, AsJson, VideoStart, parse_frame_size, print_json, print_note
from gcs.cli.output.progress import progress
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.errors import SessionError
from gcs.playback.analysis import Analysis
from gcs.report.rollcall import RollCall
from gcs.session.event_log import EventLog
from gcs.session.identity_log import IdentityLog
from gcs.session.session import Session, open_session
from gcs.snapshot import Snapshot

__all__ = ["identify", "identify_into"]


def identify(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for identity.csv, identity.jsonl, events.jsonl.")],
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
    detect: Annotated[bool, typer.Option("--detect", help="Look at the video even if detections were kept.")] = False,
    as_json: AsJson = False,
) -> None:
    """Name the boxes of a recording, faster than real time; same input, same bytes."""
    size = parse_frame_size(frame_size)
    opened = open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size)
    calls = identify_into(opened, out, detect=detect)
    if as_json:
        print_json({**rollcall_json(calls), "folder": str(out)})
    else:
        print_rollcall(calls)
    if not calls.named:
        raise SystemExit(NO_NAMES)


def identify_into(session: Session, out: Path, *, detect: bool = False) -> RollCall:
    """Fold a session and write its identity log; warnings go to stderr."""
    analysis = Analysis(session, redetect=detect)
    for text in analysis.warnings:
        print_note(text)
    start = time.monotonic()
    calls = RollCall(analysis.mission)
    last: Snapshot | None = None
    blind = False
    try:
        with IdentityLog(out) as log, progress("identify") as report:
            events = EventLog(out / "events.jsonl")
            for last in analysis.snapshots(images=False):
                log.write(last)
                events.write(last.events)
                calls.add(last)
                for event in last.events:
                    if event.kind == "video" and event.level == "info":
                        print_note(event.text)
                report(calls.frames, len(analysis.times_us))
                blind |= last.pose == "no attitude"
            events.close()
    finally:
        analysis.close()
    if last is None:
        raise SessionError(f"{session.path}: not one frame in it")
    for text in _doubts(last, calls, blind=blind):
        print_note(text)
    took = time.monotonic() - start
    span = (int(analysis.times_us[-1]) - int(analysis.times_us[0])) * 1e-6
    print_note(f"{calls.frames} frames in {took:.1f} s, {span / took:.1f} times real time; wrote {out}")
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
