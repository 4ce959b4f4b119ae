"""A straight drive, made up, in every format of a log: to be broken on purpose and read again."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.importing.checks.plausible import plausible
from gcs.importing.formats.klv import log_of_klv
from gcs.importing.formats.sei import TELEMETRY_UUID, log_of_messages
from gcs.importing.formats.siyi import siyi_log
from gcs.importing.formats.subtitles import SubtitleCue
from gcs.importing.formats.timed_bytes import TimedBytes
from gcs.importing.sources import read_vehicle_logs
from gcs.importing.vehicle_log import VehicleLog
from mavlink.protocol.encoder import ROVER, MavlinkEncoder
from tests.support.imports.film_writers import klv_set, siyi, telemetry
from tests.support.imports.log_writers import dataflash, gpx, ulog
from tests.support.imports.srt_writers import Spot, srt
from tests.support.imports.text_writers import dataflash_text, kml, nmea

N, STEP_US = 160, 250_000
T0_US = 1_760_000_000_000_000
LAT, LON, ALT_M, HEIGHT_M, YAW_DEG = (47.1, 4e-6), (8.1, 2e-6), (430.0, 0.01), (30.0, 0.01), (20.0, 0.5)
"""At the first sample, and by how much more at each of the next."""
ROLL, PITCH = math.radians(1.0), math.radians(2.0)


def _line(begin_and_step):
    return begin_and_step[0] + begin_and_step[1] * np.arange(N)


@dataclass
class Straight:
    """What is written, by sample; ``order`` is that of the file. Stands for a flight where log writers want one."""

    t_us: np.ndarray = field(default_factory=lambda: T0_US + STEP_US * np.arange(N))
    """By the date."""
    boot_us: np.ndarray = field(default_factory=lambda: 77_000_000 + STEP_US * np.arange(N))
    film_us: np.ndarray = field(default_factory=lambda: STEP_US * np.arange(N))
    lat: np.ndarray = field(default_factory=lambda: _line(LAT))
    lon: np.ndarray = field(default_factory=lambda: _line(LON))
    alt_m: np.ndarray = field(default_factory=lambda: _line(ALT_M))
    height_m: np.ndarray = field(default_factory=lambda: _line(HEIGHT_M))
    yaw_deg: np.ndarray = field(default_factory=lambda: _line(YAW_DEG))
    order: np.ndarray = field(default_factory=lambda: np.arange(N))

    def mix_in(self, every: int, north_deg: float, later_us: int) -> None:
        """Beside each ``every``-th sample another one, of something that drives beside it."""
        beside = np.arange(0, N, every)
        places = np.sort(np.r_[np.arange(N), beside])
        again = np.diff(places, prepend=-1) == 0
        for name in ("t_us", "boot_us", "film_us", "lat", "lon", "alt_m", "height_m", "yaw_deg"):
            setattr(self, name, getattr(self, name)[places])
        self.lat = self.lat + north_deg * again
        for name in ("t_us", "boot_us", "film_us"):
            setattr(self, name, getattr(self, name) + later_us * again)
        self.order = np.arange(len(places))

    @property
    def yaw(self):
        return (np.radians(self.yaw_deg) + np.pi) % (2.0 * np.pi) - np.pi

    def columns(self, message_id, _system_id):
        """As a telemetry log has them."""
        rows = self.order
        if message_id == 30:
            still = np.ones(len(rows))
            return self.t_us[rows], {"roll": ROLL * still, "pitch": PITCH * still, "yaw": self.yaw[rows]}
        scaled = {
            "lat": self.lat * 1e7,
            "lon": self.lon * 1e7,
            "alt": self.alt_m * 1e3,
            "relative_alt": self.height_m * 1e3,
        }
        n = len(self.t_us)
        speed = {"vx": np.full(n, 178.0), "vy": np.full(n, 60.0), "vz": np.zeros(n)}
        return self.t_us[rows], {name: np.rint(column)[rows] for name, column in (scaled | speed).items()}

    def spots(self):
        for k in self.order.tolist():
            where = {"lat": self.lat[k], "lon": self.lon[k], "alt": self.alt_m[k], "height": self.height_m[k]}
            yaw = math.degrees(self.yaw[k])
            yield float(self.film_us[k]) * 1e-6, Spot(**where, yaw=yaw, unix_us=int(self.t_us[k]))


def _table(drive: Straight, time: str) -> str:
    rows = [f"{time},lat,lon,alt_m,height_m,roll_deg,pitch_deg,yaw_deg\n"]
    for k in drive.order.tolist():
        at = drive.t_us[k] if time == "time_us" else f"{drive.film_us[k] * 1e-6:.3f}"
        place = f"{drive.lat[k]:.11f},{drive.lon[k]:.11f},{drive.alt_m[k]:.3f},{drive.height_m[k]:.3f}"
        rows.append(f"{at},{place},1.0,2.0,{drive.yaw_deg[k]:.3f}\n")
    return "".join(rows)


def _tlog(drive: Straight) -> bytes:
    speaker, records = MavlinkEncoder(11), []
    for k in drive.order.tolist():
        boot_ms, yaw = int(drive.boot_us[k]) // 1000, float(drive.yaw[k])
        place = drive.lat[k], drive.lon[k], drive.alt_m[k], drive.height_m[k]
        frames = [
            speaker.global_position_int(boot_ms, *place, (1.78, 0.6, 0.0), yaw % (2.0 * math.pi)),
            speaker.pack(dialect.MAVLink_attitude_message(boot_ms, ROLL, PITCH, yaw, 0.0, 0.0, 0.0)),
            speaker.heartbeat(kind=ROVER),
        ]
        records += [struct.pack(">Q", int(drive.t_us[k])) + frame for frame in frames]
    return b"".join(records)


def _klv(drive: Straight) -> list[TimedBytes]:
    return [TimedBytes(round(t * 1e6), klv_set(spot, (1.0, 2.0, spot.yaw))) for t, spot in drive.spots()]


def _messages(drive: Straight) -> list[TimedBytes]:
    found = []
    for k, (t, spot) in enumerate(drive.spots()):
        record = telemetry(None, k, spot, np.array([1.0, 2.0, spot.yaw]))
        found.append(TimedBytes(round(t * 1e6), TELEMETRY_UUID + json.dumps(record).encode()))
    return found


def _cues(drive: Straight) -> list[SubtitleCue]:
    return [SubtitleCue(round(t * 1e6), siyi(k, spot)) for k, (t, spot) in enumerate(drive.spots())]


FILES = {
    "rover.csv": lambda drive: _table(drive, "time_us"),
    "elapsed.csv": lambda drive: _table(drive, "elapsed_s"),
    "rover.gpx": lambda drive: gpx(drive, (11,)),
    "rover.kml": lambda drive: kml(drive, (11,)),
    "rover.nmea": lambda drive: nmea(drive, 11),
    "rover.bin": lambda drive: dataflash(drive, 11),
    "rover.log": lambda drive: dataflash_text(dataflash(drive, 11)),
    "rover.ulg": lambda drive: ulog(drive, 12),
    "rover.tlog": _tlog,
    "film.srt": lambda drive: srt("enterprise", list(drive.spots())),
}
IN_FILMS = {
    "klv": lambda drive: log_of_klv("film.ts", _klv(drive)),
    "messages": lambda drive: log_of_messages("film.mp4", _messages(drive)),
    "siyi": lambda drive: siyi_log("film.mp4", _cues(drive)),
}
READERS = (*FILES, *IN_FILMS)


def read_as(name: str, drive: Straight, folder: Path) -> VehicleLog:
    """What a reader makes of a drive."""
    if name in IN_FILMS:
        return plausible(IN_FILMS[name](drive))
    return read_written(name, FILES[name](drive), folder)


def read_written(name: str, data: bytes | str, folder: Path) -> VehicleLog:
    """What a reader makes of a file."""
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    (log,) = read_vehicle_logs(folder / name)
    return log
