"""One JSON object for each box of each frame, with the evidence; the first line describes the file."""

from __future__ import annotations

import json

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.box_table import VERSION, json_row
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot

HEADER = {
    "format": "rollcall identity",
    "version": VERSION,
    "time": "Unix microseconds",
    "box": "cx cy w h px, angle rad: image +x to the width axis, clockwise on screen",
    "heading": "rad clockwise from image up",
    "enu_m": "east north up of the box on the ground",
    "datum": "WGS-84 degrees",
}


class JsonlExport:
    """null is unknown."""

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
