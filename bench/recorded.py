"""Recorded sessions with truth: what the product makes of each, as a table.

python -m bench.recorded FOLDER [FOLDER ...] [--out bench-results/recorded]

A folder is a session, or holds sessions; those without truth are passed over.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.command_line import RESULTS, count, write_page, write_rows
from bench.field.measure import summarise, tally
from bench.field.product import identify
from bench.field.tables import number
from bench.workers import one_threaded
from gcs.cli.output.console import print_note
from gcs.cli.output.progress import progress
from infra.markdown import markdown_table


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionScore:
    """Score of the product on one session; shares in percent, NaN where there is nothing to take a share of."""

    session: str
    frames: int
    precision: float
    right: float
    fper: float
    wrong_sure_s: float
    """Vehicle-seconds with a wrong name at confidence 0.9 or more."""
    ece: float
    switches: int
    swaps: int
    """Times a track went over from one target to another."""
    tracks: int
    mismatch_s: float
    """Seconds to the alarm that video and telemetry do not match, inf never."""
    ms: float
    """Processor time of a frame, on average; of all that is done for it."""
    p95_ms: float


_SUMMARISED = ("precision", "right", "fper", "wrong_sure_s", "ece", "switches", "swaps")


def sessions_in(folders: Iterable[Path]) -> list[Path]:
    """Sessions with truth: those of the folders that are sessions, and those right below the others."""
    found = []
    for folder in folders:
        inside = [folder] if (folder / "truth.csv").exists() else sorted(p for p in folder.iterdir() if p.is_dir())
        found += [session for session in inside if (session / "truth.csv").exists()]
    return found


def measure(
    sessions: Sequence[Path],
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> list[SessionScore]:
    """Identify each session as ``gcs identify`` does, and score it.

    Args:
        sessions: folders with truth.
        workers: processes.
        report: called with the sessions that are done so far, and all there are.
    """
    rows = []
    with one_threaded(workers) as pool:
        for row in (pool.map if workers > 1 else map)(score_session, sessions):
            rows.append(row)
            report(len(rows), len(sessions))
    return rows


def score_session(session: Path) -> SessionScore:
    """The row of one session."""
    with tempfile.TemporaryDirectory(prefix="recorded-") as out:
        run = identify(session, Path(out) / "out")
    times_us = np.unique(run.matched.time_us[np.isfinite(run.matched.time_us)])
    counts = tally(run.matched, 1e6 / float(np.median(np.diff(times_us))))
    summary = summarise([counts])
    return SessionScore(
        session=session.name,
        frames=counts.frames,
        **{name: getattr(summary, name) for name in _SUMMARISED},
        tracks=len(np.unique(run.matched.track[run.matched.track > 0])),
        mismatch_s=run.mismatch_s,
        ms=float(run.cpu_ms.mean()),
        p95_ms=float(np.percentile(run.cpu_ms, 95)),
    )


def text_of(rows: Sequence[SessionScore]) -> str:
    """The table in Markdown."""
    names = ("precision", "right", "FPER", "wrong ≥ 0.9, s", "ECE", "switches", "swaps", "tracks", "alarm after s")
    table = markdown_table(("session", *names, "ms, mean / p95"), [[row.session, *_cells(row)] for row in rows])
    return f"# Recorded sessions\n\n{_WORDS}\n\n{table}\n"


_WORDS = """\
Shares in percent of all boxes; words as in the field suite. alarm: that video and telemetry do not match. Milliseconds
are processor time of one thread for everything that is done for a frame."""


def _cells(row: SessionScore) -> list[str]:
    alarm = "–" if math.isinf(row.mismatch_s) else number(row.mismatch_s, 1)
    shares = [number(row.precision), number(row.right), number(row.fper)]
    counts = [str(row.switches), str(row.swaps), str(row.tracks)]
    times = f"{row.ms:.1f} / {row.p95_ms:.1f}"
    return [*shares, number(row.wrong_sure_s, 1), number(row.ece, 3), *counts, alarm, times]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.recorded", description="Recorded sessions with truth")
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="a session, or a folder of sessions")
    parser.add_argument("--workers", type=count, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS / "recorded", help="folder of the results (%(default)s)")
    options = parser.parse_args()
    with progress("recorded") as report:
        rows = measure(sessions_in(options.folders), options.workers, report)
    write_rows(options.out / "recorded.csv", SessionScore, rows)
    write_page(options.out / "recorded.md", text_of(rows))
    print_note(f"{len(rows)} sessions; wrote {options.out}")


if __name__ == "__main__":
    main()
