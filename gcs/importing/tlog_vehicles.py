"""Vehicles of telemetry logs of their own as vehicle logs: where a station recorded for each, or for the UAV alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.fleet_log import FleetTlog, open_fleet
from gcs.importing.row_times import ascending
from gcs.importing.vehicle_log import AngleTrack, ImportNotes, PlaceTrack, VehicleLog, in_order, whole_places
from mavlink.estimation.gimbal import yaw_frame
from mavlink.geodesy import euler_from_quaternion

__all__ = ["read_tlog_vehicles"]

_GPS_RAW, _ATTITUDE, _GIMBAL = 24, 30, 285
_FIX_3D = 3
_UNKNOWN_MM = 0xFFFFFFFF


def read_tlog_vehicles(path: Path) -> list[VehicleLog]:
    """The vehicles that report positions, by system id, on the clock of the station that recorded.

    Raises:
        ImportFileError: nobody reports one.
        TlogError: it is no telemetry log.
    """
    fleet = open_fleet(path)
    logs = [_log(path, fleet, system_id) for system_id in sorted((*fleet.aircraft, *fleet.ground))]
    logs = [log for log in logs if len(log.places)]
    if not logs:
        raise ImportFileError(f"{path}: no vehicle reports a position in it")
    return logs


def _log(path: Path, fleet: FleetTlog, system_id: int) -> VehicleLog:
    places, what = fleet.places(system_id), "positions"
    if not len(places):
        places, what = _fixes(fleet, system_id), "fixes of the receiver alone"
    attitudes, gimbal = _attitudes(fleet, system_id), _gimbal(fleet, system_id)
    found = (
        f"telemetry log, {len(places)} {what}",
        f"{len(attitudes)} attitudes",
        f"{len(gimbal)} attitudes of the gimbal",
    )
    return VehicleLog(
        source=path.name,
        clock="utc",
        system_id=system_id,
        places=replace(places.select(in_order(places.t_us)), std_m=_std_m(fleet, system_id)),
        attitudes=attitudes,
        gimbal=gimbal,
        notes=ImportNotes(found=found[: 3 if len(gimbal) else 2], assumed=fleet.assumed, skipped=fleet.skipped),
    )


def _fixes(fleet: FleetTlog, system_id: int) -> PlaceTrack:
    """By GPS_RAW_INT, of a vehicle that estimates no position."""
    t_us, wire = fleet.columns(_GPS_RAW, system_id)
    lat, lon = wire["lat"] * 1e-7, wire["lon"] * 1e-7
    rows = np.flatnonzero((wire["fix_type"] >= _FIX_3D) & whole_places(lat, lon))
    rows = rows[np.argsort(t_us[rows], kind="stable")]
    return PlaceTrack.of(t_us[rows], lat[rows], lon[rows], alt_m=wire["alt"][rows] * 1e-3)


def _std_m(fleet: FleetTlog, system_id: int) -> float:
    """Median of what the receiver estimates, NaN where it does not."""
    _, wire = fleet.columns(_GPS_RAW, system_id)
    known = (wire["h_acc"] > 0) & (wire["h_acc"] < _UNKNOWN_MM)
    return float(np.median(wire["h_acc"][known])) * 1e-3 if known.any() else float("nan")


def _attitudes(fleet: FleetTlog, system_id: int) -> AngleTrack:
    t_us, wire = fleet.columns(_ATTITUDE, system_id)
    order = ascending(t_us)
    angles = np.column_stack([wire[name].astype(float) for name in ("roll", "pitch", "yaw")])
    return AngleTrack(t_us=t_us[order], angles=angles[order])


def _gimbal(fleet: FleetTlog, system_id: int) -> AngleTrack:
    """By GIMBAL_DEVICE_ATTITUDE_STATUS, in the frame of its first report."""
    rows, wire = fleet.tlog.columns(_GIMBAL, system_id)
    if not len(rows):
        return AngleTrack.empty()
    t_us = fleet.t_us[rows]
    order = ascending(t_us)
    angles = np.array([euler_from_quaternion(*q) for q in wire["q"][order].astype(float).tolist()]).reshape(-1, 3)
    earth = yaw_frame(int(wire["flags"][0])) == "earth"
    return AngleTrack(t_us=t_us[order], angles=angles, yaw_from="north" if earth else "nose")
