"""Subtitles as drones write them, of any path, in every published layout."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Spot:
    """What is known of the UAV at one subtitle; degrees, metres."""

    lat: float
    lon: float
    alt: float
    height: float
    yaw: float = 0.0
    pitch: float = -90.0
    unix_us: int = 0

    def date(self, form: str) -> str:
        return datetime.datetime.fromtimestamp(self.unix_us / 1e6, datetime.UTC).strftime(form)

    @property
    def milli(self) -> int:
        return self.unix_us // 1000 % 1000


def keyed(n: int, s: Spot) -> str:
    """Mini 3, Mavic 3."""
    return (
        f'<font size="28">FrameCnt: {n}, DiffTime: 33ms\n{s.date("%Y-%m-%d %H:%M:%S")}.{s.milli:03d}\n'
        "[iso: 100] [shutter: 1/1000.0] [fnum: 1.7] [ev: 0] [color_md: default] [focal_len: 24.00] "
        f"[latitude: {s.lat:.6f}] [longitude: {s.lon:.6f}] "
        f"[rel_alt: {s.height:.3f} abs_alt: {s.alt:.3f}] [ct: 5660] </font>"
    )


def misspelt(n: int, s: Spot) -> str:
    """Mavic Air 2, Mini 2: one altitude, tenths of millimetres, spaces before colons."""
    return (
        f'<font size="36">SrtCnt : {n}, DiffTime : 33ms\n{s.date("%Y-%m-%d %H:%M:%S")},{s.milli:03d},808\n'
        "[iso : 100] [shutter : 1/320.0] [fnum : 280] [ev : 0] [ct : 5500] [color_md : default] [focal_len : 240] "
        f"[latitude : {s.lat:.6f}] [longtitude : {s.lon:.6f}] [altitude: {s.alt:.6f}] </font>"
    )


def enterprise(n: int, s: Spot) -> str:
    """Mavic 3 Enterprise, Matrice 30."""
    return (
        f'<font size="28">FrameCnt: {n}, DiffTime: 33ms\n{s.date("%Y-%m-%d %H:%M:%S")}.{s.milli:03d}\n'
        "[iso: 170] [shutter: 1/99.77] [fnum: 4.4] [ev: 0] [focal_len: 24.00] [dzoom_ratio: 1.00], "
        f"[latitude: {s.lat:.6f}] [longitude: {s.lon:.6f}] [rel_alt: {s.height:.3f} abs_alt: {s.alt:.3f}] "
        f"[gb_yaw: {s.yaw:.1f} gb_pitch: {s.pitch:.1f} gb_roll: 0.0] </font>"
    )


def old_mavic(n: int, s: Spot) -> str:
    """Phantom 4, first Mavic Pro."""
    return (
        f"HOME({s.lon:.4f},{s.lat:.4f}) {s.date('%Y.%m.%d %H:%M:%S')}\n"
        f"GPS({s.lon:.4f},{s.lat:.4f},14) BAROMETER:{s.height:.1f}\nISO:100 Shutter:60 EV: Fnum:2.2 "
    )


def matrice(n: int, s: Spot) -> str:
    """Matrice 300: the latitude comes first."""
    return f"{s.date('%Y.%m.%d %H:%M:%S')}\nGPS({s.lat:.4f},{s.lon:.4f},0.0M) BAROMETER:{s.height:.1f}M"


def positional(n: int, s: Spot) -> str:
    """Mavic Mini, Mini SE."""
    return (
        f"F/2.8, SS 206.14, ISO 150, EV 0, DZOOM 1.000, GPS ({s.lon:.4f}, {s.lat:.4f}, 10), D 2.80m, "
        f"H {s.height:.2f}m, H.S 0.00m/s, V.S -0.00m/s "
    )


def phantom_rtk(n: int, s: Spot) -> str:
    """Phantom 4 RTK: body and gimbal."""
    return (
        f"F/6.3, SS 60, ISO 100, EV 0, RTK ({s.lon:.6f}, {s.lat:.6f}, 28), "
        f"HOME ({s.lon:.6f}, {s.lat:.6f}, {s.alt - s.height:.2f}m), D 75.36m, H {s.height:.2f}m, H.S 0.30m/s, "
        f"V.S 0.00m/s, F.PRY (-5.3°, 2.1°, {s.yaw:.1f}°), G.PRY ({s.pitch:.1f}°, 0.0°, {s.yaw:.1f}°)"
    )


def autel(n: int, s: Spot) -> str:
    """Evo II: letters for hemispheres, an altitude above the sea."""
    lat, lon = f"{'NS'[int(s.lat < 0.0)]}: {abs(s.lat):.6f}", f"{'EW'[int(s.lon < 0.0)]}: {abs(s.lon):.6f}"
    return (
        f"HOME({lon}, {lat}) {s.date('%Y-%m-%d %H:%M:%S')}\nGPS({lon}, {lat}, {s.alt:.2f}m)\n"
        f"HDR ISO:100 Shutter:1/1000 EV: 0 F-NUM:2.8\n"
        f"F.PRY (1.0°, -3.7°, {s.yaw:.1f}°), G.PRY ({s.pitch:.1f}°, 0.0°, {s.yaw:.1f}°)"
    )


LAYOUTS: dict[str, Callable[[int, Spot], str]] = {
    write.__name__: write for write in (keyed, misspelt, enterprise, old_mavic, matrice, positional, phantom_rtk, autel)
}


def srt(layout: str, spots: list[tuple[float, Spot]], *, end: str = "\n") -> str:
    """A file of subtitles at times in seconds."""
    rows = [
        f"{n}{end}{_time(t)} --> {_time(t + 0.03)}{end}{LAYOUTS[layout](n, s).replace(chr(10), end)}{end}{end}"
        for n, (t, s) in enumerate(spots, 1)
    ]
    return "".join(rows)


def _time(t: float) -> str:
    ms = round(t * 1000.0)
    return f"{ms // 3600000:02d}:{ms // 60000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"
