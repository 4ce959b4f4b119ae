"""``gcs export``: an identity log in other people's formats."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import FRAME_SIZE, VIDEO_START, frame_size_of, note
from gcs.errors import GcsError
from gcs.export import FORMATS, open_export
from gcs.playback.analysis import Analysis
from gcs.session.identity_replay import recorded
from gcs.session.session import open_session
from gcs.snapshot import Snapshot

__all__ = ["export"]


def export(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write; the ending names the format.")],
    form: Annotated[str | None, typer.Option("--format", "-f", help=f"One of {', '.join(FORMATS)}.")] = None,
    identity: Annotated[Path | None, typer.Option(help="Export this identity.csv as it stands.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: Annotated[float, typer.Option(help=VIDEO_START)] = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
) -> None:
    """Write identities as csv, jsonl, or a film with the names drawn in (mp4)."""
    form = form or out.suffix.lstrip(".")
    size = frame_size_of(frame_size)
    analysis = Analysis(open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size))
    images = form == "mp4"
    if images and analysis.video is None:
        analysis.close()
        raise GcsError(f"{session}: no video in it to draw on; choose csv or jsonl")
    written = 0
    try:
        sink = open_export(form, out)
        for snapshot in _snapshots(analysis, identity, images):
            sink.write(snapshot)
            written += 1
        sink.close()
    finally:
        analysis.close()
    note(f"{written} frames written to {out}")


def _snapshots(analysis: Analysis, identity: Path | None, images: bool) -> Iterator[Snapshot]:
    """What a log says, or else what the analysis finds."""
    if identity is not None:
        return recorded(identity, analysis.mission, analysis.video if images else None, note)
    return analysis.snapshots(images=images)
