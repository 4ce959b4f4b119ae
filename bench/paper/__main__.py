"""Command line of the published experiments: all conditions, two at a time; results as rows and tables."""

from __future__ import annotations

from bench.command_line import parser_of, write_rows
from bench.paper.experiments import Count, conditions, evaluate
from bench.paper.methods import times
from bench.paper.occlusion import Kept, play
from bench.paper.tables import write_tables
from bench.workers import one_threaded
from gcs.cli.output.progress import progress

FLIGHTS, QUICK_FLIGHTS, WINDOWS = 20, 1, 50
"""Flights with vehicles hidden at turns, and windows over which a time is taken."""


def main() -> None:
    few = "few noise levels, one flight each; under two minutes"
    options = parser_of("paper", "The published experiments", few).parse_args()
    plan, counts, kept = conditions(options.quick), list[Count](), list[Kept]()
    with progress("paper") as report, one_threaded() as pool:
        occluded = pool.map(play, range(1, 1 + (QUICK_FLIGHTS if options.quick else FLIGHTS)))
        for done, result in enumerate(pool.map(evaluate, plan), 1):
            counts += result
            report(done, len(plan))
        kept += [one for flight in occluded for one in flight]
    write_rows(options.out / "results.csv", Count, counts)
    write_rows(options.out / "occlusion.csv", Kept, kept)
    write_tables(options.out, counts, kept, times(WINDOWS), options.quick)
    print(f"{options.out}: {len(counts)} rows")


if __name__ == "__main__":
    main()
