"""Command line of the field suite."""

from __future__ import annotations

import time

from bench.command_line import count, parser_of, write_page
from bench.field.families import FAMILIES
from bench.field.suite import play_all, tasks_of
from bench.field.tables import report, write_reliability, write_sessions
from bench.workers import WORKERS
from gcs.cli.output.console import print_note
from gcs.cli.output.progress import progress


def main() -> None:
    """Play the suite; write ``field.md``, ``sessions.csv`` and ``reliability.csv`` into a folder."""
    parser = parser_of("field", "Simulated flights by kind of trouble", "one short session of each family and version")
    parser.add_argument("--seeds", choices=("tune", "report"), default="report")
    parser.add_argument("--family", type=int, action="append", default=[], choices=tuple(FAMILIES), help="repeatable")
    parser.add_argument("--hard", action="store_true", help="the hard version only")
    parser.add_argument("--standard", action="store_true", help="the standard version only")
    parser.add_argument("--workers", type=count, default=WORKERS)
    options = parser.parse_args()
    versions = [hard for hard, asked in ((False, options.standard), (True, options.hard)) if asked] or [False, True]
    tasks = tasks_of(split=options.seeds, quick=options.quick, families=options.family, versions=versions)
    began = time.monotonic()
    with progress("field") as show:
        outcomes = play_all(tasks, options.workers, show)
    title = f"{'quick look, ' if options.quick else ''}{'reporting' if options.seeds == 'report' else 'tuning'} seeds"
    write_page(options.out / "field.md", report(outcomes, title))
    write_sessions(outcomes, options.out / "sessions.csv")
    write_reliability(outcomes, options.out / "reliability.csv")
    print_note(f"{len(outcomes)} sessions in {time.monotonic() - began:.0f} s; wrote {options.out}")


if __name__ == "__main__":
    main()
