"""One row for each box of each frame with the evidence, in columns: the table that a batch writes of each flight."""

from __future__ import annotations

import pyarrow  # noqa: F401 - a format without its library is told when it is asked for

from gcs.export.job import ExportJob
from gcs.export.tables.identity_table import IdentityTable
from gcs.export.unfinished import Unfinished
from gcs.session.box_table import json_row
from gcs.snapshot import Snapshot


class ParquetExport:
    """null is unknown."""

    def __init__(self, job: ExportJob) -> None:
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
