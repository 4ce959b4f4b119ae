"""All flights of a batch as one Parquet file: records in, a row for each out, and back."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, get_args

import msgspec

from gcs.batch.jobs import FlightRecord, ScoreRecord, VehicleCall
from gcs.errors import BatchError
from gcs.export.tables.arrow import import_pyarrow, writer_settings

if TYPE_CHECKING:
    import pyarrow as pa

_SCORES = {name: f"score_{name}" for name in ScoreRecord.__struct_fields__}
_ARROW = {str: "string", int: "int64", float: "double", bool: "bool", dict[str, str]: "string"}


def _columns(record: type[msgspec.Struct]) -> dict[str, str]:
    """Arrow types of a record's fields but lists, a column each; a score's fields are columns in its place."""
    columns: dict[str, str] = {}
    for field in msgspec.structs.fields(record):
        kind = get_args(field.type)[0] if type(None) in get_args(field.type) else field.type
        if kind is ScoreRecord:
            columns |= {_SCORES[name]: arrow for name, arrow in _columns(kind).items()}
        elif kind in _ARROW:
            columns[field.name] = _ARROW[kind]
    return columns


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
    """Columns with their Arrow types, and ``roll_call``, a list; null is unknown."""
    flight, call = (
        {name: pyarrow.type_for_alias(kind) for name, kind in columns.items()}
        for columns in (_columns(FlightRecord), _columns(VehicleCall) | {"system_id": "int16"})
    )
    return pyarrow.schema({**flight, "roll_call": pyarrow.list_(pyarrow.struct(call))})


def _row(record: FlightRecord) -> dict[str, Any]:
    row: dict[str, Any] = msgspec.to_builtins(record)
    score = row.pop("score") or {}
    versions = json.dumps(row["versions"], sort_keys=True)
    return row | {"versions": versions} | {column: score.get(name) for name, column in _SCORES.items()}


def _record(row: dict[str, Any]) -> FlightRecord:
    scored = {name: row.pop(column, None) for name, column in _SCORES.items()}  # an earlier version has fewer
    score = None if scored["switches"] is None else scored
    return msgspec.convert(row | {"versions": json.loads(row["versions"]), "score": score}, FlightRecord)
