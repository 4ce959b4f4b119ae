"""The boxes of one flight as Parquet: ``identity.jsonl`` in, the same numbers in columns out.

The same rows give the same bytes: nothing of the clock, the machine or the flight's name is in the file, and the
writer's settings are fixed. pyarrow is an extra (``batch``), and imported when a table is written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from gcs.batch.parquet import import_pyarrow, writer_settings
from gcs.errors import BatchError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["COLUMNS", "write_identity_table"]

ROWS = 65_536
"""Of one group: what is held in memory at once."""
COLUMNS = {
    "time_us": "int64",
    "frame": "int64",
    "track_id": "int64",
    "system_id": "int16",
    "name": "string",
    "confidence": "double",
    "runner_up": "int16",
    "runner_up_confidence": "double",
    "margin": "double",
    "projection": "double",
    "topology": "double",
    "fused": "double",
    "residual_m": "double",
    "residual_px": "double",
    "position_age_s": "double",
    "cx": "double",
    "cy": "double",
    "w": "double",
    "h": "double",
    "angle": "double",
    "heading": "double",
    "east_m": "double",
    "north_m": "double",
    "up_m": "double",
    "lat": "double",
    "lon": "double",
    "place_std_m": "double",
    "stated": "bool",
}
"""Columns with their Arrow types; null is unknown."""
_BOX, _ENU = ("cx", "cy", "w", "h", "angle"), ("east_m", "north_m", "up_m")


class EvidenceRow(msgspec.Struct, frozen=True):
    """A row of ``identity.jsonl``, as ``gcs.session.identity_log.json_row`` writes it."""

    time_us: int
    frame: int
    track_id: int | None
    system_id: int | None
    name: str | None
    confidence: float | None
    runner_up: int | None
    runner_up_confidence: float | None
    margin: float | None
    projection: float | None
    topology: float | None
    fused: float | None
    residual_m: float | None
    residual_px: float | None
    position_age_s: float | None
    box: tuple[float | None, float | None, float | None, float | None, float | None]
    heading: float | None
    enu_m: tuple[float | None, float | None, float | None]
    lat: float | None
    lon: float | None
    place_std_m: float | None = None
    stated: bool = False


def write_identity_table(evidence: Path, path: Path, about: Mapping[str, str]) -> None:
    """Write a flight's boxes as a Parquet file.

    Args:
        evidence: an ``identity.jsonl``.
        path: of the file, which is replaced.
        about: what the file tells of itself, such as the version of the program.

    Raises:
        BatchError: pyarrow is not installed, or the evidence is none.
    """
    pyarrow = import_pyarrow()
    from pyarrow import parquet

    types = {name: pyarrow.type_for_alias(kind) for name, kind in COLUMNS.items()}
    schema = pyarrow.schema(types, metadata=dict(sorted(about.items())))
    with parquet.ParquetWriter(str(path), schema, **writer_settings()) as writer:
        for rows in _groups(evidence):
            writer.write_batch(_columns(pyarrow, schema, rows), row_group_size=ROWS)


def _groups(evidence: Path) -> Iterator[list[EvidenceRow]]:
    decode = msgspec.json.Decoder(EvidenceRow).decode
    rows: list[EvidenceRow] = []
    with evidence.open("rb") as lines:
        for line in lines:
            try:
                rows.append(decode(line))
            except msgspec.DecodeError as error:
                raise BatchError(f"{evidence}: {error}") from error
            if len(rows) == ROWS:
                yield rows
                rows = []
    if rows:
        yield rows


def _columns(pyarrow: pa, schema: pa.Schema, rows: list[EvidenceRow]) -> pa.RecordBatch:
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS if name not in (*_BOX, *_ENU)}
    columns |= {name: [row.box[k] for row in rows] for k, name in enumerate(_BOX)}
    columns |= {name: [row.enu_m[k] for row in rows] for k, name in enumerate(_ENU)}
    return pyarrow.RecordBatch.from_pydict({name: columns[name] for name in COLUMNS}, schema=schema)
