"""The table of boxes as Parquet: rows of ``identity.jsonl`` in, the same numbers in columns out.

The same rows give the same bytes: nothing of the clock, the machine or the flight's name is in the file, and the
writer's settings are fixed. pyarrow is an extra (``tables``), and imported when a table is written.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from gcs.export.job import ExportJob
from gcs.export.tables.arrow import import_pyarrow, writer_settings
from gcs.export.unfinished import Unfinished
from gcs.session.box_table import COLUMNS, VERSION, EvidenceRow, column_values, json_row
from gcs.snapshot import Snapshot

ROWS = 65_536
"""Rows of one group: what is held in memory at once."""


class IdentityTable:
    """A table while it is written.

    Args:
        path: of the file; what is there is replaced.
        about: what the file tells of itself beside the version of its columns, such as that of the program.

    Raises:
        GcsError: pyarrow is not installed.
    """

    def __init__(self, path: str, about: Mapping[str, str]) -> None:
        self._pyarrow = import_pyarrow()
        from pyarrow import parquet

        types = {name: self._pyarrow.type_for_alias(column.kind) for name, column in COLUMNS.items()}
        entries = {"rollcall.boxes": str(VERSION), **about}
        self._schema = self._pyarrow.schema(types, metadata=dict(sorted(entries.items())))
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
        batch = self._pyarrow.RecordBatch.from_pydict(values, schema=self._schema)
        self._writer.write_batch(batch, row_group_size=ROWS)
        self._rows = []


class ParquetExport:
    """Export to Parquet: the same table as a batch's, with null for what is unknown.

    Raises:
        GcsError: pyarrow is not installed.
    """

    def __init__(self, job: ExportJob) -> None:
        import_pyarrow()
        self._unfinished = Unfinished(job.path)
        self._table = IdentityTable(str(self._unfinished.path), {})

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        for box in snapshot.new_boxes:
            if not box.coasting:
                self._table.add(json_row(snapshot, box))

    def close(self) -> None:
        """Finish the file."""
        self._table.close()
        self._unfinished.finish()
