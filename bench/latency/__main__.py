"""Command line of the latencies."""

import os
import platform

from bench.command_line import parser_of, print_results
from bench.workers import ONE_THREAD
from gcs.cli.output.progress import progress


def main() -> None:
    parser = parser_of("latency", "Each association method beside its literal peer", "few calls, small sizes")
    options = parser.parse_args()
    # one thread of linear algebra, decided before numpy is loaded
    os.environ.update(ONE_THREAD)
    from bench.latency.report import measure

    with progress("latency") as report:
        text = measure(options.out, options.quick, platform.processor() or platform.machine(), report)
    print_results(text, options.out / "latency.csv", as_json=options.json)


if __name__ == "__main__":
    main()
