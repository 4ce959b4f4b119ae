"""``gcs demo``: the bundled recording, from pixels to names."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from gcs.cli.identify import identify_into
from gcs.cli.output.console import NO_NAMES, AsJson, print_json, print_lines
from gcs.cli.replay import show_replay
from gcs.cli.results.score import print_score
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.errors import SessionError
from gcs.report.score import score_files
from gcs.session.session import open_session

__all__ = ["demo"]

BUNDLED = Path(__file__).parents[2] / "sitl_logs" / "curved-road"


def demo(as_json: AsJson = False) -> None:
    """Replay the bundled recording; without a terminal, name its vehicles and print the score."""
    if not BUNDLED.is_dir():
        raise SessionError(f"{BUNDLED}: the bundled recording is not here; run the demo from a wheel or a checkout")
    session = open_session(BUNDLED)
    if not as_json and sys.stdout.isatty() and sys.stdin.isatty():
        raise SystemExit(show_replay(session, detect=True))
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
