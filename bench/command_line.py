"""What benchmarks have in common on the command line."""

from __future__ import annotations

import argparse
from pathlib import Path

RESULTS = Path("bench-results")
"""In the working folder: what was measured and kept in bench/results is never written over."""


def parser_of(suite: str, description: str, quick: str) -> argparse.ArgumentParser:
    """A parser with ``--quick`` and ``--out``.

    Args:
        suite: name of the benchmark, and of its folder of results.
        description: what is measured.
        quick: what ``--quick`` leaves out.
    """
    parser = argparse.ArgumentParser(prog=f"python -m bench.{suite}", description=description)
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--out", type=Path, default=RESULTS / suite, help="folder of the results (%(default)s)")
    return parser


def count(text: str) -> int:
    """A whole number from 1 on, of an option."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("1 or more is needed")
    return number
