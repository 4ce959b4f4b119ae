"""The boxes of one flight as numpy columns: lines of ``identity.jsonl`` in, the same numbers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs.errors import GcsError
from gcs.export.tables.arrow import import_pyarrow
from gcs.session.box_table import COLUMNS, OPTIONAL, EvidenceRow, column_values

_TYPES: Mapping[str, tuple[type, object]] = {
    "int64": (np.int64, 0),
    "int16": (np.int16, 0),
    "double": (np.float64, np.nan),
    "string": (np.object_, ""),
    "bool": (np.bool_, False),
}
"""numpy type and unknown value of each Arrow type."""


class NamedBoxes(Mapping[str, NDArray[Any]]):
    """A row for each box of each frame, in order of time: ``boxes["system_id"]`` is a column, (rows,).

    Columns are those of ``identity.parquet`` (``docs/python.md``): metres, radians, pixels, Unix microseconds. Unknown
    numbers are NaN, unknown ids 0, unknown words empty.

    Attributes:
        notes: What a reader should know before the names are trusted, one line each.
    """

    def __init__(self, columns: Mapping[str, NDArray[Any]], notes: tuple[str, ...] = ()) -> None:
        self._columns, self.notes = dict(columns), notes

    @classmethod
    def of_lines(cls, lines: Iterable[bytes], notes: tuple[str, ...] = ()) -> NamedBoxes:
        """The table of the lines of ``identity.jsonl``.

        Raises:
            msgspec.DecodeError: a line is none of it.
        """
        decode = msgspec.json.Decoder(EvidenceRow).decode
        values = column_values([decode(line) for line in lines])
        return cls({name: _column(column.kind, values[name]) for name, column in COLUMNS.items()}, notes)

    @property
    def rows(self) -> int:
        """Number of boxes, named or not."""
        return len(self._columns["time_us"])

    def where(self, chosen: NDArray[Any]) -> NamedBoxes:
        """The rows of a mask or of indices: ``boxes.where(boxes["system_id"] == 11)``."""
        return NamedBoxes({name: column[chosen] for name, column in self._columns.items()}, self.notes)

    def to_pandas(self) -> Any:  # noqa: ANN401 - pandas is not required
        """A ``pandas.DataFrame`` with the same columns.

        Raises:
            GcsError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise GcsError("to_pandas needs pandas: pip install pandas") from None
        return pd.DataFrame(self._columns)

    def to_arrow(self) -> Any:  # noqa: ANN401 - pyarrow is not required
        """A ``pyarrow.Table`` with the same columns; null is unknown.

        Raises:
            GcsError: pyarrow is not installed.
        """
        pyarrow = import_pyarrow()
        arrays = {}
        for name, column in COLUMNS.items():
            values, unknown = self._columns[name], _TYPES[column.kind][1]
            missing = values != values if column.kind == "double" else values == unknown  # NaN differs from itself
            mask = missing & (name in OPTIONAL)
            arrays[name] = pyarrow.array(values, type=pyarrow.type_for_alias(column.kind), mask=mask)
        return pyarrow.table(arrays)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        named = int(np.count_nonzero(self._columns["system_id"]))
        return f"<NamedBoxes: {self.rows} boxes, {named} named; {len(self.notes)} notes>"


def _column(kind: str, values: list[Any]) -> NDArray[Any]:
    dtype, unknown = _TYPES[kind]
    return np.array([unknown if value is None else value for value in values], dtype=dtype)
