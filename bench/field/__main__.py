"""Command line of the field suite."""

from __future__ import annotations

from bench.command_line import count, parser_of, print_results
from bench.field.families import FAMILIES
from bench.field.suite import run
from bench.workers import WORKERS
from gcs.cli.output.console import print_note
from gcs.cli.output.progress import progress


def main() -> None:
    parser = parser_of("field", "Simulated flights by kind of trouble", "one short session of each family and version")
    parser.add_argument("--seeds", choices=("tune", "report"), default="report")
    parser.add_argument("--family", type=int, action="append", default=[], choices=tuple(FAMILIES), help="repeatable")
    parser.add_argument("--hard", action="store_true", help="the hard version only")
    parser.add_argument("--standard", action="store_true", help="the standard version only")
    parser.add_argument("--workers", type=count, default=WORKERS)
    options = parser.parse_args()
    versions = [hard for hard, asked in ((False, options.standard), (True, options.hard)) if asked] or [False, True]
    with progress("field") as report:
        text = run(
            options.out,
            options.quick,
            split=options.seeds,
            families=options.family,
            versions=versions,
            workers=options.workers,
            print_note=print_note,
            report=report,
        )
    print_results(text, options.out / "sessions.csv", as_json=options.json)


if __name__ == "__main__":
    main()
