"""The identity log: one row for each box of each frame, named or not, as CSV and as JSON lines with the evidence.

Written row by row and flushed with every frame, so that a killed program leaves whole lines. Numbers are rounded when
written, not before: the same recording gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs.errors import SessionError
from gcs.session.box_table import box_values, csv_row, json_line
from gcs.session.line_file import Lines, open_new
from gcs.session.tables import Table, read_table
from gcs.snapshot import Snapshot
from infra.session_format import IDENTITY, IDENTITY_EVIDENCE


class IdentityLog:
    """Writes ``identity.csv`` and ``identity.jsonl`` into a folder.

    Args:
        folder: where to.
        open_file: makes a file from path and header; a flight's outlives a failing disk (``gcs.session.line_file``).
    """

    def __init__(self, folder: Path, open_file: Callable[[Path, str], Lines] = open_new) -> None:
        self._csv = open_file(folder / IDENTITY.name, IDENTITY.header)
        try:
            self._jsonl = open_file(folder / IDENTITY_EVIDENCE, "")
        except SessionError:
            self._csv.close()
            raise

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in this frame; coasting ones were not seen."""
        rows = [box_values(snapshot, box) for box in snapshot.new_boxes if not box.coasting]
        self._csv.write("".join(csv_row(row) + "\n" for row in rows))
        self._jsonl.write("".join(json_line(row) + "\n" for row in rows))
        self._csv.flush()
        self._jsonl.flush()

    def close(self) -> None:
        """Close both files."""
        self._csv.close()
        self._jsonl.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_identity(path: Path) -> Table:
    """Read an identity log; ``system_id`` and ``track_id`` are NaN where unknown."""
    return read_table(path, IDENTITY)
