"""Anybody's tables: one row a moment, columns by name, commas, semicolons or tabs between them.

Columns, of which only a time and the two coordinates are needed; other columns are left alone, units are in the names:

    time      time_us | time_s | time (ISO 8601, or Unix seconds), elapsed_s since the video's first frame, or frame
    place     lat, lon in degrees; alt_m above sea level, height_m above the take-off; std_m (1σ, level)
    motion    vn_mps, ve_mps, vd_mps, or speed_mps with course_deg; heading_deg of the nose
    attitude  roll_deg, pitch_deg, yaw_deg of the UAV's body
    camera    gimbal_roll_deg, gimbal_pitch_deg from the horizon, gimbal_yaw_deg from north; hfov_deg
    who       system_id
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.formats.text_file import text_lines
from gcs.importing.vehicle_log import (
    AngleTrack,
    ImportNotes,
    LogClock,
    PlaceTrack,
    VehicleLog,
    ViewTrack,
    in_order,
    whole_places,
)

__all__ = ["read_csv"]

Floats = NDArray[np.float64]

_ALIASES = {
    "latitude": "lat", "lat_deg": "lat", "latitude_deg": "lat",
    "longitude": "lon", "lng": "lon", "lon_deg": "lon", "longitude_deg": "lon", "longtitude": "lon",
    "altitude": "alt_m", "alt": "alt_m", "altitude_m": "alt_m", "abs_alt": "alt_m", "ele": "alt_m",
    "height": "height_m", "rel_alt": "height_m", "relative_alt_m": "height_m",
    "timestamp": "time", "utc": "time", "datetime": "time", "t_us": "time_us", "unix_us": "time_us",
    "unix_s": "time_s", "t_s": "elapsed_s", "elapsed": "elapsed_s",
    "yaw": "yaw_deg", "pitch": "pitch_deg", "roll": "roll_deg", "heading": "heading_deg",
    "gimbal_yaw": "gimbal_yaw_deg", "gimbal_pitch": "gimbal_pitch_deg", "gimbal_roll": "gimbal_roll_deg",
    "h_acc": "std_m", "h_acc_m": "std_m", "sysid": "system_id", "id": "system_id",
}  # fmt: skip
"""What else columns are called."""
_KNOWN = frozenset(_ALIASES.values()) | {"frame", "speed_mps", "course_deg", "hfov_deg", "vn_mps", "ve_mps", "vd_mps"}
_TIMES: tuple[tuple[str, LogClock, float], ...] = (
    ("time_us", "utc", 1.0),
    ("time_s", "utc", 1e6),
    ("time", "utc", 1e6),
    ("elapsed_s", "video", 1e6),
    ("frame", "frame", 1.0),
)
"""Columns of times, best first, with their clock and µs."""
_UNIX_FROM_S = 1e8
"""Seconds below this, three years, do not count from 1970."""
_LATEST_US = 4_102_444_800_000_000  # the year 2100
_MOST_ROWS = 2_000_000
_MOST_COLUMNS = 400
_AROUND = " \t\r\n\"'"


def read_csv(path: Path) -> list[VehicleLog]:
    """The vehicles in a table, by system id; one with id 0 for a table without.

    Raises:
        ImportFileError: it cannot be read, a column is missing, or no row can be used.
    """
    lines = text_lines(path)
    header = next(lines, "")
    between = max(",;\t", key=header.count)
    names = [_column(cell) for cell in header.split(between)[:_MOST_COLUMNS]]
    time, clock, unit_us = _time_column(names, path)
    missing = [name for name in ("lat", "lon") if name not in names]
    if missing:
        raise ImportFileError(f"{path}: column {missing[0]} is missing; the first line must name the columns")
    columns = [name for name in dict.fromkeys(names) if name in _KNOWN]
    skipped: Counter[str] = Counter()
    rows = _rows(path, lines, between, [names.index(name) for name in columns], columns.index(time), skipped)
    table = np.fromiter(rows, np.dtype((np.float64, len(columns))))
    if not len(table):
        raise ImportFileError(f"{path}: no row in it that can be used; {', '.join(names[:8])} were expected as numbers")
    by_name = dict(zip(columns, table.T, strict=True))
    t_us, clock = _microseconds(by_name[time], clock, unit_us)
    good = whole_places(by_name["lat"], by_name["lon"]) & (t_us >= 0) & (t_us < _LATEST_US)
    skipped["rows without a place or time that can be"] += int(np.count_nonzero(~good))
    owner = by_name.get("system_id", np.zeros(len(table)))
    logs = []
    for system_id in np.unique(owner[good & (owner >= 0) & (owner <= 255) & (owner == np.floor(owner))]).tolist():
        mine = np.flatnonzero(good & (owner == system_id))
        mine = mine[in_order(t_us[mine].astype(np.int64))]
        part = {name: column[mine] for name, column in by_name.items()}
        logs.append(_log(path, int(system_id), t_us[mine].astype(np.int64), clock, part, +skipped))
    if not logs:
        raise ImportFileError(f"{path}: no row in it that can be used: places are degrees, system ids 1 to 255")
    return logs


def _column(cell: str) -> str:
    name = cell.strip(_AROUND + "\ufeff").lower().replace(" ", "_")
    return _ALIASES.get(name, name)


def _time_column(names: list[str], path: Path) -> tuple[str, LogClock, float]:
    for each in _TIMES:
        if each[0] in names:
            return each
    wanted = ", ".join(name for name, _, _ in _TIMES)
    raise ImportFileError(f"{path}: no column of times; the first line must name one of {wanted}")


def _rows(
    path: Path, lines: Iterator[str], between: str, places: list[int], time: int, skipped: Counter[str]
) -> Iterator[list[float]]:
    """Numbers of each row, NaN for cells that are empty or none."""
    count = 0
    for line in lines:
        if not line.strip():
            continue
        cells = line.split(between)
        row = [_number(cells[place], between) if place < len(cells) else math.nan for place in places]
        if math.isnan(row[time]) and places[time] < len(cells):
            row[time] = _iso_s(cells[places[time]].strip(_AROUND))
        count += 1
        if count > _MOST_ROWS:
            raise ImportFileError(f"{path}: more than {_MOST_ROWS} rows; cut it where the flight ends")
        if math.isfinite(row[time]):
            yield row
        else:
            skipped["rows without a time"] += 1


def _number(cell: str, between: str) -> float:
    text = cell.strip(_AROUND)
    try:
        value = float(text.replace(",", ".") if between != "," else text) if len(text) < 40 else math.nan
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _iso_s(text: str) -> float:
    """Unix seconds of a date, taken as UTC where it has no zone."""
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return math.nan
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _microseconds(times: Floats, clock: LogClock, unit_us: float) -> tuple[Floats, LogClock]:
    """Times in µs, and their clock: small numbers of seconds count from the video's first frame."""
    if clock == "utc" and unit_us > 1.0 and np.nanmedian(times) < _UNIX_FROM_S:
        clock = "video"
    return np.rint(np.clip(times * unit_us, -1.0, _LATEST_US)), clock


def _log(
    path: Path, system_id: int, t_us: NDArray[np.int64], clock: LogClock, part: dict[str, Floats], skipped: Counter[str]
) -> VehicleLog:
    def column(name: str) -> Floats:
        return part.get(name, np.full(len(t_us), np.nan))

    def angles(*names: str) -> Floats:
        found = np.radians(np.column_stack([column(name) for name in names]))
        found[np.abs(found) > 2.0 * np.pi] = np.nan
        return found

    body, gimbal = (
        angles("roll_deg", "pitch_deg", "yaw_deg"),
        angles("gimbal_roll_deg", "gimbal_pitch_deg", "gimbal_yaw_deg"),
    )
    if "gimbal_roll_deg" not in part:
        gimbal[:, 0] = np.where(np.isfinite(gimbal[:, 1]), 0.0, np.nan)
    whole, pitched = np.isfinite(body).all(axis=1), np.isfinite(gimbal[:, 1])
    hfov = np.radians(column("hfov_deg"))
    seen = (hfov > 0.0) & (hfov < np.pi)
    std_m = column("std_m")[column("std_m") > 0.0]
    words = [
        name
        for name, known in (("attitudes", whole), ("the gimbal's angles", pitched), ("field of view", seen))
        if known.any()
    ]
    return VehicleLog(
        source=path.name,
        clock=clock,
        system_id=system_id,
        places=PlaceTrack.of(
            t_us,
            part["lat"],
            part["lon"],
            alt_m=column("alt_m"),
            height_m=column("height_m"),
            v_ned=_velocity(column),
            heading=angles("heading_deg")[:, 0] if "heading_deg" in part else body[:, 2],
            std_m=float(np.median(std_m)) if len(std_m) else math.nan,
        ),
        attitudes=AngleTrack(t_us=t_us[whole], angles=body[whole]),
        gimbal=AngleTrack(t_us=t_us[pitched], angles=gimbal[pitched]),
        view=ViewTrack(t_us=t_us[seen], hfov=hfov[seen], source=f"field of view in {path.name}"),
        notes=ImportNotes(found=(f"table, {len(t_us)} positions", *words), skipped=dict(skipped)),
    )


def _velocity(column: object) -> Floats:
    assert callable(column)
    axes = [column(name) for name in ("vn_mps", "ve_mps", "vd_mps")]
    course = np.radians(column("course_deg"))
    speed = column("speed_mps")
    axes[0] = np.where(np.isfinite(axes[0]), axes[0], speed * np.cos(course))
    axes[1] = np.where(np.isfinite(axes[1]), axes[1], speed * np.sin(course))
    return np.column_stack(axes)
