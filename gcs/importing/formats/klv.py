"""MISB ST 0601 in a video's stream of KLV: where platform and sensor were, and how they looked.

Which tag holds what, and as which number: ``gcs.export.motion_imagery.misb``; further tags are passed over.

The optical axis follows from platform and sensor together, R = R(ψ, θ, φ) R(azimuth, elevation, roll).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.export.motion_imagery.misb import CHECKSUM, SETS_KEY, SIGNED, TIME, UNSIGNED, checksum
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
from mavlink.geodesy import rotation_from_euler

_MAX_SET = 1 << 20
_LATEST_US = 4_102_444_800_000_000
"""Year 2100: what is later is a date that is not known."""
_ABOVE_ELLIPSOID = {75, 104}


def log_of_klv(source: str, packets: Sequence[TimedBytes]) -> VehicleLog:
    """The UAV's log.

    Args:
        source: the file's name.
        packets: of the stream, each with one set or more.

    Raises:
        ImportFileError: not one of them tells where the sensor was.
    """
    skipped: Counter[str] = Counter()
    rows: list[tuple[int, dict[int, float]]] = []
    for packet in packets:
        rows += [(packet.t_us, items) for items in _sets(packet.data, skipped)]
    rows = [row for row in rows if 13 in row[1] and 14 in row[1]]
    places = np.array([[items.get(tag, math.nan) for tag in (13, 14, 15)] for _, items in rows]).reshape(-1, 3)
    known = whole_places(places[:, 0], places[:, 1])
    if not known.all():
        skipped["KLV sets that tell no place"] += int(np.count_nonzero(~known))
    if not known.any():
        why = "".join(f", {count} {reason}" for reason, count in skipped.items())
        raise ImportFileError(f"{source}: its KLV never tells where the sensor was ({len(packets)} packets{why})")
    rows = [row for row, good in zip(rows, known.tolist(), strict=True) if good]
    places = places[known]
    if not np.isfinite(places[:, 2]).any() and any(items.keys() & _ABOVE_ELLIPSOID for _, items in rows):
        raise ImportFileError(
            f"{source}: its KLV tells how high the sensor was above the ellipsoid alone (tag 75 or 104), not above sea "
            "level (tag 15), which are up to 100 m apart"
        )
    t_us, zero_us, assumed = _times(rows)
    ordered = row_times(t_us, places[:, :2], source, at_second(np.array([t for t, _ in rows], np.int64), "film"))
    t_us, places, items = ordered.t_us, places[ordered.rows], [rows[k][1] for k in ordered.rows.tolist()]
    body = np.array([_platform(each) for each in items]).reshape(-1, 3)
    gimbal = np.array([_sensor(each, pose) for each, pose in zip(items, body.tolist(), strict=True)]).reshape(-1, 3)
    hfov = np.radians(np.array([each.get(16, math.nan) for each in items]))
    seen = (hfov > 0.0) & (hfov < np.pi)
    whole, pointed = np.isfinite(body).all(axis=1), np.isfinite(gimbal).all(axis=1)
    return VehicleLog(
        source=source,
        clock="video",
        zero_us=zero_us,
        places=PlaceTrack.of(t_us, places[:, 0], places[:, 1], alt_m=places[:, 2], heading=body[:, 2]),
        attitudes=AngleTrack(t_us=t_us[whole], angles=body[whole]),
        gimbal=AngleTrack(t_us=t_us[pointed], angles=gimbal[pointed]),
        view=ViewTrack(t_us=t_us[seen], hfov=hfov[seen], source="KLV in the video"),
        notes=ImportNotes(
            found=(
                f"KLV (MISB ST 0601) in the video, {len(t_us)} positions",
                f"{int(whole.sum())} attitudes, {int(pointed.sum())} of the sensor",
            ),
            assumed=(*assumed, *ordered.assumed),
            skipped={**skipped, **ordered.skipped},
        ),
    )


def _times(rows: Sequence[tuple[int, dict[int, float]]]) -> tuple[NDArray[np.int64], int, tuple[str, ...]]:
    """µs since the video's first frame of each set, Unix µs of that frame, 0 unknown, and in words where dates step.

    Sets come with the video's clock, which says when they were put in, and have the time of what they tell. A date that
    steps against that clock was set, as by a receiver that learns the leap seconds: then the video's clock counts.
    """
    t_us = np.array([t for t, _ in rows], np.int64)
    stamped = [int(items.get(TIME, 0)) for _, items in rows]
    if not all(stamped):
        return t_us, 0, ()
    unix_us = np.array(stamped, np.int64)
    zero_us, assumed = film_date("the date in its KLV", unix_us, t_us)
    return (t_us if assumed else unix_us - zero_us), zero_us, assumed


def _sets(data: bytes, skipped: Counter[str]) -> Iterator[dict[int, float]]:
    """Items by tag, in degrees and metres, of each set that is whole."""
    at = data.find(SETS_KEY)
    while at >= 0:
        size, start = _length(data, at + len(SETS_KEY))
        if size is None or size > _MAX_SET or start + size > len(data):
            skipped["KLV sets that are cut"] += 1
            return
        items = _items(data[start : start + size])
        if items is None:
            skipped["KLV sets that cannot be read"] += 1
        elif not _sum_ok(data[at : start + size], items.get(CHECKSUM)):
            skipped["KLV sets with a wrong checksum"] += 1
        else:
            yield items
        at = data.find(SETS_KEY, start + size)


def _length(data: bytes, at: int) -> tuple[int | None, int]:
    """A BER length and where what it measures begins; None where it is cut."""
    if at >= len(data):
        return None, at
    first = data[at]
    if first < 128:
        return first, at + 1
    count = first & 127
    if not 1 <= count <= 8 or at + 1 + count > len(data):
        return None, at
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def _items(body: bytes) -> dict[int, float] | None:
    items: dict[int, float] = {}
    at = 0
    while at < len(body):
        tag = 0
        for _ in range(4):
            if at >= len(body):
                return None
            byte = body[at]
            tag, at = tag << 7 | byte & 127, at + 1
            if byte < 128:
                break
        size, at = _length(body, at)
        if size is None or at + size > len(body):
            return None
        value = _value(tag, body[at : at + size])
        if value is not None:
            items[tag] = value
        at += size
    return items


def _value(tag: int, raw: bytes) -> float | None:
    """Return a value in degrees, metres or µs; None for tags that are not used, of another length, or unknown."""
    if tag in _ABOVE_ELLIPSOID:
        return 0.0  # that it is there is all that is used
    if tag == CHECKSUM and len(raw) == 2:
        return int.from_bytes(raw, "big")
    if tag == TIME and len(raw) == 8:
        unix_us = int.from_bytes(raw, "big")
        return unix_us if unix_us < _LATEST_US else None
    if tag in UNSIGNED and len(raw) == UNSIGNED[tag][0]:
        size, least, largest = UNSIGNED[tag]
        return least + int.from_bytes(raw, "big") * (largest - least) / ((1 << 8 * size) - 1)
    if tag in SIGNED and len(raw) == SIGNED[tag][0]:
        size, largest = SIGNED[tag]
        whole = int.from_bytes(raw, "big", signed=True)
        most = (1 << 8 * size - 1) - 1
        return None if whole < -most else whole * largest / most
    return None


def _sum_ok(data: bytes, assumed: float | None) -> bool:
    """Tell whether the checksum is that of all before its value; sets without one are taken."""
    if assumed is None:
        return True
    return checksum(data[:-2]) == int(assumed)


def _platform(items: dict[int, float]) -> tuple[float, float, float]:
    """Roll, pitch and heading of the platform, radians."""
    angles = items.get(91, items.get(7, math.nan)), items.get(90, items.get(6, math.nan)), items.get(5, math.nan)
    roll, pitch, heading = map(math.radians, angles)
    return roll, pitch, heading


def _sensor(items: dict[int, float], body: Sequence[float]) -> tuple[float, float, float]:
    """Roll and pitch of the optical axis from the horizon and its yaw from north, radians; NaN unknown."""
    azimuth, elevation = items.get(18, math.nan), items.get(19, math.nan)
    if not all(map(math.isfinite, (*body, azimuth, elevation))):
        return math.nan, math.nan, math.nan
    turned = rotation_from_euler(*map(math.radians, (items.get(20, 0.0), elevation, azimuth)))
    R = rotation_from_euler(body[0], body[1], body[2]) @ turned
    # R = Rz(ψ) Ry(θ) Rx(φ)
    pitch = -math.asin(max(-1.0, min(1.0, float(R[2, 0]))))
    if abs(R[2, 0]) > 1.0 - 1e-9:
        # straight up or down only ψ ∓ φ is defined
        return 0.0, pitch, math.atan2(-float(R[0, 1]), float(R[1, 1]))
    return math.atan2(float(R[2, 1]), float(R[2, 2])), pitch, math.atan2(float(R[1, 0]), float(R[0, 0]))
