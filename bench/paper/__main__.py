"""``python -m bench.paper [--quick] [--out bench-results/paper]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.paper.suite import RESULTS, run


def main() -> None:
    """Run the experiments."""
    parser = argparse.ArgumentParser(description="The published experiments: tables and figures.")
    parser.add_argument("--quick", action="store_true", help="few noise levels, one flight each; under two minutes")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args()
    run(options.out, options.quick)


if __name__ == "__main__":
    main()
