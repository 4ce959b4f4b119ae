"""The table of boxes as text, for spreadsheets, data frames and jq: rows of cells, or one JSON object a row."""

from __future__ import annotations

import csv
import json
from typing import Any

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.box_table import COLUMNS, DIGITS, VERSION, box_values, json_row, text_cell
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import to_cell

HEADER = {
    "format": "rollcall identity",
    "version": VERSION,
    "time": "Unix microseconds",
    "box": "cx cy w h px, angle rad: image +x to the width axis, clockwise on screen",
    "heading": "rad clockwise from image up",
    "enu_m": "east north up of the box on the ground",
    "datum": "WGS-84 degrees",
}
"""Description of the file, the first line of ``jsonl``."""


class CsvExport:
    """Export to CSV: a row for each box of each frame, empty where nothing is known; the last column is the version."""

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


class JsonlExport:
    """Export to JSON lines: an object for each box of each frame, with null for what is unknown."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path)
        self._file.write(json.dumps(HEADER) + "\n")

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        self._file.write("".join(json_row(snapshot, box) + "\n" for box in snapshot.new_boxes if not box.coasting))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
        self._unfinished.finish()


def _cell(name: str, value: Any) -> str:  # noqa: ANN401 - what a column holds
    """A cell that no spreadsheet takes for a formula."""
    text = text_cell(value, DIGITS[name])
    return to_cell(text) if COLUMNS[name].kind == "string" else text
