"""Number tables in CSV, as a session keeps them: the one bad row is counted and skipped, the rest is used."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from mavlink.files import open_to_read

__all__ = ["Table", "read_table"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Columns of equal length."""

    columns: dict[str, NDArray[np.float64]]
    """By name, (rows,) each; an empty cell is NaN."""
    skipped: int
    """Rows that could not be read."""

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def read_table(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> Table:
    """Read the named columns of a CSV file with a header line; other columns are left alone.

    A row counts as bad when a required cell is empty or no number, or an optional one is neither empty nor a number.

    Raises:
        SessionError: no such file, no header, or a required column is missing.
    """
    try:
        with os.fdopen(open_to_read(path), encoding="utf-8", errors="replace", newline="") as lines:
            reader = csv.reader(lines)
            header = [name.strip() for name in next(reader, [])]
            missing = [name for name in required if name not in header]
            if missing:
                raise SessionError(
                    f"{path}: column {missing[0]!r} is missing; the first line must name {','.join(required)}"
                )
            wanted = [*required, *(name for name in optional if name in header)]
            places = [header.index(name) for name in wanted]
            rows, skipped = _numbers(reader, places, len(required))
    except FileNotFoundError:
        raise SessionError(f"{path}: no such file") from None
    except (OSError, csv.Error) as error:
        raise SessionError(f"{path}: cannot be read: {error}") from error
    array = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
    columns = {name: array[:, k] for k, name in enumerate(wanted)}
    columns |= {name: np.full(len(rows), np.nan) for name in optional if name not in columns}
    return Table(columns=columns, skipped=skipped)


def _numbers(lines: Iterator[list[str]], places: Sequence[int], needed: int) -> tuple[list[list[float]], int]:
    rows: list[list[float]] = []
    skipped = 0
    for cells in lines:
        if not cells:
            continue
        try:
            values = [float(cells[k]) if cells[k].strip() else np.nan for k in places]
        except (ValueError, IndexError):
            skipped += 1
            continue
        if not np.isfinite(values[:needed]).all():
            skipped += 1
            continue
        rows.append(values)
    return rows, skipped
