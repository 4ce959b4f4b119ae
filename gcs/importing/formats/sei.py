"""AP_CameraGimbal's telemetry among the coded pictures of H.264 and H.265, one message a picture.

A supplemental message of type 5 (ITU-T H.264 D.1.7) has a UUID, 8d646b4e-556f-4a90-8b7c-35e629510321, and JSON of
schema ``apcg.telemetry.v1``. Fields, by the documentation of AP_CameraGimbal: ``utc_us``; ``position`` lat_e7, lon_e7,
alt_amsl_m, alt_relative_m; ``velocity`` vn_m_s …; ``vehicle_attitude`` and ``gimbal_attitude`` roll_rad, pitch_rad,
yaw_rad, the gimbal's yaw from the nose; ``hfov_deg`` with zoom in it; each with ``age_ms``, and null where unknown.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import at_second, row_times
from gcs.importing.checks.two_clocks import film_date
from gcs.importing.formats.timed_bytes import TimedBytes
from gcs.importing.vehicle_log import (
    AngleTrack,
    ImportNotes,
    PlaceTrack,
    VehicleLog,
    ViewTrack,
    whole_places,
)

TELEMETRY_UUID = bytes.fromhex("8d646b4e556f4a908b7c35e629510321")
_SCHEMA = "apcg.telemetry.v1"
_USER_DATA = 5
_H264_SEI, _H265_SEI = (6,), (39, 40)
_MAX_JSON = 16 << 10
_OLDEST_MS = 1000.0
"""Greatest age at which a message is not left out."""
_PARTS = re.compile(rb"\x00\x00\x01")
_UNESCAPED = re.compile(rb"\x00\x00\x03")


def unregistered_messages(packet: bytes, length_size: int, *, hevc: bool) -> Iterator[bytes]:
    """User data with a UUID in front, of the coded units of one packet.

    Args:
        length_size: bytes of the length before each unit; 0: start codes.
        hevc: H.265, else H.264.
    """
    kinds, header = (_H265_SEI, 2) if hevc else (_H264_SEI, 1)
    for unit in _units(packet, length_size):
        kind = (unit[0] >> 1) & 63 if hevc else unit[0] & 31
        if kind in kinds:
            yield from _user_data(_UNESCAPED.sub(b"\x00\x00", unit[header:]))


def _units(packet: bytes, length_size: int) -> Iterator[bytes]:
    if not length_size:
        yield from (part for part in _PARTS.split(packet)[1:] if part)
        return
    at = 0
    while at + length_size < len(packet):
        size = int.from_bytes(packet[at : at + length_size], "big")
        at += length_size
        if not 0 < size <= len(packet) - at:
            return
        yield packet[at : at + size]
        at += size


def _user_data(body: bytes) -> Iterator[bytes]:
    at = 0
    while at + 2 < len(body):
        values = []
        for _ in range(2):
            value = 0
            while at < len(body) and body[at] == 255:
                value, at = value + 255, at + 1
            if at >= len(body):
                return
            values.append(value + body[at])
            at += 1
        kind, size = values
        if size > len(body) - at:
            return
        if kind == _USER_DATA and size >= len(TELEMETRY_UUID):
            yield body[at : at + size]
        at += size


def log_of_messages(source: str, messages: Sequence[TimedBytes]) -> VehicleLog:
    """The UAV's log, of messages in any order.

    Raises:
        ImportFileError: not one of them tells where the UAV was.
    """
    skipped: Counter[str] = Counter()
    rows: dict[int, Mapping[str, Any]] = {}
    for message in messages:
        if not message.data.startswith(TELEMETRY_UUID):
            continue
        record = _record(message.data[len(TELEMETRY_UUID) :])
        if record is None:
            skipped["messages that cannot be read"] += 1
        elif rows.setdefault(message.t_us, record) is not record:
            skipped["messages with the time of another"] += 1
    t_us = np.array(sorted(rows), np.int64)
    records = [rows[t] for t in t_us.tolist()]
    places = np.array([_place(record) for record in records]).reshape(-1, 7)
    known = whole_places(places[:, 0], places[:, 1])
    if not known.any():
        raise ImportFileError(f"{source}: its telemetry never tells where the UAV was")
    if not known.all():
        skipped["messages without a position"] += int(np.count_nonzero(~known))
    utc_us = np.array([_number(record, "utc_us") for record in records])
    hfov = np.radians(np.array([_number(record, "hfov_deg") for record in records]))
    seen = (hfov > 0.0) & (hfov < np.pi)
    attitudes, gimbal = (_angles(t_us, records, name) for name in ("vehicle_attitude", "gimbal_attitude"))
    places = places[known]
    ordered = row_times(t_us[known], places[:, :2], source, at_second(t_us[known], "film"))
    order = ordered.rows
    zero_us, assumed = film_date("the date in its telemetry", np.nan_to_num(utc_us).astype(np.int64), t_us)
    return VehicleLog(
        source=source,
        clock="video",
        zero_us=zero_us,
        places=PlaceTrack.of(
            ordered.t_us,
            places[order, 0],
            places[order, 1],
            alt_m=places[order, 2],
            height_m=places[order, 3],
            v_ned=places[order, 4:7],
        ),
        attitudes=attitudes,
        gimbal=AngleTrack(t_us=gimbal.t_us, angles=gimbal.angles, yaw_from="nose"),
        view=ViewTrack(t_us=t_us[seen], hfov=hfov[seen], source="telemetry among the pictures"),
        notes=ImportNotes(
            found=(
                f"AP_CameraGimbal's telemetry among the pictures, {len(places)} positions",
                f"{len(attitudes)} attitudes, {len(gimbal)} of the gimbal",
            ),
            assumed=(*assumed, *ordered.assumed),
            skipped={**skipped, **ordered.skipped},
        ),
    )


def _record(data: bytes) -> Mapping[str, Any] | None:
    if len(data) > _MAX_JSON:
        return None
    try:
        record = json.loads(data.rstrip(b"\0"))
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) and record.get("schema") == _SCHEMA else None


def _number(table: object, name: str) -> float:
    value = table.get(name) if isinstance(table, Mapping) else None
    known = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e18
    return float(value) if known and isinstance(value, int | float) else math.nan


def _part(record: Mapping[str, Any], name: str) -> object:
    """A part of a record that is not older than it may be, empty without one."""
    part = record.get(name)
    return {} if _number(part, "age_ms") > _OLDEST_MS else part


def _place(record: Mapping[str, Any]) -> tuple[float, ...]:
    position, velocity = _part(record, "position"), _part(record, "velocity")
    v_ned = (_number(velocity, name) for name in ("vn_m_s", "ve_m_s", "vd_m_s"))
    lat, lon = _number(position, "lat_e7") * 1e-7, _number(position, "lon_e7") * 1e-7
    return lat, lon, _number(position, "alt_amsl_m"), _number(position, "alt_relative_m"), *v_ned


def _angles(t_us: np.ndarray[Any, np.dtype[np.int64]], records: Sequence[Mapping[str, Any]], name: str) -> AngleTrack:
    angles = np.array(
        [[_number(_part(record, name), f"{axis}_rad") for axis in ("roll", "pitch", "yaw")] for record in records]
    ).reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        known = (np.abs(angles) <= 2.0 * np.pi).all(axis=1)
    return AngleTrack(t_us=t_us[known], angles=angles[known])
