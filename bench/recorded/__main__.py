"""Command line of the table of recorded sessions."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.command_line import RESULTS, count
from bench.paper.rows import read, write
from bench.recorded.table import SessionScore, measure, sessions_in, text_of
from gcs.cli.output.console import print_note
from gcs.cli.output.progress import progress


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.recorded", description="Recorded sessions with truth")
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="a session, or a folder of sessions")
    parser.add_argument("--before", type=Path, help="recorded.csv of an earlier run, to be shown beside this one")
    parser.add_argument("--workers", type=count, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS / "recorded", help="folder of the results (%(default)s)")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with progress("recorded") as report:
        rows = measure(sessions_in(options.folders), options.workers, report)
    before = read(options.before, SessionScore) if options.before else []
    text = text_of(rows, before)
    write(options.out / "recorded.csv", SessionScore, rows)
    (options.out / "recorded.md").write_text(text, encoding="utf-8")
    print(text)
    print_note(f"{len(rows)} sessions; wrote {options.out}")


if __name__ == "__main__":
    main()
