"""``gcs demo``: the bundled recording from pixels to names, or a simulated flight over real links."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.fly import fly
from gcs.cli.identify import identify_into
from gcs.cli.output.console import NO_NAMES, AsJson, print_json, print_lines
from gcs.cli.replay import show_replay
from gcs.cli.results.score import print_score
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.cli.screen_options import screen_options
from gcs.errors import SessionError
from gcs.report.score import score_files
from gcs.session.session import open_session

BUNDLED = Path(__file__).parents[2] / "sitl_logs" / "curved-road"
FLOWN_S, HEADLESS_S, LISTEN_S = 180, 40.0, 60.0
"""Seconds that the simulated fleet drives, is watched without a terminal, and may take to begin."""


def demo(
    live: Annotated[
        bool, typer.Option("--live", help="Fly instead: a simulated fleet over real MAVLink and streamed video.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Replay the bundled recording; without a terminal, name its vehicles and print the score."""
    if live:
        screen = not as_json and sys.stdout.isatty() and sys.stdin.isatty()
        with _simulated_fleet() as (link, video, practise):
            fly(
                link=[link],
                video=[video],
                headless=not screen,
                duration=None if screen else HEADLESS_S,
                listen_s=LISTEN_S,
                practise=practise,
                as_json=as_json,
            )
        return
    if not BUNDLED.is_dir():
        raise SessionError(f"{BUNDLED}: the bundled recording is not here; run the demo from a wheel or a checkout")
    session = open_session(BUNDLED)
    if not as_json and sys.stdout.isatty() and sys.stdin.isatty():
        raise SystemExit(show_replay(session, screen_options(None), detect=True))
    with tempfile.TemporaryDirectory() as folder:
        calls = identify_into(session, Path(folder), detect=True)
        score = score_files(BUNDLED / "truth.csv", Path(folder) / "identity.csv")
    if as_json:
        print_json({"identify": rollcall_json(calls), "score": asdict(score)})
    else:
        print_rollcall(calls)
        print_lines("")
        print_score(score)
    if not calls.named:
        raise SystemExit(NO_NAMES)


@contextlib.contextmanager
def _simulated_fleet() -> Iterator[tuple[str, str, int]]:
    """A fleet and its film, sent by a process of its own: link, address of the video, and port that takes troubles."""
    telemetry, video, practise = (_free_port() for _ in range(3))
    words = ["sim", "run", "curved-road", "--live", "--duration", str(FLOWN_S), "--practise", str(practise)]
    addresses = ["--telemetry", f"udpout:127.0.0.1:{telemetry}", "--stream", f"udp://127.0.0.1:{video}?pkt_size=1316"]
    program = [sys.executable, "-P", "-c", "from gcs.cli.start import main; main()"]
    with subprocess.Popen(
        [*program, *words, *addresses],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as fleet:
        try:
            yield f"udpin:127.0.0.1:{telemetry}", f"udp://127.0.0.1:{video}", practise
        finally:
            fleet.terminate()


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
