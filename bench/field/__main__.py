"""Command line of the field suite."""

from __future__ import annotations

from bench.command_line import count, parser_of, print_results
from bench.field.explain import explain
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
    parser.add_argument("--seed", type=int, help="of the session to explain")
    parser.add_argument("--explain", action="store_true", help="list where the product was wrong in one session")
    options = parser.parse_args()
    if options.explain:
        if len(options.family) != 1 or options.seed is None:
            parser.error("--explain needs one --family and a --seed")
        print(explain(options.family[0], options.hard, options.seed))
        return
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
