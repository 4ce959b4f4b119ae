"""``gcs score``: how right an identity log is."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import AsJson, print_json, print_lines
from gcs.cli.output.tables import print_table
from gcs.errors import ScoreError
from gcs.report.score import Score, score_files


def score(
    truth: Annotated[Path, typer.Argument(help="Session folder with truth.csv, or a truth.csv.")],
    identity: Annotated[Path, typer.Argument(help="identity.csv to judge.")],
    as_json: AsJson = False,
) -> None:
    """Compare an identity log with the truth."""
    path = truth / "truth.csv" if truth.is_dir() else truth
    if not path.is_file():
        raise ScoreError(f"{path}: no such file; only simulated or annotated sessions have a truth to compare with")
    result = score_files(path, identity)
    if as_json:
        print_json(asdict(result))
    else:
        print_score(result)


def print_score(result: Score) -> None:
    """Print the figures to read, one a line."""
    rows = (
        ("precision", f"{result.precision:.2%}", "right names of names given"),
        ("coverage", f"{result.coverage:.2%}", "our boxes that got a name"),
        ("right", f"{result.right:.2%}", "our boxes that got the right name"),
        ("FPER", f"{result.fper:.2%}", f"of {result.false_targets} false targets, left unnamed"),
        ("switches", str(result.switches), "changes of a vehicle's name"),
        ("IDF1", f"{result.idf1:.2%}", f"of the names; {result.track_idf1:.2%} of the bare tracks"),
        ("ECE", f"{result.ece:.4f}", "expected calibration error of the confidence"),
        ("ECE of all", f"{result.ece_all:.4f}", "the same of all answers, none of ours among them"),
        ("wrong, sure", f"{result.wrong_sure_s:.1f} s", "vehicle-seconds wrong at confidence ≥ 0.9"),
        ("strangers", f"{result.false_strangers:.2%}", "of boxes called none of ours at confidence ≥ 0.9, ours"),
    )
    unlogged = f" ({result.frames_unlogged} without a box in the log)" if result.frames_unlogged else ""
    print_lines(f"{result.frames} frames{unlogged}, {result.ours} boxes of ours, {result.named} named")
    print_table(("figure", "value", "what it is"), rows, right=("value",), head=False)
    if result.skipped:
        print_lines(f"{result.skipped} rows could not be used")
