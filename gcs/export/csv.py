"""One row for each box of each frame, flat, with names and places: for spreadsheets and data frames."""

from __future__ import annotations

import csv
import math
from datetime import UTC, datetime

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.missing import may_be
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import to_cell

COLUMNS = (
    *("time_utc", "frame", "track_id", "system_id", "name", "confidence", "runner_up", "runner_up_confidence"),
    *("cx_px", "cy_px", "w_px", "h_px", "angle_deg", "heading_deg"),
    *("lat_deg", "lon_deg", "east_m", "north_m", "place_std_m"),
    *("residual_m", "position_age_s", "stated", "may_be"),
)


class CsvExport:
    """Degrees and metres, empty cells for what is unknown."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path)
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(COLUMNS)

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame."""
        time = datetime.fromtimestamp(snapshot.t_us * 1e-6, UTC).isoformat(timespec="microseconds")
        for box in snapshot.new_boxes:
            if box.coasting:
                continue
            name = to_cell(snapshot.name_of(box.system_id)) if box.system_id else ""
            who = (box.track_id or "", box.system_id or "", name, _cell(box.confidence, 4))
            second = (box.runner_up or "", _cell(box.runner_up_confidence, 4))
            shape = [_cell(v, 2) for v in (box.cx, box.cy, box.w, box.h)]
            turn = [_cell(math.degrees(v), 2) for v in (box.angle, box.heading)]
            metres = (*box.p_enu[:2].tolist(), box.place_std_m)
            place = (_cell(box.lat_deg, 7), _cell(box.lon_deg, 7), *(_cell(v, 3) for v in metres))
            trust = (_cell(box.residual_m, 3), _cell(box.position_age_s, 3))
            doubt = (int(box.stated), to_cell(may_be(snapshot, box)))
            self._rows.writerow((time, snapshot.frame, *who, *second, *shape, *turn, *place, *trust, *doubt))

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
        self._unfinished.finish()


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""
