"""Command line of the published experiments."""

from bench.command_line import parser_of, print_results
from bench.paper.suite import run
from gcs.cli.output.progress import progress


def main() -> None:
    parser = parser_of(
        "paper",
        "The published experiments: tables and figures",
        "few noise levels, one flight each; under two minutes",
    )
    options = parser.parse_args()
    with progress("paper") as report:
        text = run(options.out, options.quick, report)
    print_results(text, options.out / "results.csv", as_json=options.json)


if __name__ == "__main__":
    main()
