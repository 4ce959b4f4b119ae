"""The table of boxes: one row for each box of each frame; its columns, their types and digits have this one place.

What keeps named boxes has these columns in this order, and differs in encoding alone: the exports ``csv``, ``jsonl``
and ``parquet``, a batch's tables, ``NamedBoxes`` and ``identity.jsonl``. In JSON the box and its place are lists, and
the last four are left out where there is nothing to say. ``identity.csv`` has those that tell who is where, and its box
in hundredths of a pixel. What the columns mean: ``docs/python.md``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import msgspec

from gcs.missing import may_be
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain
from infra.session_format import IDENTITY

VERSION = 1
"""Version of the columns, raised when one is renamed or goes. The exports and a batch's tables state it; files of a
session are of the version of its program, which ``session.toml`` states."""
BOX, ENU = ("cx", "cy", "w", "h", "angle"), ("east_m", "north_m", "up_m")
"""Columns that are one list in JSON: ``box`` and ``enu_m``."""
_WITH_EVIDENCE = ("number", "stated", "doubt", "may_be")
"""Columns that JSON leaves out where there is nothing to say."""


@dataclass(frozen=True, slots=True)
class BoxColumn:
    """One column."""

    kind: str
    """Arrow type of the column."""
    digits: int = 0
    """Decimal places that are kept of a ``double``."""


_ID, _COUNT, _WORDS, _SHARE = BoxColumn("int16"), BoxColumn("int64"), BoxColumn("string"), BoxColumn("double", 4)
_PIXELS, _RADIANS, _DEGREES = BoxColumn("double", 4), BoxColumn("double", 4), BoxColumn("double", 7)
_CENTIMETRES, _MILLIMETRES, _SECONDS = BoxColumn("double", 2), BoxColumn("double", 3), BoxColumn("double", 3)

COLUMNS = {
    **dict.fromkeys(("time_us", "frame", "track_id"), _COUNT),
    "system_id": _ID,
    "name": _WORDS,
    "confidence": _SHARE,
    "runner_up": _ID,
    **dict.fromkeys(("runner_up_confidence", "margin", "projection", "topology", "fused"), _SHARE),
    "residual_m": _MILLIMETRES,
    "residual_px": BoxColumn("double", 2),
    "position_age_s": _SECONDS,
    **dict.fromkeys(BOX[:4], _PIXELS),
    **dict.fromkeys(("angle", "heading"), _RADIANS),
    **dict.fromkeys(ENU, _CENTIMETRES),
    **dict.fromkeys(("lat", "lon"), _DEGREES),
    "place_std_m": _MILLIMETRES,
    "number": _COUNT,
    "stated": BoxColumn("bool"),
    **dict.fromkeys(("doubt", "may_be"), _WORDS),
}
"""The columns in their order."""
OPTIONAL = frozenset(COLUMNS) - {"time_us", "frame", "stated"}
"""Columns whose values can be unknown."""


def box_values(snapshot: Snapshot, box: Box) -> dict[str, Any]:
    """Values of a row by column, whole; NaN and None are unknown, and of ``_WITH_EVIDENCE`` what is empty."""
    east_m, north_m, up_m = box.p_enu.tolist()
    return {
        "time_us": snapshot.t_us,
        "frame": snapshot.frame,
        "track_id": box.track_id or None,
        "system_id": box.system_id or None,
        "name": plain(snapshot.name_of(box.system_id)) if box.system_id else None,
        "confidence": box.confidence,
        "runner_up": box.runner_up or None,
        "runner_up_confidence": box.runner_up_confidence,
        "margin": box.margin,
        "projection": box.projection,
        "topology": box.topology,
        "fused": box.fused,
        "residual_m": box.residual_m,
        "residual_px": box.residual_px,
        "position_age_s": box.position_age_s,
        "cx": box.cx,
        "cy": box.cy,
        "w": box.w,
        "h": box.h,
        "angle": box.angle,
        "heading": box.heading,
        "east_m": east_m,
        "north_m": north_m,
        "up_m": up_m,
        "lat": box.lat_deg,
        "lon": box.lon_deg,
        "place_std_m": box.place_std_m,
        "number": box.number or None,
        "stated": box.stated,
        "doubt": box.doubt or None,
        "may_be": plain(may_be(snapshot, box)) or None,
    }


def text_cell(value: Any, digits: int | None) -> str:  # noqa: ANN401 - what a column holds
    """A value as a cell of text, a number that is no count with this many decimal places; empty is unknown."""
    if digits is not None:
        return f"{value:z.{digits}f}" if math.isfinite(value) else ""
    return "" if value is None else str(int(value)) if value is True or value is False else str(value)


def csv_row(values: dict[str, Any]) -> str:
    """One line of ``identity.csv``."""
    return ",".join([text_cell(values[name], digits) for name, digits in _CSV])


def json_row(snapshot: Snapshot, box: Box) -> str:
    """One line of ``identity.jsonl``; null is unknown."""
    return json_line(box_values(snapshot, box))


def json_line(values: dict[str, Any]) -> str:
    """The values of a row as one line of ``identity.jsonl``; numbers are never −0, and NaN and infinity are null."""
    row = {name: values[name] for name in _BEFORE_BOX}
    for name, digits in _FRACTIONS:
        row[name] = round(values[name], digits) + 0.0
    row["box"] = [round(values[name], digits) + 0.0 for name, digits in _BOX]
    row["heading"] = round(values["heading"], COLUMNS["heading"].digits) + 0.0
    row["enu_m"] = [round(values[name], digits) + 0.0 for name, digits in _ENU]
    for name, digits in _AFTER_ENU:
        row[name] = round(values[name], digits) + 0.0
    for name in _WITH_EVIDENCE:
        if values[name]:
            row[name] = values[name]
    return msgspec.json.encode(row).decode()


def _digits(*names: str) -> list[tuple[str, int]]:
    return [(name, COLUMNS[name].digits) for name in names]


DIGITS = {name: column.digits if column.kind == "double" else None for name, column in COLUMNS.items()}
"""Decimal places by column, None for what is no fraction."""
_BEFORE_BOX = tuple(takewhile(lambda name: name != BOX[0], COLUMNS))
_FRACTIONS = _digits(*(name for name in _BEFORE_BOX if DIGITS[name]))
_BOX, _ENU, _AFTER_ENU = _digits(*BOX), _digits(*ENU), _digits("place_std_m", "lat", "lon")
_CSV = [(name, 2 if name in BOX[:4] else DIGITS[name]) for name in IDENTITY.columns]


class EvidenceRow(msgspec.Struct, frozen=True):
    """Row of the evidence as JSON has it."""

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
    number: int | None = None
    stated: bool = False
    doubt: str | None = None
    may_be: str | None = None


def column_values(rows: Sequence[EvidenceRow]) -> dict[str, list[Any]]:
    """Values by column; None is unknown."""
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS if name not in (*BOX, *ENU)}
    columns |= {name: [row.box[k] for row in rows] for k, name in enumerate(BOX)}
    columns |= {name: [row.enu_m[k] for row in rows] for k, name in enumerate(ENU)}
    return {name: columns[name] for name in COLUMNS}
