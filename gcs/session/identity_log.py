"""The identity log: one row for each box of each frame, named or not, as CSV and as JSON lines with the evidence.

Written row by row and flushed with every frame, so that a killed program leaves whole lines. Numbers are rounded when
written, not before: the same recording gives the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from gcs.errors import SessionError
from gcs.missing import may_be
from gcs.session.line_file import Lines, open_new
from gcs.session.tables import Table, read_table
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain
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
        boxes = [box for box in snapshot.new_boxes if not box.coasting]
        self._csv.write("".join(csv_row(snapshot, box) + "\n" for box in boxes))
        self._jsonl.write("".join(json_row(snapshot, box) + "\n" for box in boxes))
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


def csv_row(snapshot: Snapshot, box: Box) -> str:
    """One line of ``identity.csv``; empty cells are unknown."""
    cells = [
        str(snapshot.t_us),
        str(snapshot.frame),
        str(box.track_id) if box.track_id else "",
        str(box.system_id) if box.system_id else "",
        _text(box.confidence, 4),
        *(_text(v, 2) for v in (box.cx, box.cy, box.w, box.h)),
        _text(box.angle, 4),
        _text(box.heading, 4),
        _text(box.lat_deg, 7),
        _text(box.lon_deg, 7),
    ]
    return ",".join(cells)


def json_row(snapshot: Snapshot, box: Box) -> str:
    """One line of ``identity.jsonl``: the same box with the evidence; null is unknown."""
    row = {
        "time_us": snapshot.t_us,
        "frame": snapshot.frame,
        "track_id": box.track_id or None,
        "system_id": box.system_id or None,
        "name": plain(snapshot.name_of(box.system_id)) if box.system_id else None,
        "confidence": _number(box.confidence, 4),
        "runner_up": box.runner_up or None,
        "runner_up_confidence": _number(box.runner_up_confidence, 4),
        "margin": _number(box.margin, 4),
        "projection": _number(box.projection, 4),
        "topology": _number(box.topology, 4),
        "fused": _number(box.fused, 4),
        "residual_m": _number(box.residual_m, 3),
        "residual_px": _number(box.residual_px, 2),
        "position_age_s": _number(box.position_age_s, 3),
        "box": [_number(v, 4) for v in (box.cx, box.cy, box.w, box.h, box.angle)],
        "heading": _number(box.heading, 4),
        "enu_m": [_number(v, 2) for v in box.p_enu.tolist()],
        "place_std_m": _number(box.place_std_m, 3),
        "lat": _number(box.lat_deg, 7),
        "lon": _number(box.lon_deg, 7),
    }
    # rows of recordings without these stay as they were
    row |= {"number": box.number} if box.number else {}
    row |= {"stated": True} if box.stated else {}
    row |= {"doubt": box.doubt} if box.doubt else {}
    row |= {"may_be": words} if (words := plain(may_be(snapshot, box))) else {}
    return msgspec.json.encode(row).decode()


def _number(value: float, digits: int) -> float:
    """Rounded, never −0; NaN and infinity are null in JSON."""
    return round(value, digits) + 0.0


def _text(value: float, digits: int) -> str:
    return f"{value:z.{digits}f}" if math.isfinite(value) else ""


def read_identity(path: Path) -> Table:
    """Read an identity log; ``system_id`` and ``track_id`` are NaN where unknown."""
    return read_table(path, IDENTITY)
