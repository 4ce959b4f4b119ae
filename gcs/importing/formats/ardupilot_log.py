"""ArduPilot's dataflash logs as a vehicle's log: of one that drives or of the UAV.

GPS time is turned into UTC with the leap seconds of its day: 18 since 2017, 17 and 16 before.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import RowTimes, ascending, at_second, row_times
from gcs.importing.checks.two_clocks import clock_lead
from gcs.importing.formats.dataflash import DataflashTables, read_tables
from gcs.importing.vehicle_log import (
    M_PER_HDOP,
    AngleTrack,
    ImportNotes,
    PlaceTrack,
    VehicleLog,
    at_times,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.void]

_WANTED = ("GPS", "GPA", "POS", "ATT", "MNT", "XKF1", "XKF4", "NKF1", "NKF4", "PARM")
_GPS_EPOCH_S, _WEEK_S = 315_964_800, 604_800
_LEAP_S, _LEAPS = 18, ((1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))
"""Leap seconds now, and Unix seconds from which on there were so many; an earlier date is one whose weeks have begun
again."""
_MAX_WEEKS = 10_000
"""Year 2171."""
_FIX_3D = 3
_GAP_US = 2_000_000
"""Longest hole that is bridged where one record tells what another lacks."""
_LATEST = 0.95
"""Quantile of the differences of GPS time and the log's: a record is written some time after the fix that it has."""
_ID_NAMES = (b"SYSID_THISMAV", b"MAV_SYSID")
_LATEST_US = 1 << 53
_LATEST_FIX_US = 2_000_000
"""Greatest delay of a fix in the log."""


def read_ardupilot(path: Path) -> VehicleLog:
    """A vehicle's log.

    Raises:
        ImportFileError: it cannot be read, or has no position.
    """
    tables = read_tables(path, _WANTED)
    places, what, notes = _places(tables, path)
    zero_us, contradictions, leap_s = _zero_us(tables)
    attitudes = _angles(tables.rows("ATT", "TimeUS", "Roll", "Pitch", "Yaw"), ("Roll", "Pitch", "Yaw"))
    heading = at_times(places.t_us, attitudes.t_us, attitudes.angles[:, 2], _GAP_US, turns=True)
    gimbal = _gimbal(tables)
    found = [f"{tables.what}, {len(places)} positions of {what}", f"{len(attitudes)} attitudes"]
    if len(gimbal):
        found.append(f"{len(gimbal)} attitudes of the gimbal")
    shift_us = zero_us or 0
    return VehicleLog(
        source=path.name,
        clock="own" if zero_us is None else "utc",
        dated="" if zero_us is None else f"time since its start, with GPS time less {leap_s} s beside it",
        system_id=_system_id(tables.rows("PARM", "Name", "Value")),
        places=replace(places, t_us=places.t_us + shift_us, heading=heading),
        attitudes=replace(attitudes, t_us=attitudes.t_us + shift_us),
        gimbal=replace(gimbal, t_us=gimbal.t_us + shift_us),
        notes=ImportNotes(
            found=tuple(found),
            assumed=(*contradictions, *notes.assumed),
            skipped={**tables.left_out, **notes.skipped},
        ),
    )


def _times(table: Rows) -> Ints:
    return np.asarray(np.minimum(table["TimeUS"], _LATEST_US), np.int64)


def _first(table: Rows, name: str) -> Rows:
    """Rows of the first instance: receivers, mounts and filters are numbered."""
    if name not in (table.dtype.names or ()):
        return table
    return np.asarray(table[table[name] == table[name].min()])


def _ordered(table: Rows) -> Rows:
    return np.asarray(table[ascending(_times(table))])


def _fixes(tables: DataflashTables, *columns: str) -> Rows | None:
    """Records with a fix, of the receiver that has most of them."""
    table = tables.rows("GPS", "TimeUS", "Status", *columns)
    if table is None:
        return None
    return _of_receiver(np.asarray(table[table["Status"] >= _FIX_3D]), _receiver(tables))


def _receiver(tables: DataflashTables) -> int:
    """Number of the receiver with most fixes."""
    table = tables.rows("GPS", "Status", "I")
    numbers = [] if table is None else table["I"][table["Status"] >= _FIX_3D].tolist()
    return max(sorted(set(numbers)), key=numbers.count, default=0)


def _of_receiver(table: Rows, number: int) -> Rows:
    return np.asarray(table[table["I"] == number]) if "I" in (table.dtype.names or ()) else table


def _of_flying_core(tables: DataflashTables, name: str, table: Rows) -> Rows:
    """Rows of the filter's core that flew, by the records of type 4; of the first core without them."""
    chosen = tables.rows(name.replace("1", "4"), "TimeUS", "PI")
    if "C" not in (table.dtype.names or ()) or chosen is None:
        return _first(table, "C")
    chosen = _ordered(chosen)
    before = np.maximum(np.searchsorted(_times(chosen), _times(table), side="right") - 1, 0)
    return np.asarray(table[table["C"] == chosen["PI"][before]])


def _places(tables: DataflashTables, path: Path) -> tuple[PlaceTrack, str, RowTimes]:
    """Positions of the filter, else of the receiver, and what was made of their times."""
    table, what = tables.rows("POS", "TimeUS", "Lat", "Lng", "Alt"), "the filter"
    if table is None:
        table, what = _fixes(tables, "Lat", "Lng", "Alt"), "the receiver"
    if table is not None:
        at = np.column_stack([table["Lat"].astype(float), table["Lng"].astype(float)])
        ordered = row_times(_times(table), at, f"{path}", at_second(_times(table), "log's clock"))
    if table is None or not len(ordered.rows):
        raise ImportFileError(f"{path}: no position in it; an ArduPilot log with POS or GPS is needed")
    known, t_us, table = "RelHomeAlt" in (table.dtype.names or ()), ordered.t_us, table[ordered.rows]
    places = PlaceTrack.of(
        t_us,
        table["Lat"].astype(float),
        table["Lng"].astype(float),
        alt_m=table["Alt"].astype(float),
        height_m=table["RelHomeAlt"].astype(float) if known else None,
        v_ned=_velocity(tables, t_us),
        std_m=_std_m(tables),
    )
    return places, what, ordered


def _velocity(tables: DataflashTables, t_us: Ints) -> Floats:
    """(n, 3) of the filter, else of the receiver."""
    for name in ("XKF1", "NKF1"):
        table = tables.rows(name, "TimeUS", "VN", "VE", "VD")
        if table is not None:
            table = _ordered(_of_flying_core(tables, name, table))
            axes = [table[axis].astype(float) for axis in ("VN", "VE", "VD")]
            return np.column_stack([at_times(t_us, _times(table), axis, _GAP_US) for axis in axes])
    fixes = _fixes(tables, "Spd", "GCrs", "VZ")
    if fixes is None:
        return np.full((len(t_us), 3), np.nan)
    fixes = _ordered(fixes)
    course, speed = np.radians(fixes["GCrs"].astype(float)), fixes["Spd"].astype(float)
    axes = [speed * np.cos(course), speed * np.sin(course), fixes["VZ"].astype(float)]
    return np.column_stack([at_times(t_us, _times(fixes), axis, _GAP_US) for axis in axes])


def _std_m(tables: DataflashTables) -> float:
    """1σ that the receiver estimates, else by its dilution."""
    accuracy = tables.rows("GPA", "HAcc")
    accuracy = None if accuracy is None else _of_receiver(accuracy, _receiver(tables))
    if accuracy is not None and (accuracy["HAcc"] > 0).any():
        return float(np.median(accuracy["HAcc"][accuracy["HAcc"] > 0].astype(float)))
    fixes = _fixes(tables, "HDop")
    return (
        M_PER_HDOP * float(np.median(fixes["HDop"].astype(float))) if fixes is not None and len(fixes) else float("nan")
    )


def _zero_us(tables: DataflashTables) -> tuple[int | None, tuple[str, ...], int]:
    """Unix µs of the log's time 0, None where no receiver knew it, in words where receivers contradict themselves, and
    the leap seconds of that day.

    What GPS time has over the log's is the same all the time; where it steps, that counts which holds longest.
    """
    fixes = _fixes(tables, "GMS", "GWk")
    if fixes is None:
        return None, (), 0
    fixes = fixes[(fixes["GWk"] > 0) & (fixes["GWk"] < _MAX_WEEKS) & (fixes["GMS"] <= _WEEK_S * 1000)]
    if not len(fixes):
        return None, (), 0
    gps_us = fixes["GWk"].astype(np.int64) * (_WEEK_S * 1_000_000) + fixes["GMS"].astype(np.int64) * 1000
    middle_s = _GPS_EPOCH_S + int(gps_us[len(gps_us) // 2]) // 1_000_000
    leap_s = max((leap_s for since_s, leap_s in _LEAPS if middle_s >= since_s), default=_LEAP_S)
    unix_us = gps_us + (_GPS_EPOCH_S - leap_s) * 1_000_000
    lead = clock_lead("GPS time", "the log's own clock", unix_us, _times(fixes), latest_us=_LATEST_FIX_US)
    return int(np.quantile(lead.longest_us, _LATEST, method="nearest")), lead.notes, leap_s


def _angles(table: Rows | None, names: tuple[str, str, str]) -> AngleTrack:
    if table is None:
        return AngleTrack.empty()
    table = _ordered(table)
    angles = np.column_stack([table[name].astype(float) for name in names])
    return AngleTrack(t_us=_times(table), angles=np.radians(angles))


def _gimbal(tables: DataflashTables) -> AngleTrack:
    """Roll and pitch from the horizon, yaw from the nose, else from north; what was only asked for does not count."""
    for yaw, yaw_from in (("YawB", "nose"), ("YawE", "north")):
        table = tables.rows("MNT", "TimeUS", "Roll", "Pitch", yaw)
        track = _angles(None if table is None else _first(table, "I"), ("Roll", "Pitch", yaw))
        known = np.isfinite(track.angles).all(axis=1)
        if known.any():
            return AngleTrack(
                t_us=track.t_us[known], angles=track.angles[known], yaw_from="nose" if yaw_from == "nose" else "north"
            )
    return AngleTrack.empty()


def _system_id(parameters: Rows | None) -> int:
    if parameters is None:
        return 0
    values = parameters["Value"][np.isin(parameters["Name"], _ID_NAMES)].astype(float)
    return int(values[-1]) if len(values) and 1.0 <= values[-1] <= 255.0 else 0
