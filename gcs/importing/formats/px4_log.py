"""PX4's logs, ``.ulg``, as a vehicle's log, by pyulog.

Topics and fields: https://docs.px4.io/main/en/msg_docs/. The log's own time is turned into UTC by the receiver's
``time_utc_usec``.

pyulog reads in a process of its own, which runs this module: a file of some hundred bytes may ask for all memory.
"""

from __future__ import annotations

import math
import os
import struct
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import RowTimes, ascending, at_second, row_times
from gcs.importing.checks.two_clocks import clock_lead
from gcs.importing.formats.text_file import open_file
from gcs.importing.vehicle_log import (
    AngleTrack,
    ImportNotes,
    PlaceTrack,
    VehicleLog,
    at_times,
    in_order,
)
from infra.files.safe_open import open_to_read
from infra.processes.bounded import UnreadError, answer_parent, ask_child
from mavlink.geodesy import euler_from_quaternion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Columns = Mapping[str, NDArray[Any]]
Topics = Mapping[str, Sequence[Columns]]
"""Instances of each topic, by its name."""
_RECEIVERS = ("vehicle_gps_position", "sensor_gps")
_WANTED = (
    "vehicle_global_position",
    "vehicle_local_position",
    "vehicle_attitude",
    "home_position",
    "gimbal_device_attitude_status",
    *_RECEIVERS,
)
_COLUMNS = (
    *("timestamp", "lat", "lon", "alt", "eph", "vx", "vy", "vz", "q[0]", "q[1]", "q[2]", "q[3]", "device_flags"),
    *("latitude_deg", "longitude_deg", "altitude_msl_m", "fix_type", "time_utc_usec"),
    *("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"),
)
_MAX_BYTES = 1 << 30
_HEADER_BYTES, _MESSAGE, _KINDS = 16, struct.Struct("<HB"), frozenset(b"ABCDFILMOPQRST")
"""ULog's header, the head of each message, and the letters of the kinds that there are."""
_GAP_US = 2_000_000
_LATEST_US = 1 << 53
_LATEST_FIX_US = 2_000_000
"""Greatest delay of a fix in the log."""
_MIN_UTC_US = 1_000_000_000_000_000
"""Year 2001: what a receiver says before is no time."""
_YAW_IN_EARTH_FRAME = 64
_FIX_3D = 3
_MORE_BYTES, _TIMES_LARGER = 200_000_000, 3
"""Memory that reading a log may take: a number of bytes, and a multiple of its size on top."""
_MIN_S, _BYTES_A_SECOND = 60.0, 1_000_000
"""Time that reading a log may take: a number of seconds, and one more for each so many bytes."""


class _UlogColumn(msgspec.Struct):
    name: str
    type: str
    data: bytes


class _UlogTopic(msgspec.Struct):
    name: str
    columns: list[_UlogColumn]


class _UlogQuestion(msgspec.Struct):
    path: str
    topics: list[str]
    columns: list[str]


class UlogTopics(msgspec.Struct, tag=True):
    """Topics that were found."""

    topics: list[_UlogTopic]
    """Topics with rows, instances of one name by their numbers."""
    system_id: int
    """0 unknown."""
    damage: str
    """Reason for which something of it may be missing; empty for none."""

    def tables(self) -> dict[str, list[dict[str, NDArray[np.generic]]]]:
        """Columns by name of each instance of each topic."""
        found: dict[str, list[dict[str, NDArray[np.generic]]]] = {}
        for topic in self.topics:
            columns = {each.name: np.frombuffer(each.data, np.dtype(each.type)) for each in topic.columns}
            found.setdefault(topic.name, []).append(columns)
        return found


def read_topics(path: str, size: int, topics: list[str], columns: list[str]) -> UlogTopics:
    """Read a log.

    Raises:
        UnreadError: it cannot be read, or asks for more than a log may.
    """
    return ask_child(
        __name__,
        _UlogQuestion(path, topics, columns),
        UlogTopics,
        most_bytes=_MORE_BYTES + _TIMES_LARGER * size,
        most_s=_MIN_S + size / _BYTES_A_SECOND,
    )


def _read(question: _UlogQuestion) -> UlogTopics:
    from pyulog import ULog

    with open(open_to_read(question.path), "rb") as file:  # noqa: PTH123 - of a descriptor
        log = ULog(file, question.topics)
    topics = [
        _UlogTopic(each.name, _columns(each.data, question.columns))
        for each in sorted(log.data_list, key=lambda data: int(data.multi_id))
        if len(each.data.get("timestamp", ()))
    ]
    system_id = log.initial_parameters.get("MAV_SYS_ID", 0)
    known = isinstance(system_id, int) and 1 <= system_id <= 255
    return UlogTopics(topics, system_id if known else 0, _damage(question.path, corrupt=log.file_corruption))


def _damage(path: str, *, corrupt: bool) -> str:
    """Find where a message begins as none of the kinds that there are, or has no end; pyulog goes on as it can."""
    with open(open_to_read(path), "rb") as file:  # noqa: PTH123 - of a descriptor
        at, end = _HEADER_BYTES, os.fstat(file.fileno()).st_size
        while not corrupt and at + _MESSAGE.size <= end:
            file.seek(at)
            size, kind = _MESSAGE.unpack(file.read(_MESSAGE.size))
            corrupt = kind not in _KINDS
            at += _MESSAGE.size + size
    return "damaged places" if corrupt else "ends in the middle" if at != end else ""


def _columns(data: dict[str, NDArray[np.generic]], wanted: list[str]) -> list[_UlogColumn]:
    return [_UlogColumn(name, data[name].dtype.str, data[name].tobytes()) for name in wanted if name in data]


@np.errstate(invalid="ignore")  # a damaged number may be a NaN that signals
def read_px4(path: Path) -> VehicleLog:
    """A vehicle's log.

    Raises:
        ImportFileError: it cannot be read, has no position, or pyulog is not installed.
    """
    topics, system_id, damage = _topics(path)
    found_places, what = _places(topics, path), "the estimator"
    if found_places is None:
        found_places, what = _fixes(topics, path), "the receiver"
    if found_places is None:
        wanted = ", ".join(("vehicle_global_position", *_RECEIVERS))
        raise ImportFileError(f"{path}: no position in it; one of {wanted} has to be logged")
    places, ordered = found_places
    zero_us, contradictions = _zero_us(topics)
    attitudes = _attitudes(_first(topics, "vehicle_attitude"))
    gimbal = _gimbal(_first(topics, "gimbal_device_attitude_status"))
    heading = at_times(places.t_us, attitudes.t_us, attitudes.angles[:, 2], _GAP_US, turns=True)
    found = [f"ULog, {len(places)} positions of {what}", f"{len(attitudes)} attitudes"]
    if len(gimbal):
        found.append(f"{len(gimbal)} attitudes of the gimbal")
    shift_us = zero_us or 0
    return VehicleLog(
        source=path.name,
        clock="own" if zero_us is None else "utc",
        dated="" if zero_us is None else "time since its start, with the receiver's UTC beside it",
        system_id=system_id,
        places=PlaceTrack.of(
            places.t_us + shift_us,
            places.lat_deg,
            places.lon_deg,
            alt_m=places.alt_m,
            height_m=places.height_m,
            v_ned=places.v_ned,
            heading=heading,
            std_m=places.std_m,
        ),
        attitudes=AngleTrack(t_us=attitudes.t_us + shift_us, angles=attitudes.angles),
        gimbal=AngleTrack(t_us=gimbal.t_us + shift_us, angles=gimbal.angles, yaw_from=gimbal.yaw_from),
        notes=ImportNotes(
            found=tuple(found),
            assumed=(*contradictions, *ordered.assumed),
            skipped={**({damage: 1} if damage else {}), **ordered.skipped},
        ),
    )


def _topics(path: Path) -> tuple[Topics, int, str]:
    """Instances of the wanted topics by their numbers, the system id (0 unknown), and what damage the file has."""
    if find_spec("pyulog") is None:
        raise ImportFileError(f"{path}: PX4 logs need pyulog: pip install 'rollcall-gcs[import]'")
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
    if size > _MAX_BYTES:
        raise ImportFileError(f"{path}: larger than {_MAX_BYTES >> 30} GiB; cut it where the flight ends")
    try:
        found = read_topics(str(path), size, list(_WANTED), list(_COLUMNS))
    except (UnreadError, OSError) as error:
        raise ImportFileError(f"{path}: not a PX4 log that can be read: {error}") from None
    return found.tables(), found.system_id, found.damage


def _times(topic: Columns) -> Ints:
    return np.asarray(np.minimum(topic["timestamp"].astype(np.uint64), _LATEST_US), np.int64)


def _first(topics: Topics, name: str) -> Columns | None:
    return next(iter(topics.get(name, ())), None)


def _has(topic: Columns | None, *names: str) -> bool:
    return topic is not None and all(name in topic for name in names)


def _places(topics: Topics, path: Path) -> tuple[PlaceTrack, RowTimes] | None:
    """Places of the estimator, and what was made of their times."""
    topic = _first(topics, "vehicle_global_position")
    if topic is None or not _has(topic, "lat", "lon", "alt"):
        return None
    lat, lon = topic["lat"].astype(float), topic["lon"].astype(float)
    ordered = row_times(_times(topic), np.column_stack([lat, lon]), f"{path}", at_second(_times(topic), "log's clock"))
    rows, t_us = ordered.rows, ordered.t_us
    if not len(rows):
        return None
    alt_m = topic["alt"].astype(float)[rows]
    local, home = _first(topics, "vehicle_local_position"), _first(topics, "home_position")
    v_ned = None
    if local is not None and _has(local, "vx", "vy", "vz"):
        order = in_order(_times(local))
        from_us = _times(local)[order]
        axes = [local[axis].astype(float)[order] for axis in ("vx", "vy", "vz")]
        v_ned = np.column_stack([at_times(t_us, from_us, axis, _GAP_US) for axis in axes])
    home_m = float(home["alt"][-1]) if home is not None and _has(home, "alt") else math.nan
    std_m = float(np.median(topic["eph"].astype(float))) if _has(topic, "eph") else math.nan
    places = PlaceTrack.of(
        t_us,
        lat[rows],
        lon[rows],
        alt_m=alt_m,
        height_m=alt_m - home_m,
        v_ned=v_ned,
        std_m=std_m if 0.0 < std_m < 1e3 else math.nan,
    )
    return places, ordered


def _fixes(topics: Topics, path: Path) -> tuple[PlaceTrack, RowTimes] | None:
    """Fixes of the receiver that has most fixes, where nothing was estimated, and what was made of their times."""
    best: tuple[PlaceTrack, RowTimes] | None = None
    for topic in (each for name in _RECEIVERS for each in topics.get(name, ())):
        if _has(topic, "latitude_deg", "longitude_deg", "altitude_msl_m"):
            names, degrees, metres = ("latitude_deg", "longitude_deg", "altitude_msl_m"), 1.0, 1.0
        elif _has(topic, "lat", "lon", "alt"):
            names, degrees, metres = ("lat", "lon", "alt"), 1e-7, 1e-3
        else:
            continue
        lat, lon, alt = (topic[name].astype(float) for name in names)
        lat, lon = lat * degrees, lon * degrees
        fixed = topic["fix_type"] >= _FIX_3D if _has(topic, "fix_type") else np.ones(len(lat), np.bool_)
        rows = np.flatnonzero(fixed)
        t_us, at = _times(topic)[rows], np.column_stack([lat[rows], lon[rows]])
        ordered = row_times(t_us, at, f"{path}", at_second(t_us, "log's clock"))
        rows = rows[ordered.rows]
        if not len(rows) or (best is not None and len(rows) <= len(best[0])):
            continue
        axes = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
        v_ned = np.column_stack([topic[axis].astype(float)[rows] for axis in axes]) if _has(topic, *axes) else None
        std_m = float(np.median(topic["eph"].astype(float)[rows])) if _has(topic, "eph") else math.nan
        known_m = std_m if 0.0 < std_m < 1e3 else math.nan
        places = PlaceTrack.of(ordered.t_us, lat[rows], lon[rows], alt_m=alt[rows] * metres, v_ned=v_ned, std_m=known_m)
        best = places, ordered
    return best


def _zero_us(topics: Topics) -> tuple[int | None, tuple[str, ...]]:
    """Unix µs of the log's time 0, by the receiver that knew it most often, and in words where its date steps.

    None where none knew it.
    """
    found: list[tuple[Ints, Ints]] = [
        (utc_us[known], _times(topic)[known])
        for name in _RECEIVERS
        for topic in topics.get(name, ())
        if _has(topic, "time_utc_usec")
        for utc_us in [topic["time_utc_usec"].astype(np.int64)]
        for known in [utc_us > _MIN_UTC_US]
    ]
    utc_us, t_us = max(found, key=lambda each: len(each[0]), default=(np.empty(0, np.int64),) * 2)
    if not len(utc_us):
        return None, ()
    lead = clock_lead("GPS time", "the log's own clock", utc_us, t_us, latest_us=_LATEST_FIX_US)
    return int(np.quantile(lead.longest_us, 0.5, method="lower")), lead.notes


def _attitudes(topic: Columns | None) -> AngleTrack:
    if topic is None or not _has(topic, *(f"q[{k}]" for k in range(4))):
        return AngleTrack.empty()
    order = ascending(_times(topic))
    q = np.column_stack([topic[f"q[{k}]"].astype(float)[order] for k in range(4)])
    angles = np.array([euler_from_quaternion(*row) for row in q.tolist()]).reshape(-1, 3)
    known = np.isfinite(angles).all(axis=1)
    return AngleTrack(t_us=_times(topic)[order][known], angles=angles[known])


def _gimbal(topic: Columns | None) -> AngleTrack:
    track = _attitudes(topic)
    if topic is None or not len(track):
        return track
    flags = int(topic["device_flags"][0]) if _has(topic, "device_flags") else 0
    yaw_from: Literal["north", "nose"] = "north" if flags & _YAW_IN_EARTH_FRAME else "nose"
    return AngleTrack(t_us=track.t_us, angles=track.angles, yaw_from=yaw_from)


if __name__ == "__main__":
    answer_parent(_UlogQuestion, _read)
