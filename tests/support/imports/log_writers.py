"""Logs as autopilots and other programs write them, made of a telemetry log of ours by their published layouts."""

from __future__ import annotations

import datetime
import math
import struct

import numpy as np

from mavlink.geodesy import quaternion_from_euler
from tests.support.imports.flown import Flown

GPS_EPOCH_US = (315_964_800 - 18) * 1_000_000
WEEK_MS = 604_800_000
BOOT_US = 77_000_000
"""Of the logs' own clocks at the first record."""


def wire_places(flown: Flown, system_id: int) -> dict[str, np.ndarray]:
    """Positions in degrees, metres and m/s by Unix µs."""
    t, wire = flown.columns(33, system_id)
    lat, lon = wire["lat"] * 1e-7, wire["lon"] * 1e-7
    good = np.abs(lat) > 1e-3
    columns = {
        "t_us": t.astype(np.int64),
        "lat": lat,
        "lon": lon,
        "alt_m": wire["alt"] * 1e-3,
        "height_m": wire["relative_alt"] * 1e-3,
        "vn": wire["vx"] * 0.01,
        "ve": wire["vy"] * 0.01,
        "vd": wire["vz"] * 0.01,
    }
    return {name: column[good] for name, column in columns.items()}


def own_times(flown: Flown, message_id: int, system_id: int) -> tuple[np.ndarray, np.ndarray]:
    """Times of what was sent by the vehicle's own clock, and by which records of several kinds keep their order."""
    first, (t, wire) = flown.columns(33, system_id)[0][0], flown.columns(message_id, system_id)
    own = flown.boot_us[flown.order] if hasattr(flown, "boot_us") else t.astype(np.int64) - int(first) + BOOT_US
    own = own[np.abs(wire["lat"]) > 1e4] if message_id == 33 else own
    return own, np.maximum.accumulate(own)


def wire_attitudes(flown: Flown, system_id: int) -> tuple[np.ndarray, np.ndarray]:
    t, wire = flown.columns(30, system_id)
    return t.astype(np.int64), np.column_stack([wire[name].astype(float) for name in ("roll", "pitch", "yaw")])


DATAFLASH = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "GPS": (65, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "POS": (66, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "ATT": (67, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "XKF1": (68, "QBfff", "TimeUS,C,VN,VE,VD"),
    "XKF4": (70, "QBb", "TimeUS,C,PI"),
    "MNT": (69, "QBffffffff", "TimeUS,I,DRoll,Roll,DPitch,Pitch,DYawB,YawB,DYawE,YawE"),
}
SIZES = {
    "B": "B",
    "c": "h",
    "C": "H",
    "e": "i",
    "L": "i",
    "I": "I",
    "H": "H",
    "Q": "Q",
    "b": "b",
    "f": "f",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
}


def dataflash(
    flown: Flown,
    system_id: int,
    *,
    gimbal_deg: tuple[float, float, float] | None = None,
    gps: bool = True,
    receiver: int = 0,
    core: int = 0,
    late_us: int = 0,
) -> bytes:
    """An ArduPilot log of one vehicle.

    Args:
        flown: the flight.
        system_id: whose.
        gimbal_deg: roll, pitch, yaw from the nose, which it keeps.
        gps: whether a receiver knows place and date.
        receiver: which of them; those with lower numbers never have a fix.
        core: of the filter, that flies; the other one drifts.
        late_us: by how much it was started later than the log's own clock says.
    """
    data = b"".join(_format(name) for name in DATAFLASH)
    places, (_, angles) = wire_places(flown, system_id), wire_attitudes(flown, system_id)
    (own_us, keys), (their_us, their_keys) = (own_times(flown, kind, system_id) for kind in (33, 30))
    records = [(0, _record("PARM", BOOT_US, b"SYSID_THISMAV", float(system_id), 1.0))]
    for k, (us, t) in enumerate(zip(own_us.tolist(), keys.tolist(), strict=True)):
        lat, lon = round(places["lat"][k] * 1e7), round(places["lon"][k] * 1e7)
        week, ms = divmod((int(places["t_us"][k]) + late_us - GPS_EPOCH_US) // 1000, WEEK_MS)
        alt, height = places["alt_m"][k], places["height_m"][k]
        speed = (
            math.hypot(places["vn"][k], places["ve"][k]),
            math.degrees(math.atan2(places["ve"][k], places["vn"][k])) % 360.0,
        )
        if gps:
            records += [(t, _record("GPS", us, dead, 0, *(0,) * 11, 1)) for dead in range(receiver)]
            fix = (receiver, 3, ms, week, 14, 80, lat, lon, round(alt * 100), *speed, places["vd"][k], 0.0, 1)
            records.append((t, _record("GPS", us, *fix)))
        records.append((t, _record("POS", us, lat, lon, alt, height, height)))
        records.append((t, _record("XKF1", us, core, places["vn"][k], places["ve"][k], places["vd"][k])))
        records.append((t, _record("XKF1", us, 1 - core, 6.0, 0.0, 0.0)))
        if core:
            records += [(t, _record("XKF4", us, each, core)) for each in (0, 1)]
    attitudes = zip(their_us.tolist(), their_keys.tolist(), np.degrees(angles).tolist(), strict=True)
    for us, t, (roll, pitch, yaw) in attitudes:
        cdeg = (0, round(roll * 100), 0, round(pitch * 100), 0, round(yaw % 360.0 * 100), 0, 0, 0)
        records.append((t, _record("ATT", us, *cdeg)))
        if gimbal_deg:
            nan = math.nan
            mount = (0, nan, gimbal_deg[0], nan, gimbal_deg[1], nan, gimbal_deg[2], nan, nan)
            records.append((t, _record("MNT", us, *mount)))
    return data + b"".join(record for _, record in sorted(records, key=lambda each: each[0]))


def _record(name: str, *values: object) -> bytes:
    kind, chars, _ = DATAFLASH[name]
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(SIZES[char] for char in chars), *values)


def _format(name: str) -> bytes:
    kind, chars, columns = DATAFLASH[name]
    size = 3 + struct.calcsize("<" + "".join(SIZES[char] for char in chars))
    return _record("FMT", kind, size, name.encode(), chars.encode(), columns.encode())


TOPICS = {
    "vehicle_global_position": [("double", "lat"), ("double", "lon"), ("float", "alt"), ("float", "eph")],
    "vehicle_local_position": [("float", "vx"), ("float", "vy"), ("float", "vz")],
    "vehicle_attitude": [("float[4]", "q")],
    "vehicle_gps_position": [("uint64_t", "time_utc_usec")],
    "home_position": [("float", "alt")],
}
PACKS = {"double": "d", "float": "f", "float[4]": "4f", "uint64_t": "Q"}


def ulog(flown: Flown, system_id: int) -> bytes:
    """A PX4 log of one vehicle, by https://docs.px4.io/main/en/dev_log/ulog_file_format.html."""
    places, (_, angles) = wire_places(flown, system_id), wire_attitudes(flown, system_id)
    (own_us, keys), (their_us, their_keys) = (own_times(flown, kind, system_id) for kind in (33, 30))
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT_US) + _message("B", bytes(40))
    for name, fields in TOPICS.items():
        text = f"{name}:uint64_t timestamp;" + "".join(f"{kind} {field};" for kind, field in fields)
        data += _message("F", text.encode())
    key = b"int32_t MAV_SYS_ID"
    data += _message("P", bytes([len(key)]) + key + struct.pack("<i", system_id))
    ids = {name: k for k, name in enumerate(TOPICS)}
    for name, k in ids.items():
        data += _message("A", struct.pack("<BH", 0, k) + name.encode())

    def row(name: str, us: int, *values: float) -> bytes:
        packed = struct.pack("<HQ" + "".join(PACKS[kind] for kind, _ in TOPICS[name]), ids[name], us, *values)
        return _message("D", packed)

    home = float(np.median(places["alt_m"] - places["height_m"]))
    rows = [(0, row("home_position", int(own_us[0]), home))]
    for k, (us, t) in enumerate(zip(own_us.tolist(), keys.tolist(), strict=True)):
        place = places["lat"][k], places["lon"][k], places["alt_m"][k], 0.8
        rows.append((t, row("vehicle_global_position", us, *place)))
        rows.append((t, row("vehicle_local_position", us, places["vn"][k], places["ve"][k], places["vd"][k])))
        rows.append((t, row("vehicle_gps_position", us, int(places["t_us"][k]))))
    rows += [
        (t, row("vehicle_attitude", us, *quaternion_from_euler(*each)))
        for us, t, each in zip(their_us.tolist(), their_keys.tolist(), angles.tolist(), strict=True)
    ]
    return data + b"".join(packed for _, packed in sorted(rows, key=lambda each: each[0]))


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def positions_csv(flown: Flown, system_ids: tuple[int, ...]) -> str:
    """A table of several vehicles."""
    rows = ["time_us,system_id,lat,lon,alt_m,vn_mps,ve_mps,vd_mps\n"]
    for system_id in system_ids:
        places = wire_places(flown, system_id)
        for t, lat, lon, alt, _, vn, ve, vd in zip(*(column.tolist() for column in places.values()), strict=True):
            rows.append(f"{t},{system_id},{lat:.7f},{lon:.7f},{alt:.3f},{vn:.2f},{ve:.2f},{vd:.2f}\n")
    return "".join(rows)


def pose_csv(flown: Flown) -> str:
    """The UAV's pose at each frame, as a semicolon table with decimal commas."""
    rows = ["Frame;Latitude;Longitude;Alt;Rel_Alt;Roll;Pitch;Yaw;remark\n"]
    at_us, angles = wire_attitudes(flown, 1)
    frames = flown.frames_us
    body = np.column_stack([np.interp(frames, at_us, np.unwrap(column)) for column in angles.T])
    for k, (_, spot) in enumerate(flown.spots()):
        roll, pitch, yaw = (float((angle + 180.0) % 360.0 - 180.0) for angle in np.degrees(body[k]))
        cells = (
            f"{value:.7f}".replace(".", ",") for value in (spot.lat, spot.lon, spot.alt, spot.height, roll, pitch, yaw)
        )
        rows.append(f"{k};{';'.join(cells)};{'' if k else 'first'}\n")
    return "".join(rows)


def gpx(flown: Flown, system_ids: tuple[int, ...]) -> str:
    """GPX 1.1 with one track a vehicle."""
    rows = ['<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">\n']
    for system_id in system_ids:
        places = wire_places(flown, system_id)
        rows.append(f"<trk><name>UGV-{system_id}</name><trkseg>\n")
        for t, lat, lon, alt in zip(*(places[name].tolist() for name in ("t_us", "lat", "lon", "alt_m")), strict=True):
            when = datetime.datetime.fromtimestamp(t / 1e6, datetime.UTC).isoformat(timespec="milliseconds")
            stamp = when.replace("+00:00", "Z")
            rows.append(f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>{alt:.2f}</ele><time>{stamp}</time></trkpt>\n')
        rows.append("</trkseg></trk>\n")
    return "".join([*rows, "</gpx>\n"])
