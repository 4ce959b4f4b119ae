"""``gcs replay``: a recording on the screens.

What opens and folds a recording is imported when one is opened: ``--help`` does without.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from gcs.cli.output.console import (
    FRAME_SIZE,
    VideoStart,
    as_typed,
    check_range,
    check_terminal,
    parse_frame_size,
    print_lines,
    print_note,
    redirect_stderr,
)
from gcs.cli.screen_options import ScreenOptions, Ui, screen_options
from gcs.cli.sharing.publishing import Publish, Stream, parse_sinks, publishing
from gcs.errors import GcsError

if TYPE_CHECKING:
    from gcs.live_out.sink_url import SinkUrl
    from gcs.session.session import Session


def replay(
    session: Annotated[Path, typer.Argument(help="Session folder, or a telemetry log.")],
    video: Annotated[Path | None, typer.Option(help="Video file of a bare telemetry log.")] = None,
    video_start: VideoStart = 0.0,
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the session's own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
    detect: Annotated[bool, typer.Option("--detect", help="Detect vehicles anew, whatever was recorded.")] = False,
    ui: Ui = None,
    publish: Publish = None,
    stream: Stream = None,
    serve: Annotated[
        bool,
        typer.Option("--serve", help="Show the screens in browsers on this computer, at a secret address."),
    ] = False,
    port: Annotated[
        int, typer.Option(callback=check_range(0, 65535), help="With --serve: of the loopback; 0 is any free one.")
    ] = 0,
) -> None:
    """Play, seek and step through a recording."""
    from gcs.session.metadata import in_flight, seal
    from gcs.session.session import open_session

    sinks, options = parse_sinks(publish, stream), screen_options(ui)
    if serve and sinks:
        raise GcsError("--serve starts a replay for each browser; give --publish and --stream to one on a terminal")
    if serve and in_flight(session):
        raise GcsError(f"{session}: it is being flown, and a flight is never served; gcs fly --attach shows it")
    if session.is_dir() and (interrupted := seal(session.resolve())):
        print_note(interrupted.text)
    size = parse_frame_size(frame_size)
    opened = open_session(session, video=video, video_start_s=video_start, mission=mission, frame_size=size)
    if serve:
        given = {"--video": video, "--mission": mission, "--frame-size": frame_size}
        words = [word for option, value in given.items() if value is not None for word in (option, str(value))]
        graphics = "blocks" if options.graphics in ("auto", "pixels") else options.graphics
        shown = {**msgspec.to_builtins(options), "graphics": graphics}
        words += ["--video-start", str(video_start)]
        words += [f"--ui={key}={str(value).lower()}" for key, value in shown.items()]
        _serve(session, [*words, *(["--detect"] if detect else [])], port)
        return
    raise SystemExit(show_replay(opened, options, detect=detect, sinks=sinks))


def _serve(session: Path, words: Sequence[str], port: int) -> None:
    """Serve a replay until it is stopped.

    Raises:
        GcsError: it cannot be served.
    """
    try:
        from gcs.cli.sharing.serving import serve_screens  # an extra, which takes its time
    except ImportError as error:
        raise GcsError(f"--serve needs {error.name}; install it with: pip install 'rollcall-gcs[serve]'") from error
    gcs = (sys.executable, "-P", "-c", "from gcs.cli.start import main; main()")
    command = shlex.join([*gcs, "replay", str(session.absolute()), *words])

    def show(address: str) -> None:
        print_lines(address)
        print_note("whoever has this address sees the recording and can write nothing on this computer; Ctrl-C ends it")

    try:
        serve_screens(command, f"gcs replay {session.name}", port, show)
    except OSError as error:
        raise GcsError(f"--port {port}: {error.strerror}; take another, or leave it out") from error


def _in_browser() -> bool:
    """Tell whether this is the process that ``--serve`` started for a browser."""
    return "web_driver" in os.environ.get("TEXTUAL_DRIVER", "")


def show_replay(
    session: Session,
    options: ScreenOptions,
    *,
    detect: bool = False,
    sinks: Sequence[SinkUrl] = (),
) -> int:
    """Run the screens over a session until the user quits, or the terminal is gone; returns the exit code.

    Raises:
        GcsError: there is no terminal.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()) and not _in_browser():
        raise GcsError(
            "gcs replay needs a terminal for its screens; "
            f"gcs identify {as_typed(session.path)} -o FOLDER names the vehicles without one"
        )
    if not _in_browser():
        check_terminal(f"gcs identify {as_typed(session.path)} -o FOLDER names the vehicles without")
    from gcs.playback.replay import Replay

    # a film is opened by another process, and the screens, which are slow to import, are imported meanwhile
    with ThreadPoolExecutor(1) as pool:
        opening = pool.submit(Replay, session, redetect=detect)
        from gcs.tui import run

        station = opening.result()
    try:
        with redirect_stderr(None), publishing(station, sinks, session.name, Path(), replayed=True):
            return run(station, options.graphics, bell=options.bell, theme=options.theme, fps=options.fps).code
    finally:
        station.stop()
