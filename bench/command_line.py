"""Command lines of the benchmarks, and the tables and pages that they write."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

RESULTS = Path("bench-results")
"""Folder of results, in the working folder: what was measured and kept in bench/results is never written over."""


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


def write_table(path: Path, head: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table as CSV; floats with six digits. Its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)


def write_rows(path: Path, kind: type[Any], rows: Iterable[Any]) -> None:
    """Write rows of one flat dataclass as CSV."""
    write_table(path, [f.name for f in fields(kind)], map(astuple, rows))


def write_page(path: Path, text: str) -> None:
    """Write a page and print it. Its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    print(text)
