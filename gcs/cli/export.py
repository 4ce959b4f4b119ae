"""``gcs export``: an identity log in other people's formats."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FRAME_SIZE, VideoStart, parse_frame_size, print_note
from gcs.cli.output.progress import progress
from gcs.errors import GcsError
from gcs.export import FORMATS, export_format
from gcs.playback.analysis import Analysis
from gcs.session.identity_replay import read_snapshots
from gcs.session.session import open_session
from gcs.snapshot import Snapshot

__all__ = ["export"]


def export(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write; the ending names the format.")],
    form: Annotated[str | None, typer.Option("--format", "-f", help=f"One of {', '.join(FORMATS)}.")] = None,
    identity: Annotated[Path | None, typer.Option(help="Export this identity.csv as it is.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
) -> None:
    """Write identities as csv, jsonl, or a film with the names drawn in (mp4)."""
    file_format = export_format(form or out.suffix.lstrip("."))
    size = parse_frame_size(frame_size)
    analysis = Analysis(open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size))
    written = 0
    try:
        if file_format.needs_images and analysis.video is None:
            others = " or ".join(name for name, other in FORMATS.items() if not other.needs_images)
            raise GcsError(f"{session}: no video in it to draw on; choose {others}")
        sink = file_format(out)
        with progress("export") as report:
            for snapshot in _snapshots(analysis, identity, file_format.needs_images):
                sink.write(snapshot)
                written += 1
                report(written, len(analysis.times_us))
        sink.close()
    finally:
        analysis.close()
    print_note(f"{written} frames written to {out}")


def _snapshots(analysis: Analysis, identity: Path | None, images: bool) -> Iterator[Snapshot]:
    """Snapshots of an identity log, or else of the analysis."""
    if identity is not None:
        return read_snapshots(identity, analysis.mission, analysis.video if images else None, print_note)
    return analysis.snapshots(images=images)
