"""What benchmarks have in common on the command line."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any

from gcs.cli.output.console import print_json

RESULTS = Path("bench-results")
"""In the working folder: what was measured and kept in bench/results is never written over."""


def parser_of(suite: str, description: str, quick: str) -> argparse.ArgumentParser:
    """A parser with ``--quick``, ``--out`` and ``--json``.

    Args:
        suite: name of the benchmark, and of its folder of results.
        description: what is measured.
        quick: what ``--quick`` leaves out.
    """
    parser = argparse.ArgumentParser(prog=f"python -m bench.{suite}", description=description)
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--out", type=Path, default=RESULTS / suite, help="folder of the results (%(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    return parser


def count(text: str) -> int:
    """A whole number from 1 on, of an option."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("1 or more is needed")
    return number


def print_results(text: str, rows: Path, *, as_json: bool) -> None:
    """Print the tables, or the rows that they are made of.

    Args:
        text: the tables in Markdown.
        rows: CSV file.
        as_json: ``{"folder": ..., "rows": [{...}, ...]}`` on one line, cells of numbers as numbers.
    """
    if not as_json:
        print(text)
        return
    with rows.open(newline="", encoding="utf-8") as file:
        found = [{name: _cell(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
    print_json({"folder": str(rows.parent), "rows": found})


def _cell(text: str) -> Any:  # noqa: ANN401  (a number or words)
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return text or None
