"""``gcs replay``: a recording on the screens."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import (
    FRAME_SIZE,
    GRAPHICS,
    MOST_FPS,
    Fps,
    Graphics,
    Theme,
    VideoStart,
    parse_frame_size,
    print_note,
    redirect_stderr,
)
from gcs.cli.telling import Show, Tell, parse_sinks, telling
from gcs.errors import GcsError
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.playback.replay import Replay
from gcs.session.metadata import seal
from gcs.session.session import Session, open_session

__all__ = ["replay", "show_replay"]


def replay(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
    detect: Annotated[bool, typer.Option("--detect", help="Look at the video even if detections were kept.")] = False,
    graphics: Annotated[Graphics, typer.Option(help=GRAPHICS)] = "auto",
    theme: Theme = "dark",
    fps: Fps = MOST_FPS,
    tell: Tell = None,
    show: Show = None,
) -> None:
    """Play, seek and step through a recording."""
    sinks = parse_sinks(tell, show)
    if session.is_dir() and (interrupted := seal(session.resolve())):
        print_note(interrupted.text)
    size = parse_frame_size(frame_size)
    raise SystemExit(
        show_replay(
            open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size),
            detect=detect,
            graphics=graphics,
            theme=theme,
            fps=fps,
            sinks=sinks,
        )
    )


def show_replay(
    session: Session,
    *,
    detect: bool = False,
    graphics: Graphics = "auto",
    theme: Theme = "dark",
    fps: float = MOST_FPS,
    sinks: Sequence[SinkUrl] = (),
) -> int:
    """Run the screens over a session until the user quits, or the terminal is gone; returns the exit code.

    Raises:
        GcsError: there is no terminal.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise GcsError(
            "gcs replay needs a terminal for its screens; "
            f"gcs identify {session.path} -o FOLDER names the vehicles without one"
        )
    # The screens are slow to import, and headless commands do without.
    from gcs.tui import run

    station = Replay(session, redetect=detect)
    try:
        source = SinkSource(name=session.name, replayed=True)
        with redirect_stderr(None), telling(station, sinks, source, Path()):
            return run(station, graphics, theme=theme, fps=fps).code
    finally:
        station.stop()
