"""What the benchmarks' figures have in common: matplotlib when it is there, and the table that is drawn."""

from __future__ import annotations

import csv
import importlib
from pathlib import Path
from typing import Any

MISSING = "no figure: matplotlib is not installed; pip install 'rollcall-gcs[bench]' and run again, or draw the csv"


def pyplot() -> Any | None:  # noqa: ANN401  (a library without types)
    """matplotlib.pyplot, drawing into files; None when it is not installed."""
    try:
        importlib.import_module("matplotlib").use("Agg")
        return importlib.import_module("matplotlib.pyplot")
    except ImportError:
        return None


def read_rows(table: Path) -> list[dict[str, str]]:
    """The rows of a csv file."""
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
