"""One row for each box of each frame in text: for spreadsheets and data frames; its last column is the version."""

from __future__ import annotations

import csv
from typing import Any

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.box_table import COLUMNS, VERSION, box_values, text_cell
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import to_cell


class CsvExport:
    """Empty cells for what is unknown."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path)
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow((*COLUMNS, "schema"))

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        for box in snapshot.new_boxes:
            if not box.coasting:
                values = box_values(snapshot, box)
                self._rows.writerow((*(_cell(name, values[name]) for name in COLUMNS), VERSION))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
        self._unfinished.finish()


def _cell(name: str, value: Any) -> str:  # noqa: ANN401 - what a column holds
    """A cell that no spreadsheet takes for a formula."""
    text = text_cell(name, value)
    return to_cell(text) if COLUMNS[name].kind == "string" else text
