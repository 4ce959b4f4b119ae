"""ArduPilot's dataflash logs as tables, one for each type of record that is wanted: ``.bin``, and ``.log`` as text.

A record is A3 95, one byte for its type, and fields of fixed size; FMT records (type 128) describe the others. They are
looked for again after damage. As text it is a line with commas, its numbers already in the units that FMT describes.
Layout: https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html.
pymavlink reads them too, but its reader changes the process's environment and does not end on a type of length 0.
"""

from __future__ import annotations

import math
import mmap
import re
from array import array
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.formats.text_file import LOOKED_AT, open_file, text_lines
from infra.clock_steps import restarts
from infra.text_numbers import number_or_nan

_HEAD = b"\xa3\x95"
_FMT, _FMT_BYTES = 128, 89
_FIRST_FORMAT = re.compile(rb"(?:^|[\r\n])FMT, *\d+, *\d+, *\w+, *\w+, *\w")
_TYPES = {
    **{"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8", "q": "<i8"},
    **{"Q": "<u8", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1", "g": "<f2"},
    **{"n": "S4", "N": "S16", "Z": "S64", "a": "S64"},
}
_SCALES = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_WHOLE = frozenset(("TimeUS", "GMS", "GWk", "Status", "I", "C", "PI"))
"""Columns of whole numbers; all others but names are numbers of any kind. What is of another kind is not there."""
_NAMES = frozenset(("Name",))
_MAX_RECORDS = 2_000_000
"""Maximum records of one type: eleven hours at 50 a second."""
_BEYOND = "records beyond what is kept"
_MAX_COLUMNS = 64
_LARGEST = float(1 << 62)
_NEAR, _FAR = 256, 1 << 20
"""Bytes that are searched at once, little by little more."""
_BACK_US = 1_000_000
_BEFORE_2015 = {"TimeMS": "TimeUS", "RelAlt": "RelHomeAlt"}
_GPS_BEFORE_2015 = {"TimeMS": "GMS", "Week": "GWk", "T": "TimeUS"}
"""Names then and now; milliseconds since boot become microseconds."""
_TYPES_BEFORE_2015 = {"EKF1": "NKF1"}


@dataclass(frozen=True, slots=True)
class _RecordLayout:
    """Layout of a type by FMT."""

    name: str
    size: int
    scales: tuple[float, ...]
    """Scales of each field, 1 for those that are as they should be."""
    dtype: np.dtype[np.void]


@dataclass(frozen=True, slots=True, kw_only=True)
class DataflashTables:
    """Records by the name of their type, in the order of the file, in the units that they are described in."""

    tables: dict[str, NDArray[np.void]]
    what: str
    """Description of what was read."""
    left_out: dict[str, int]
    """Counts of what belongs to no record, and of records beyond what is kept of a type, by reason."""

    def rows(self, name: str, *columns: str) -> NDArray[np.void] | None:
        """Records of a type, None where there are none or a column is missing."""
        table = self.tables.get(name)
        if table is None or not len(table) or not set(columns) <= set(table.dtype.names or ()):
            return None
        return table


def read_tables(path: Path, wanted: Collection[str]) -> DataflashTables:
    """The wanted records of a log.

    Raises:
        ImportFileError: it cannot be read, has no format in it, or more than one start of the vehicle.
    """
    with open_file(path) as file:
        if _is_text(file.read(LOOKED_AT)):
            return _text_tables(path, wanted)
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _binary_tables(path, data, wanted)


def is_dataflash(head: bytes) -> bool:
    """Tell whether a file begins as a log, binary or as text."""
    return head.startswith(_HEAD) or _is_text(head)


def _is_text(head: bytes) -> bool:
    """Perhaps behind lines of the program that wrote it."""
    return _HEAD not in head and _FIRST_FORMAT.search(head) is not None


def _binary_tables(path: Path, data: mmap.mmap, wanted: Collection[str]) -> DataflashTables:
    layouts: dict[int, _RecordLayout] = {}
    starts: dict[int, array[int]] = {}
    begun: list[int] = []
    at, size, damaged, beyond = 0, len(data), 0, 0
    while 0 <= at < size - 3:
        kind = data[at + 2] if data[at : at + 2] == _HEAD else -1
        length = _FMT_BYTES if kind == _FMT else layouts[kind].size if kind in layouts else 0
        if not length or at + length > size:
            after = _next_head(data, at + 1)
            damaged += (after if after >= 0 else size) - at
            at = after
            continue
        if kind == _FMT:
            if data[at + 3] == _FMT:
                begun.append(at)
            _add_layout(layouts, data[at + 3 : at + length])
        elif layouts[kind].name in wanted:
            kept = starts.setdefault(kind, array("Q"))
            if len(kept) < _MAX_RECORDS:
                kept.append(at)
            else:
                beyond += 1
        at += length
    if not layouts:
        raise ImportFileError(f"{path}: not a dataflash log: no format of a record in it")
    tables = {layouts[kind].name: _table(data, rows, layouts[kind]) for kind, rows in starts.items()}
    _check_one_start(path, tables, {layouts[kind].name: rows for kind, rows in starts.items()}, begun, "byte")
    left_out = {"damaged bytes": damaged, _BEYOND: beyond}
    return DataflashTables(tables=tables, what="dataflash", left_out={why: n for why, n in left_out.items() if n})


class _TextRows:
    """Records of one type as they are read from text."""

    def __init__(self, kind: str, columns: list[str]) -> None:
        self._old = columns
        self._names = _names_today(kind, columns)
        self._values = array("d")
        self._words: list[bytes] = []
        self.lines = array("Q")
        """Line of each, from 1."""

    def take(self, cells: list[str], line: int) -> bool:
        """Keep a record; False for what is none."""
        numbers = [
            math.nan if name in _NAMES else _number(cell) for name, cell in zip(self._names, cells, strict=False)
        ]
        if len(cells) != len(self._names) or not all(
            number.is_integer() for name, number in zip(self._names, numbers, strict=True) if name in _WHOLE
        ):
            return False
        self._values.extend(numbers)
        self._words += [cells[k].encode()[:16] for k, name in enumerate(self._names) if name in _NAMES]
        self.lines.append(line)
        return True

    def table(self) -> NDArray[np.void]:
        """Table like that of a binary log."""
        kinds = ["S16" if name in _NAMES else "<i8" if name in _WHOLE else "<f8" for name in self._names]
        table = np.zeros(len(self.lines), list(zip(self._names, kinds, strict=True)))
        numbers = np.array(self._values).reshape(len(self.lines), -1)
        for k, (name, was) in enumerate(zip(self._names, self._old, strict=True)):
            scale = 1000.0 if name == "TimeUS" and was != name else 1.0
            table[name] = self._words if name in _NAMES else numbers[:, k] * scale
        return table


def _number(cell: str) -> float:
    """A number that a column can have, NaN for words."""
    value = number_or_nan(cell)
    return value if abs(value) < _LARGEST else math.nan


def _text_tables(path: Path, wanted: Collection[str]) -> DataflashTables:
    rows: dict[str, _TextRows] = {}
    begun: list[int] = []
    damaged = beyond = 0
    for line_number, line in enumerate(text_lines(path), 1):
        word, _, rest = line.partition(",")
        kind = _TYPES_BEFORE_2015.get(word, word)
        if kind != "FMT" and kind not in wanted:
            # in front of the first format a program may have written what it is
            damaged += bool(rows and line.strip() and kind not in rows)
            continue
        cells = [cell.strip() for cell in rest.split(",")]
        if kind == "FMT":
            name, columns = ("", []) if len(cells) < 5 else (cells[2], cells[4:])
            begun += [line_number] if name == "FMT" else []
            if all(columns) and len(set(columns)) == len(columns) <= _MAX_COLUMNS:
                rows.setdefault(_TYPES_BEFORE_2015.get(name, name), _TextRows(name, columns))
        elif kind in rows and len(rows[kind].lines) >= _MAX_RECORDS:
            beyond += 1
        else:
            damaged += kind not in rows or not rows[kind].take(cells, line_number)
    rows = {kind: each for kind, each in rows.items() if len(each.lines)}
    tables = {kind: each.table() for kind, each in rows.items()}
    _check_one_start(path, tables, {kind: each.lines for kind, each in rows.items()}, begun, "line")
    left_out = {"damaged lines": damaged, _BEYOND: beyond}
    return DataflashTables(
        tables=tables, what="dataflash as text", left_out={why: n for why, n in left_out.items() if n}
    )


def _next_head(data: mmap.mmap, at: int) -> int:
    """Offset of what may be the next record, -1 nowhere. ``mmap.find`` reads past whole pages before CPython 3.11.5."""
    size = _NEAR
    while at < len(data):
        found = data[at : at + size].find(_HEAD)
        if found >= 0:
            return at + found
        at, size = at + size - 1, min(2 * size, _FAR)
    return -1


def _check_one_start(
    path: Path,
    tables: dict[str, NDArray[np.void]],
    starts: dict[str, array[int]],
    begun: list[int],
    unit: Literal["byte", "line"],
) -> None:
    """See that the vehicle was started once: times since two starts would lie over each other.

    Args:
        starts: where they begin.
        begun: where the format of formats stands, which is the first record of a log.
        unit: of places in the file: bytes from 0, lines from 1.

    Raises:
        ImportFileError: it was started again.
    """
    again = [
        starts[name][row]
        for name, table in tables.items()
        if "TimeUS" in (table.dtype.names or ())
        for row in restarts(np.minimum(table["TimeUS"], 1 << 62).astype(np.int64), _BACK_US)[:1]
    ]
    if again or len(begun) > 1:
        # the formats of a log stand in front of its first times
        at = begun[1] if len(begun) > 1 else min(again)
        head = f"head -c {at}" if unit == "byte" else f"head -n {at - 1}"
        raise ImportFileError(
            f"{path}: two logs in one file: the vehicle was started again at {unit} {at}; cut it there, as with "
            f"{head}, and give the flight that was filmed"
        )


def _names_today(kind: str, columns: list[str]) -> list[str]:
    """Names of a type's columns as they are called since 2015."""
    if "TimeUS" in columns:
        return columns
    then = _GPS_BEFORE_2015 if kind == "GPS" and "Week" in columns else _BEFORE_2015
    return [then.get(column, column) for column in columns]


def _add_layout(layouts: dict[int, _RecordLayout], body: bytes) -> None:
    """Take in a FMT record; one that cannot be is left out."""
    kind, size = body[0], body[1]
    name, chars, columns = (
        part.split(b"\0")[0].decode("ascii", "replace") for part in (body[2:6], body[6:22], body[22:86])
    )
    old = columns.split(",")
    names = _names_today(name, old)
    name = _TYPES_BEFORE_2015.get(name, name)
    known = chars and all(char in _TYPES for char in chars)
    if kind in layouts or kind == _FMT or not known or len(chars) != len(names) or len(set(names)) != len(names):
        return
    if not all(names):
        return
    dtype = np.dtype([(column, _TYPES[char]) for column, char in zip(names, chars, strict=True)])
    if dtype.itemsize == size - 3:
        in_ms = [column == "TimeUS" and column != was for column, was in zip(names, old, strict=True)]
        scales = [1000.0 if ms else _SCALES.get(char, 1.0) for ms, char in zip(in_ms, chars, strict=True)]
        layouts[kind] = _RecordLayout(name, size, tuple(scales), dtype)


def _table(data: mmap.mmap, starts: array[int], layout: _RecordLayout) -> NDArray[np.void]:
    begin, end = len(_HEAD) + 1, len(_HEAD) + 1 + layout.dtype.itemsize
    raw = np.frombuffer(b"".join(data[start + begin : start + end] for start in starts), layout.dtype)
    columns = [
        (name, layout.dtype[name], scale)
        for name, scale in zip(layout.dtype.names or (), layout.scales, strict=True)
        if layout.dtype[name].kind in ("S" if name in _NAMES else "iu" if name in _WHOLE else "iuf")
    ]
    table = np.empty(len(raw), [(name, kind if scale == 1.0 else np.dtype("f8")) for name, kind, scale in columns])
    for name, _, scale in columns:
        table[name] = raw[name] if scale == 1.0 else raw[name] * scale
    return table
