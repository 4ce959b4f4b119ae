"""Command line of the comparison with tags."""

from bench.apriltag.suite import WORKERS, run
from bench.command_line import count, parser_of, print_results
from gcs.cli.output.console import print_note
from gcs.cli.output.progress import progress


def main() -> None:
    parser = parser_of("apriltag", "Printed tags on roofs and the product against height", "three heights, one camera")
    parser.add_argument("--workers", type=count, default=WORKERS)
    options = parser.parse_args()
    with progress("apriltag") as report:
        text = run(options.out, options.quick, workers=options.workers, print_note=print_note, report=report)
    print_results(text, options.out / "apriltag.csv", as_json=options.json)


if __name__ == "__main__":
    main()
