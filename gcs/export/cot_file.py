"""Cursor on Target in a file: one event a second for each vehicle and each stranger, an event on each line.

The lines stand between ``<events>`` and ``</events>``, so that the file is XML; each is an event as TAK takes it.
"""

from __future__ import annotations

from gcs.export.cot import XML_DECLARATION, CotPacer, cot_boxes, cot_event, cot_uid
from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot


class CotExport:
    """Export of Cursor-on-Target events, with the times of the flight."""

    def __init__(self, job: ExportJob) -> None:
        self._source = job.name
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path, XML_DECLARATION.decode() + "<events>\n")
        self._pacer = CotPacer()

    def write(self, snapshot: Snapshot) -> None:
        """Append the events that are due."""
        for box in cot_boxes(snapshot):
            if self._pacer.due(cot_uid(box, self._source), snapshot.t_us):
                self._file.write(cot_event(snapshot, box, source=self._source).decode() + "\n")

    def close(self) -> None:
        """Finish the file."""
        self._file.write("</events>\n")
        self._file.close()
        self._unfinished.finish()
