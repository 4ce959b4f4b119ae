"""``python -m bench.latency [--quick] [--out bench-results/latency]``."""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path

RESULTS = Path("bench-results/latency")


def main() -> None:
    """Time everything, print the table and keep it."""
    parser = argparse.ArgumentParser(description="Each association method beside its literal peer.")
    parser.add_argument("--quick", action="store_true", help="few calls, small sizes")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args()
    # one thread of linear algebra, decided before numpy is loaded
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    from bench.latency.report import measure

    print(measure(options.out, options.quick, platform.processor() or platform.machine()))


if __name__ == "__main__":
    main()
