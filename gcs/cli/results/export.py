"""``gcs export``: an identity log in other people's formats."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FRAME_SIZE, VideoStart, parse_frame_size, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.export.unfinished import writing_to
from gcs.playback.analysis import Analysis
from gcs.session.identity_replay import read_snapshots
from gcs.session.session import open_session
from gcs.snapshot import Snapshot


def export(
    session: Annotated[Path | None, typer.Argument(help="Session folder, or a telemetry log.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File or folder to write; the ending chooses the format.")
    ] = None,
    form: Annotated[str | None, typer.Option("--format", "-f", help="Format by name, as --list shows them.")] = None,
    formats: Annotated[bool, typer.Option("--list", help="List the formats, and what opens each.")] = False,
    every: Annotated[int, typer.Option(min=1, max=1_000_000, help="Export only every n-th frame.")] = 1,
    min_confidence: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Training labels: leave out frames with less certain names.")
    ] = 0.0,
    identity: Annotated[Path | None, typer.Option(help="Export the names of this identity.csv, unchanged.")] = None,
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
) -> None:
    """Write identities for other programs: tables, maps, films, labels; --list shows all."""
    if formats:
        rows = [
            (form.name, form.suffix or "folder", form.contents, form.opened_by, form.extra) for form in FORMATS.values()
        ]
        print_table(("format", "ending", "contents", "opened by", "extra"), rows)
        return
    if session is None or out is None:
        raise GcsError("export what, and where to? gcs export SESSION -o FILE; gcs export --list shows the formats")
    file_format = format_for(out, form)
    size = parse_frame_size(frame_size)
    opened = open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size)
    analysis = Analysis(opened)
    written = 0
    try:
        job = ExportJob(
            path=out,
            name=opened.name,
            video=opened.video,
            truth=opened.truth,
            times_us=analysis.times_us,
            min_confidence=min_confidence,
            note=print_note,
        )
        with writing_to(out):
            sink = file_format.open(job)
        with progress("export") as report:
            for count, snapshot in enumerate(_snapshots(analysis, identity, file_format.needs_images)):
                if count % every == 0:
                    with writing_to(out):
                        written += sink.write(snapshot) is not False
                report(count + 1, len(analysis.times_us))
        with writing_to(out):
            sink.close()
    finally:
        analysis.close()
    print_note(f"{written} frames written to {out}")


def _snapshots(analysis: Analysis, identity: Path | None, images: bool) -> Iterator[Snapshot]:
    """Snapshots of an identity log, or else of the analysis."""
    if identity is not None:
        return read_snapshots(
            identity, analysis.mission, analysis.video if images else None, print_note, analysis.times_us
        )
    return analysis.snapshots(images=images)
