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

import csv
import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import NO_ZONE, numbered, row_times, unix_seconds
from gcs.importing.checks.two_clocks import clock_lead
from gcs.importing.formats.column_names import KNOWN, column_of, in_our_units
from gcs.importing.formats.text_file import text_lines
from gcs.importing.vehicle_log import (
    AngleTrack,
    ImportNotes,
    LogClock,
    PlaceTrack,
    VehicleLog,
    ViewTrack,
    whole_places,
)
from infra.plain_text import plain
from infra.text_numbers import number_or_nan

Floats = NDArray[np.float64]

TIMES = ("time_us", "time_ms", "time_ns", "time_s", "time", "elapsed_s", "frame")
"""Columns of times, best first."""
_UNITS = (("s", 1e6), ("ms", 1e3), ("µs", 1.0), ("ns", 1e-3))
_UNIX_FROM_US, _UNIX_TO_US = 1e14, 4.1e15
"""Unix times of 1973 to 2099; smaller numbers count from another moment."""
_LONGEST_STEP_S = 60.0
"""Longest interval between two rows of a table that tells a path."""
_GIVE = (
    "time since a start does not tell when that was: "
    "give Unix time, ISO 8601, or elapsed_s since the film's first frame"
)
_LATEST_US = 4_102_444_800_000_000  # the year 2100
_MAX_HEAD = 40
"""Lines among which the names of the columns are."""
_MAX_ROWS = 2_000_000
_MAX_SHOWN = 200
_AROUND = " \t\r\n\"'"
_MAX_NAMED, _MAX_NAME = 8, 40
_NO_NUMBER = "cells that are no numbers"
_UNKNOWN = ("", "nan", "null", "none", "n/a", "na", "-", "--")
"""Words in a cell where nothing is known."""


def unix_us(name: str, times: Floats, *, dated: bool, where: str) -> tuple[Floats, LogClock, tuple[str, ...]]:
    """Times in µs, the clock that they are of, and what was assumed.

    Seconds, ms, µs and ns since 1970 are told apart by their size, whatever the column is called: no other reading of
    them is a date of our time. Smaller numbers are on a clock of their own, or of the video.

    Args:
        times: (n,) as they stand in it, of dates Unix seconds.

    Raises:
        ImportFileError: they can be of no clock.
    """
    if name == "frame":
        return times, "frame", ()
    if name == "elapsed_s":
        _check_steps(times, 1e6, "s", where, "give seconds since the film's first frame")
        return times * 1e6, "video", ()
    if dated:
        return times * 1e6, "utc", ()
    middle = float(np.median(times))
    for unit, us in _UNITS:
        if _UNIX_FROM_US <= middle * us < _UNIX_TO_US:
            _check_steps(times, us, unit, where)
            named = name == "time" or name == f"time_{unit.replace('µ', 'u')}"
            return times * us, "utc", () if named else (f"{where} is in {unit} since 1970 by its size",)
    if name in ("time", "time_s"):
        if middle * 1e6 >= _UNIX_FROM_US:
            raise ImportFileError(f"{where}: {middle:.0f} is no Unix time of 1973 to 2099 in s, ms, µs or ns")
        _check_steps(times, 1e6, "s", where)
        return times * 1e6, "video", ()
    us = {"time_ms": 1e3, "time_us": 1.0, "time_ns": 1e-3}[name]
    return times * us, "own", ()


def _check_steps(times: Floats, us: float, unit: str, where: str, give: str = _GIVE) -> None:
    """See that rows follow each other as those of a path.

    Raises:
        ImportFileError: they would be minutes apart.
    """
    steps = np.abs(np.diff(times))
    steps = steps[steps > 0.0]
    if len(steps) and float(np.median(steps)) * us * 1e-6 > _LONGEST_STEP_S:
        raise ImportFileError(f"{where}: cannot be {unit}, since rows are {np.median(steps):.6g} apart; {give}")


def read_csv(path: Path) -> list[VehicleLog]:
    """The vehicles in a table, by system id; one with id 0 for a table without.

    Raises:
        ImportFileError: it cannot be read, a column is missing, or no row can be used.
    """
    with closing(text_lines(path)) as text:
        lines = enumerate(text, 1)
        between, cells, begun = _header(lines)
        table = _TextTable(path, between, cells)
        table.read(chain(begun, lines))
    by_name, assumed = in_our_units(table.columns(), cells, f"{path}")
    where = f"{path}: column {cells[table.names.index(table.time)].strip(_AROUND)}"
    times, clock, time_notes = unix_us(table.time, by_name[table.time], dated=table.dated, where=where)
    if table.dated and "counted_ms" in by_name:
        times, time_notes = _between_seconds(times, by_name["counted_ms"] * 1e3)
    t_us = np.rint(np.clip(times, -1.0, _LATEST_US))
    assumed += time_notes + ((NO_ZONE,) if table.zoneless else ())
    titles = zip((plain(cell.strip(_AROUND))[:_MAX_NAME] for cell in cells), table.names, strict=True)
    unread = [title for title, name in titles if title and name not in KNOWN]
    more = f" and {len(unread) - _MAX_NAMED} more" if len(unread) > _MAX_NAMED else ""
    found = (f"columns left alone: {', '.join(unread[:_MAX_NAMED])}{more}",) if unread else ()
    notes = ImportNotes(found=found, assumed=assumed, skipped=table.skipped)
    return _vehicles(path, by_name, t_us, clock, notes, np.array(table.lines, np.int64))


def _header(lines: Iterator[tuple[int, str]]) -> tuple[str, list[str], list[tuple[int, str]]]:
    """Find the sign between cells, the names of the columns, and the lines behind them that were read.

    In front of the names a writer may tell of itself; where no line names a time and a place, it is the first.
    """
    first = [(number, line) for number, line in islice(lines, _MAX_HEAD) if line.strip(_AROUND + "\ufeff")]
    tables = [(between, _cells(line, between)) for _, line in first for between in [max(",;\t", key=line.count)]]
    for row, (between, cells) in enumerate(tables):
        names = {column_of(cell)[0] for cell in cells}
        if {"lat", "lon"} <= names and not names.isdisjoint(TIMES):
            return between, cells, first[row + 1 :]
    return *next(iter(tables), (",", [""])), []


def _between_seconds(times: Floats, counted_us: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Times of rows that share dates of whole seconds by the count beside them, and what was assumed; else as they are.

    Args:
        times: (n,) Unix µs.
        counted_us: (n,) since any moment, NaN unknown.
    """
    if (times % 1e6).any() or len(np.unique(times)) * 2 > len(times) or not np.isfinite(counted_us).all():
        return times, ()
    ahead_us = times - counted_us
    # each date is that of its row or up to a second earlier
    least_us, most_us = float(ahead_us.max()), float(ahead_us.min()) + 1e6
    if least_us <= most_us:
        within_s = 0.5e-6 * (most_us - least_us)
        words = f"dates are whole seconds: rows are placed by the milliseconds beside them, ±{within_s:.2f} s"
        return counted_us + 0.5 * (least_us + most_us), (words,)
    lead = clock_lead("the date", "the count beside it", *(np.rint(t).astype(np.int64) for t in (times, counted_us)))
    return counted_us + float(np.median(lead.longest_us)), lead.notes


def _vehicles(
    path: Path, columns: dict[str, Floats], t_us: Floats, clock: LogClock, notes: ImportNotes, lines: NDArray[np.int64]
) -> list[VehicleLog]:
    """The rows of each vehicle as its log.

    Raises:
        ImportFileError: no row can be used, or a vehicle's times are of no clock.
    """
    good = whole_places(columns["lat"], columns["lon"])
    if not good.any():
        worst = f"{columns['lat'][0]:g}, {columns['lon'][0]:g}"
        raise ImportFileError(
            f"{path}: no row in it that can be used: lat, lon such as {worst} are no place in degrees"
        )
    good &= (t_us >= 0) & (t_us < _LATEST_US)
    owner, assumed = _owners(columns), notes.assumed
    if "id" in columns and owner is None:
        assumed += ("the column id counts rows: it is no system id",)
    owner = np.zeros(len(t_us)) if owner is None else owner
    theirs = (owner >= 0) & (owner <= 255) & (owner == np.floor(owner))
    skipped = Counter(notes.skipped)
    skipped["rows without a place or time that can be"] += int(np.count_nonzero(~good))
    skipped["rows with a system id that is none of 1 to 255"] += int(np.count_nonzero(good & ~theirs))
    logs = []
    for system_id in np.unique(owner[good & theirs]).tolist():
        mine = np.flatnonzero(good & (owner == system_id))
        whose = f"{path}, system {system_id:g}" if system_id else f"{path}"
        at = np.column_stack([columns["lat"][mine], columns["lon"][mine]])
        ordered = row_times(t_us[mine].astype(np.int64), at, whose, numbered("line", lines[mine]))
        part = {name: column[mine[ordered.rows]] for name, column in columns.items()}
        left_out = dict(+(skipped + Counter(ordered.skipped)))
        log_notes = replace(notes, assumed=(*assumed, *ordered.assumed), skipped=left_out)
        logs.append(_log(path, int(system_id), ordered.t_us, clock, part, log_notes))
    if not logs:
        other = "words" if np.isnan(owner[good]).all() else f"{owner[good][0]:g}"
        why = f"system ids are 1 to 255, not {other}" if good.any() else "its times are none of 1970 to 2099"
        raise ImportFileError(f"{path}: no row in it that can be used: {why}")
    return logs


def _owners(columns: dict[str, Floats]) -> Floats | None:
    """(n,) system ids, None without; a column ``id`` that most rows have alone counts rows."""
    if "system_id" in columns:
        return columns["system_id"]
    ids = columns.get("id")
    return None if ids is None or (len(ids) > 1 and len(np.unique(ids)) * 2 > len(ids)) else ids


class _TextTable:
    """Numbers of a table's rows as they are read."""

    def __init__(self, path: Path, between: str, cells: list[str]) -> None:
        columns = [column_of(cell) for cell in cells]
        self.names = [name for name, _ in columns]
        self.skipped: Counter[str] = Counter()
        self.lines = array("Q")
        """Line of each row, from 1."""
        self.dated = self.zoneless = False
        self._path, self._between = path, between
        self._strange = ""
        self._cut = False
        """True if the last row has fewer cells than the one in front of it, as where a file is cut off."""
        time = next((name for name in TIMES if name in self.names), None)
        seen = plain(", ".join(self.names[:_MAX_NAMED]))[:_MAX_SHOWN]
        if time is None:
            wanted, seen = ", ".join(TIMES), seen[: _MAX_SHOWN // 2]
            raise ImportFileError(
                f"{path}: no column of times; the first line must name one of {wanted}, it has {seen}"
            )
        missing = [name for name in ("lat", "lon") if name not in self.names]
        if missing:
            raise ImportFileError(
                f"{path}: column {missing[0]} is missing; the first line must name the columns, it has {seen}"
            )
        self.time = time
        self._kept = [name for name in dict.fromkeys(self.names) if name in KNOWN]
        # of times in UTC and in local time the first
        order = sorted(range(len(cells)), key=lambda place: "utc" not in cells[place].lower())
        self._places = [next(place for place in order if self.names[place] == name) for name in self._kept]
        self._in_utc = "utc" in cells[self._places[self._kept.index(time)]].lower()
        self._factors = np.array([columns[place][1] for place in self._places])

    def columns(self) -> dict[str, Floats]:
        """Columns by our names, NaN for cells that are empty or no number."""
        return dict(zip(self._kept, self._rows.T * self._factors[:, None], strict=True))

    def read(self, lines: Iterable[tuple[int, str]]) -> None:
        """Read all rows.

        Raises:
            ImportFileError: no row has a time, or there are too many.
        """
        self._rows = np.fromiter(self._numbers(lines), np.dtype((np.float64, len(self._kept))))
        if len(self._rows) > 1 and self._cut:
            self._rows = self._rows[:-1]
            self.lines.pop()
            self.skipped["rows that are cut off"] += 1
        if len(self._rows):
            return
        if self._strange:
            raise ImportFileError(
                f"{self._path}: no row in it that can be used: the time {self._strange!r} is not understood; give ISO "
                "8601, such as 2025-10-09T08:53:20Z, or Unix time"
            )
        wide = self.skipped["rows of more cells than there are columns"]
        why = (
            "its rows have more cells than its first line: decimal commas need semicolons or tabs between cells"
            if wide
            else "no time in the column of times"
        )
        raise ImportFileError(f"{self._path}: no row in it that can be used: {why}")

    def _numbers(self, lines: Iterable[tuple[int, str]]) -> Iterator[list[float]]:
        time = self._kept.index(self.time)
        place, width, before = self._places[time], len(self.names), 0
        for number, line in lines:
            if not line.strip():
                continue
            if len(self.lines) >= _MAX_ROWS:
                raise ImportFileError(f"{self._path}: more than {_MAX_ROWS} rows; cut it where the flight ends")
            cells = [cell.strip(_AROUND) for cell in _cells(line, self._between)]
            if any(cells[width:]):
                self.skipped["rows of more cells than there are columns"] += 1
                continue
            shorter, before = len(cells) < before, len(cells)
            cells += [""] * (width - len(cells))
            row = self._row([cells[k] for k in self._places])
            # a date may have a comma of its own
            row[time] = row[time] if math.isfinite(row[time]) else self._date(cells[place])
            if math.isfinite(row[time]):
                self._cut = shorter
                self.lines.append(number)
                yield row
            else:
                self.skipped["rows without a time"] += 1

    def _row(self, cells: list[str]) -> list[float]:
        """Numbers of the cells that are kept; their commas are decimal ones where none of them has a point."""
        numbers = [number_or_nan(cell) for cell in cells]
        strange = [k for k, number in enumerate(numbers) if math.isnan(number) and cells[k].lower() not in _UNKNOWN]
        if not strange:
            return numbers
        time = self._kept.index(self.time)
        if not any("." in cell for k, cell in enumerate(cells) if k != time):
            numbers = [number_or_nan(cell.replace(",", ".")) for cell in cells]
        self.skipped[_NO_NUMBER] += sum(math.isnan(numbers[k]) for k in strange if k != time)
        return numbers

    def _date(self, text: str) -> float:
        seconds, zoned = unix_seconds(text)
        if math.isnan(seconds):
            self._strange = self._strange or plain(text)[:40]
            return seconds
        self.dated, self.zoneless = True, self.zoneless or not (zoned or self._in_utc)
        return seconds


def _cells(line: str, between: str) -> list[str]:
    """Cells of one row; within quotation marks there may be what else stands between cells."""
    if '"' not in line:
        return line.split(between)
    return next(csv.reader([line], delimiter=between, skipinitialspace=True), [])


def _log(
    path: Path, system_id: int, t_us: NDArray[np.int64], clock: LogClock, part: dict[str, Floats], notes: ImportNotes
) -> VehicleLog:
    def column(name: str) -> Floats:
        return part.get(name, np.full(len(t_us), np.nan))

    def angles(*names: str) -> Floats:
        found = np.radians(np.column_stack([column(name) for name in names]))
        found[np.abs(found) > 2.0 * np.pi] = np.nan
        return found

    body, gimbal = (
        angles("roll_deg", "pitch_deg", "yaw_deg" if "yaw_deg" in part else "heading_deg"),
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
        notes=replace(notes, found=(f"table, {len(t_us)} positions", *words, *notes.found)),
    )


def _velocity(column: object) -> Floats:
    assert callable(column)
    axes = [column(name) for name in ("vn_mps", "ve_mps", "vd_mps")]
    course = np.radians(column("course_deg"))
    speed = column("speed_mps")
    axes[0] = np.where(np.isfinite(axes[0]), axes[0], speed * np.cos(course))
    axes[1] = np.where(np.isfinite(axes[1]), axes[1], speed * np.sin(course))
    return np.column_stack(axes)
