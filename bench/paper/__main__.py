"""Command line of the published experiments: all conditions, two at a time; results as rows and tables."""

from __future__ import annotations

from bench.command_line import parser_of, print_results
from bench.paper.experiments import Count, conditions, evaluate
from bench.paper.tables import write_tables
from bench.rows import write
from bench.workers import one_threaded
from gcs.cli.output.progress import progress


def main() -> None:
    few = "few noise levels, one flight each; under two minutes"
    options = parser_of("paper", "The published experiments", few).parse_args()
    plan, counts = conditions(options.quick), list[Count]()
    with progress("paper") as report, one_threaded() as pool:
        for done, result in enumerate(pool.map(evaluate, plan), 1):
            counts += result
            report(done, len(plan))
    options.out.mkdir(parents=True, exist_ok=True)
    write(options.out / "results.csv", Count, counts)
    write_tables(options.out, counts, options.quick)
    print_results(f"{options.out}: {len(counts)} rows", options.out / "results.csv", as_json=options.json)


if __name__ == "__main__":
    main()
