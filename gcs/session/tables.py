"""Number tables in CSV, as a session keeps them: the one bad row is counted and skipped, the rest is used.

A table may come from anywhere: each column has a range, and reading takes no more memory than some times the file.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from infra.files.safe_open import open_to_read
from infra.files.segment import segments
from infra.session_format import TableFormat
from infra.text_numbers import number

MAX_ROW_CHARS = 4096
"""Our rows have less than 200."""
MAX_BOXES = 1000
"""Maximum boxes of one frame: fifty times a large fleet; comparing boxes takes the square of their number in memory."""
_LATEST_US = 4_102_444_800_000_000  # the year 2100
_MAX_RECORDS = 1 << 40
_MAX_FRAMES = (1 << 31) - 1
_MAX_PX = 1 << 14
_FAR, _FAR_RAD = 1e6, 1e3
_AROUND = ' \t\r\n"\ufeff'
"""Characters around numbers that other programs write: quotation marks, and a byte order mark before the first."""


@dataclass(frozen=True, slots=True)
class _Range:
    """Range that a column's numbers can have."""

    least: float
    most: float
    whole: bool = False


_RANGES: Mapping[str, _Range] = {
    "frame": _Range(0, _MAX_FRAMES, whole=True),
    "camera": _Range(0, 511, whole=True),  # those on masts come after the 255 of MAVLink
    "of_frame": _Range(0, _MAX_FRAMES, whole=True),
    "record": _Range(0, _MAX_RECORDS, whole=True),
    "time_us": _Range(0, _LATEST_US, whole=True),
    "t_us": _Range(0, _LATEST_US, whole=True),
    "heard_us": _Range(0, _LATEST_US, whole=True),
    "record_us": _Range(0, _LATEST_US, whole=True),
    "records": _Range(0, _MAX_RECORDS, whole=True),
    "count": _Range(0, _MAX_RECORDS, whole=True),
    "boxes": _Range(0, MAX_BOXES, whole=True),
    "width": _Range(1, _MAX_PX, whole=True),
    "height": _Range(1, _MAX_PX, whole=True),
    "step_us": _Range(-_LATEST_US, _LATEST_US, whole=True),
    "auth": _Range(0, 255, whole=True),
    "system_id": _Range(0, 255, whole=True),
    "track_id": _Range(0, _MAX_RECORDS, whole=True),
    "cx": _Range(-_FAR, _FAR),
    "cy": _Range(-_FAR, _FAR),
    "w": _Range(0, _FAR),
    "h": _Range(0, _FAR),
    "angle": _Range(-_FAR_RAD, _FAR_RAD),
    "heading": _Range(-_FAR_RAD, _FAR_RAD),
    "score": _Range(0, _FAR),
    "confidence": _Range(0, 1),
    **{name: _Range(-_FAR, _FAR) for name in ("h11", "h12", "h13", "h21", "h22", "h23", "h31", "h32")},
    "std_px": _Range(0, _MAX_PX),
    "inliers": _Range(0, _MAX_RECORDS, whole=True),
    "share": _Range(0, 1),
    "lat": _Range(-90, 90),
    "lon": _Range(-180, 180),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Columns of equal length."""

    columns: dict[str, NDArray[np.float64]]
    """Columns by name, (rows,) each; an empty cell is NaN."""
    skipped: int
    """Rows that could not be used."""

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def read_table(path: Path, form: TableFormat, *, without: Collection[str] = ()) -> Table:
    """Read the columns of a CSV table with a header line; columns that it should not have are left alone.

    Where the disk failed, ``path`` has further segments: they are read as one, and rows that a failed sync had written
    again count once.

    A row counts as bad when a required cell is empty or no number, an optional one is neither empty nor a number, when
    a number is none that its column can hold, or when its frame has a thousand boxes already.

    Raises:
        SessionError: no such file, no header, or a required column is missing.
    """
    names = [name for name in form.columns if name not in without]
    required = [name for name in names if name not in form.optional]
    optional = [name for name in names if name in form.optional]
    first, *rest = segments(path) or [path]
    table = _read_file(first, required, optional)
    for later in rest:
        table = _joined(table, _read_file(later, required, optional))
    return table


def _read_file(path: Path, required: Sequence[str], optional: Sequence[str]) -> Table:
    """One segment of a table."""
    try:
        with os.fdopen(open_to_read(path), encoding="utf-8", errors="replace") as file:
            header = [name.strip(_AROUND) for name in file.readline(MAX_ROW_CHARS).split(",")]
            missing = [name for name in required if name not in header]
            if missing:
                raise SessionError(
                    f"{path}: column {missing[0]!r} is missing; the first line must name {','.join(required)}"
                )
            wanted = [*required, *(name for name in optional if name in header)]
            places = [header.index(name) for name in wanted]
            rows, skipped = _numbers(_rows(file), places, len(required))
    except FileNotFoundError:
        raise SessionError(f"{path}: no such file") from None
    except OSError as error:
        raise SessionError(f"{path}: cannot be read: {error}") from error
    array = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
    usable = np.ones(len(rows), dtype=np.bool_)
    for name, column in zip(wanted, array.T, strict=True):
        usable &= _possible(name, column)
    if "frame" in wanted and "cx" in wanted:
        usable[usable] = _not_crowded(array[usable, wanted.index("frame")])
    array = array[usable]
    columns = {name: array[:, k] for k, name in enumerate(wanted)}
    columns |= {name: np.full(len(array), np.nan) for name in optional if name not in columns}
    return Table(columns=columns, skipped=skipped + len(rows) - len(array))


def _joined(table: Table, later: Table) -> Table:
    names = list(table.columns)
    ours = np.column_stack([table[name] for name in names])
    theirs = np.column_stack([later[name] for name in names])
    again = {row.tobytes() for row in theirs}
    whole = np.concatenate([ours[[row.tobytes() not in again for row in ours]], theirs])
    return Table(columns={name: whole[:, k] for k, name in enumerate(names)}, skipped=table.skipped + later.skipped)


def _rows(file: TextIO) -> Iterator[list[str]]:
    """Cells of each line; of a line too long to be a row, none."""
    pieces = iter(partial(file.readline, MAX_ROW_CHARS), "")
    for line in pieces:
        whole = line.endswith("\n") or len(line) < MAX_ROW_CHARS
        if whole and line.strip():
            yield line.split(",")
        elif not whole:
            while line and not line.endswith("\n"):
                line = next(pieces, "")
            yield []


def _value(cell: str) -> float:
    """A number; NaN where nothing is known, which numpy and pandas write as a word."""
    return np.nan if cell.lower() in ("", "nan") else number(cell)


def _numbers(rows: Iterator[list[str]], places: Sequence[int], needed: int) -> tuple[list[list[float]], int]:
    numbers: list[list[float]] = []
    skipped = 0
    for cells in rows:
        try:
            values = [_value(cells[k].strip(_AROUND)) for k in places]
        except (ValueError, IndexError):
            skipped += 1
            continue
        if np.isnan(values[:needed]).any():
            skipped += 1
            continue
        numbers.append(values)
    return numbers, skipped


def _possible(name: str, column: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(rows,) whether a column can hold these numbers; an unknown one can."""
    wanted = _RANGES.get(name, _Range(-np.inf, np.inf))
    inside = (column >= wanted.least) & (column <= wanted.most)
    if wanted.whole:
        inside &= column == np.floor(column)
    return np.asarray(inside | np.isnan(column), dtype=np.bool_)


def _not_crowded(frame: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(rows,) which rows are among the first thousand of their frame."""
    order = np.argsort(frame, kind="stable")
    new = np.diff(frame[order], prepend=-1.0) != 0
    first = np.maximum.accumulate(np.where(new, np.arange(len(frame)), 0))
    few = np.empty(len(frame), dtype=np.bool_)
    few[order] = np.arange(len(frame)) - first < MAX_BOXES
    return few
