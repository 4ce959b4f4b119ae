"""All flights of a batch as one Parquet file: records in, a row for each out, and back."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from gcs.batch.jobs import FlightRecord, ScoreRecord
from gcs.errors import BatchError
from gcs.export.tables.arrow import import_pyarrow, writer_settings

if TYPE_CHECKING:
    import pyarrow as pa

_SCORES = {name: f"score_{name}" for name in ScoreRecord.__struct_fields__}
COLUMNS = {
    "flight": "string",
    "status": "string",
    "error": "string",
    "source": "string",
    "version": "string",
    "versions": "string",
    "options": "string",
    "inputs": "string",
    "stamp": "string",
    "frames": "int64",
    "skipped_frames": "int64",
    "span_s": "double",
    "boxes": "int64",
    "unnamed": "int64",
    "vehicles": "int64",
    "named": "int64",
    "alarms": "int64",
    "warnings": "int64",
    "marks": "int64",
    **{column: "int64" if name == "switches" else "double" for name, column in _SCORES.items()},
    "earlier_result": "bool",
    "identity_bytes": "int64",
    "attempts": "int64",
    "seconds": "double",
    "cpu_seconds": "double",
    "peak_bytes": "int64",
    "worker": "string",
}
"""Columns with their Arrow types, and ``roll_call``, a list; null is unknown."""
_CALL = {
    "system_id": "int16",
    "name": "string",
    "first_named_s": "double",
    "boxes": "int64",
    "frames_in_view": "int64",
    "frames_unknown": "int64",
    "share": "double",
    "confidence": "double",
    "outcome": "string",
    "why": "string",
    "longest_silence_s": "double",
    "silence_frozen": "bool",
}


def flights_table(records: Sequence[FlightRecord]) -> bytes:
    """A Parquet file with a row for each flight, in order of their names.

    Raises:
        BatchError: pyarrow is not installed.
    """
    pyarrow = import_pyarrow()
    from pyarrow import parquet

    rows = [_row(record) for record in sorted(records, key=lambda record: record.flight)]
    table = pyarrow.Table.from_pylist(rows, schema=_schema(pyarrow))
    file = io.BytesIO()
    with parquet.ParquetWriter(file, table.schema, **writer_settings()) as writer:
        writer.write_table(table)
    return file.getvalue()


def read_flights(data: bytes, where: str) -> list[FlightRecord]:
    """The records of such a file.

    Raises:
        BatchError: pyarrow is not installed, or it is no such file.
    """
    pyarrow = import_pyarrow()
    from pyarrow import parquet

    try:
        rows = parquet.read_table(io.BytesIO(data)).to_pylist()
        return [_record(row) for row in rows]
    except (pyarrow.ArrowException, msgspec.ValidationError, LookupError, ValueError) as error:
        raise BatchError(f"{where}: is no table of flights: {error}") from error


def _schema(pyarrow: pa) -> pa.Schema:
    call = pyarrow.struct({name: pyarrow.type_for_alias(kind) for name, kind in _CALL.items()})
    types = {name: pyarrow.type_for_alias(kind) for name, kind in COLUMNS.items()}
    return pyarrow.schema({**types, "roll_call": pyarrow.list_(call)})


def _row(record: FlightRecord) -> dict[str, Any]:
    row: dict[str, Any] = msgspec.to_builtins(record)
    score = row.pop("score") or {}
    versions = json.dumps(row["versions"], sort_keys=True)
    return row | {"versions": versions} | {column: score.get(name) for name, column in _SCORES.items()}


def _record(row: dict[str, Any]) -> FlightRecord:
    scored = {name: row.pop(column, None) for name, column in _SCORES.items()}  # an earlier version has fewer
    score = None if scored["switches"] is None else scored
    return msgspec.convert(row | {"versions": json.loads(row["versions"]), "score": score}, FlightRecord)
