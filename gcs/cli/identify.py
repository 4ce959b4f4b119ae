"""``gcs identify``: a recording in, identities out, no screen."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FRAME_SIZE, NO_NAMES, AsJson, VideoStart, parse_frame_size, print_json, print_note
from gcs.cli.output.progress import progress
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.playback.identification import identify_session
from gcs.report.rollcall import RollCall
from gcs.session.session import Session, open_session


def identify(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for identity.csv, identity.jsonl, events.jsonl.")],
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
    detect: Annotated[bool, typer.Option("--detect", help="Detect vehicles anew, whatever was recorded.")] = False,
    hindsight: Annotated[
        bool | None,
        typer.Option(
            "--hindsight/--as-seen",
            help="Name boxes by what is known of their track 15 s later, or as a screen would have shown them. "
            "Default: by hindsight, but a flight that Rollcall recorded as it was seen.",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Name the boxes of a recording, faster than real time; same input, same bytes."""
    size = parse_frame_size(frame_size)
    opened = open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size)
    calls = identify_into(opened, out, detect=detect, hindsight=hindsight)
    if as_json:
        print_json({**rollcall_json(calls), "folder": str(out)})
    else:
        print_rollcall(calls)
    if not calls.named:
        raise SystemExit(NO_NAMES)


def identify_into(session: Session, out: Path, *, detect: bool = False, hindsight: bool | None = None) -> RollCall:
    """Name the boxes of a session with a progress bar; notes and the time it took go to stderr."""
    start = time.monotonic()
    with progress("identify") as report:
        calls = identify_session(session, out, detect=detect, hindsight=hindsight, report=report, note=print_note)
    took = time.monotonic() - start
    print_note(f"{calls.frames} frames in {took:.1f} s, {calls.span_s / took:.1f} times real time; wrote {out}")
    return calls
