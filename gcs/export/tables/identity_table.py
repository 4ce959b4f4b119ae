"""The boxes of one flight as Parquet: rows of ``identity.jsonl`` in, the same numbers in columns out.

The same rows give the same bytes: nothing of the clock, the machine or the flight's name is in the file, and the
writer's settings are fixed. pyarrow is an extra (``tables``), and imported when a table is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from gcs.export.tables.arrow import import_pyarrow, writer_settings

ROWS = 65_536
"""Rows of one group: what is held in memory at once."""
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
    "doubt": "string",
    "may_be": "string",
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
    doubt: str | None = None
    may_be: str | None = None


class IdentityTable:
    """A table while it is written.

    Args:
        path: of the file; what is there is replaced.
        about: what the file tells of itself, such as the version of the program.

    Raises:
        GcsError: pyarrow is not installed.
    """

    def __init__(self, path: str, about: Mapping[str, str]) -> None:
        self._pyarrow = import_pyarrow()
        from pyarrow import parquet

        types = {name: self._pyarrow.type_for_alias(kind) for name, kind in COLUMNS.items()}
        self._schema = self._pyarrow.schema(types, metadata=dict(sorted(about.items())))
        self._writer = parquet.ParquetWriter(path, self._schema, **writer_settings())
        self._decode = msgspec.json.Decoder(EvidenceRow).decode
        self._rows: list[EvidenceRow] = []

    def add(self, line: bytes | str) -> None:
        """Append a line of ``identity.jsonl``.

        Raises:
            msgspec.DecodeError: it is none.
        """
        self._rows.append(self._decode(line))
        if len(self._rows) == ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left and the file's end."""
        if self._rows:
            self._write()
        self._writer.close()

    def _write(self) -> None:
        values = column_values(self._rows)
        batch = self._pyarrow.RecordBatch.from_pydict({name: values[name] for name in COLUMNS}, schema=self._schema)
        self._writer.write_batch(batch, row_group_size=ROWS)
        self._rows = []


def column_values(rows: list[EvidenceRow]) -> dict[str, list[Any]]:
    """Values by column; None is unknown."""
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS if name not in (*_BOX, *_ENU)}
    columns |= {name: [row.box[k] for row in rows] for k, name in enumerate(_BOX)}
    return columns | {name: [row.enu_m[k] for row in rows] for k, name in enumerate(_ENU)}
