"""Rows of flat dataclasses as CSV, and back."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, TypeVar

Row = TypeVar("Row")
_CASTS: dict[str, Callable[[str], object]] = {"int": int, "float": float, "str": str, "bool": "True".__eq__}


def write(path: Path, kind: type[Any], rows: Sequence[Any]) -> None:
    """Write rows of one dataclass; numbers with six digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f.name for f in fields(kind)])
        for row in rows:
            writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in astuple(row)])


def read(path: Path, kind: type[Row]) -> list[Row]:
    """Read what :func:`write` wrote."""
    names = {f.name: _CASTS[str(f.type)] for f in fields(kind)}  # type: ignore[arg-type]
    with path.open(newline="", encoding="utf-8") as file:
        return [kind(**{name: names[name](value) for name, value in row.items()}) for row in csv.DictReader(file)]
