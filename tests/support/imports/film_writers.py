"""A film with telemetry in it: KLV beside the pictures, messages among them, subtitles; pictures stay as they are."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.support.imports.flown import FOV_DEG, Flown
from tests.support.imports.log_writers import wire_attitudes
from tests.support.imports.srt_writers import LAYOUTS, Spot

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
UUID = bytes.fromhex("8d646b4e556f4a908b7c35e629510321")
ASS = (
    b"[Script Info]\nScriptType: v4.00+\n[V4+ Styles]\nFormat: Name, Fontname, Fontsize, PrimaryColour\n"
    b"Style: Default,Arial,16,&Hffffff\n[Events]\nFormat: Layer, Start, End, Style, Text\n"
)
"""What FFmpeg wants to know before it opens an encoder of subtitles."""


def klv_set(
    spot: Spot, body_deg: tuple[float, float, float], *, elevation_deg: float = -90.0, height_tag: int = 15
) -> bytes:
    """A set of ST 0601: time, platform, sensor; tag 75 instead of 15 tells the height above the ellipsoid."""
    roll, pitch, heading = body_deg

    def unsigned(value: float, least: float, largest: float, size: int) -> bytes:
        return round((value - least) / (largest - least) * (256**size - 1)).to_bytes(size, "big")

    def signed(value: float, largest: float, size: int) -> bytes:
        return round(value / largest * (256**size // 2 - 1)).to_bytes(size, "big", signed=True)

    items = {
        2: spot.unix_us.to_bytes(8, "big"),
        3: b"MISSION01",
        5: unsigned(heading % 360.0, 0.0, 360.0, 2),
        6: signed(pitch, 20.0, 2),
        7: signed(roll, 50.0, 2),
        13: signed(spot.lat, 90.0, 4),
        14: signed(spot.lon, 180.0, 4),
        height_tag: unsigned(spot.alt, -900.0, 19000.0, 2),
        16: unsigned(FOV_DEG, 0.0, 180.0, 2),
        18: unsigned(0.0, 0.0, 360.0, 4),
        19: signed(elevation_deg, 180.0, 4),
        20: unsigned(0.0, 0.0, 360.0, 4),
    }
    value = b"".join(bytes([tag, len(raw)]) + raw for tag, raw in items.items()) + b"\x01\x02"
    length = len(value) + 2
    data = KEY + (bytes([length]) if length < 128 else bytes([0x81, length])) + value
    padded = data + b"\0" * (len(data) % 2)
    return data + (sum(struct.unpack(f">{len(padded) // 2}H", padded)) & 0xFFFF).to_bytes(2, "big")


def bodies_deg(flown: Flown) -> np.ndarray:
    """Roll, pitch, yaw of the UAV at each frame."""
    at_us, angles = wire_attitudes(flown, 1)
    return np.degrees(np.column_stack([np.interp(flown.frames_us, at_us, np.unwrap(column)) for column in angles.T]))


def with_klv(flown: Flown, out: Path) -> Path:
    """MPEG-TS with a set at each frame; the camera hangs in a gimbal that looks straight down."""
    bodies, spots = bodies_deg(flown), flown.spots()

    def of_frame(k: int) -> bytes:
        # a sensor that stays level under a platform that rolls: its own angles are those that undo the platform's
        return klv_set(spots[k][1], (0.0, 0.0, float(bodies[k][2])))

    return _remuxed(flown, out, beside=("klv", of_frame))


def telemetry(flown: Flown, k: int, spot: Spot, body_deg: np.ndarray) -> dict[str, object]:
    """AP_CameraGimbal's record of a frame."""
    roll, pitch, yaw = (math.radians(angle) for angle in body_deg)
    return {
        "schema": "apcg.telemetry.v1",
        "pts90k": k * 9000,
        "utc_us": spot.unix_us,
        "position": {
            "lat_e7": round(spot.lat * 1e7),
            "lon_e7": round(spot.lon * 1e7),
            "alt_amsl_m": spot.alt,
            "alt_relative_m": spot.height,
            "age_ms": 20,
        },
        "velocity": None,
        "vehicle_attitude": {"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw, "age_ms": 5},
        "gimbal_attitude": {"roll_rad": 0.0, "pitch_rad": -math.pi / 2, "yaw_rad": 0.0, "age_ms": 5},
        "heading_rad": yaw,
        "zoom": 1.0,
        "hfov_deg": FOV_DEG,
    }


def sei_unit(payload: bytes) -> bytes:
    """An H.264 unit of user data: UUID and text, with the bytes that would look like a start code escaped."""
    raw = b"\x05" + b"\xff" * (len(payload) // 255) + bytes([len(payload) % 255]) + payload + b"\x80"
    escaped, zeros = bytearray(b"\x06"), 0
    for byte in raw:
        if zeros >= 2 and byte <= 3:
            escaped.append(3)
            zeros = 0
        escaped.append(byte)
        zeros = zeros + 1 if byte == 0 else 0
    return bytes(escaped)


def with_sei(flown: Flown, out: Path) -> Path:
    """MP4 with a message in front of each picture."""
    bodies, spots = bodies_deg(flown), flown.spots()

    def of_frame(k: int) -> bytes:
        unit = sei_unit(UUID + json.dumps(telemetry(flown, k, spots[k][1], bodies[k])).encode())
        return len(unit).to_bytes(4, "big") + unit

    return _remuxed(flown, out, among=of_frame)


def siyi(k: int, spot: Spot) -> str:
    """SIYI's subtitle: hemispheres, degrees, minutes and seconds to 0.1″; the height repeats the altitude."""

    def angle(value: float, sides: str) -> str:
        tenths = round(abs(value) * 36000)
        return f"{sides[int(value < 0)]}{tenths // 36000}°{tenths // 600 % 60}′{tenths % 600 / 10:.1f}″"

    return (
        f"{spot.date('%Y-%m-%d_%H-%M-%S')} stream->FrameCnt:{k}\nfocal_len:4.500000mm\nmix_ratio:1.000000\n"
        f"dig_ratio:1.000000\nfnum:2.800000\nlatitude:{angle(spot.lat, 'NS')}\nlongitude:{angle(spot.lon, 'EW')}\n"
        f"rel_alt:{spot.alt:.6f}\nabs_alt:{spot.alt:.6f}\ngb_yaw:0.0, gb_pitch:-90.0, gb_roll:0.0\n"
    )


def with_subtitles(flown: Flown, out: Path, layout: str) -> Path:
    """MP4 or Matroska with a track of subtitles."""
    spots, write = flown.spots(), siyi if layout == "siyi" else LAYOUTS[layout]
    codec, head = ("mov_text", True) if out.suffix == ".mp4" else ("subrip", False)

    def of_frame(k: int) -> bytes:
        text = write(k, spots[k][1]).encode()
        return len(text).to_bytes(2, "big") + text if head else text

    return _remuxed(flown, out, beside=(codec, of_frame))


def _remuxed(
    flown: Flown,
    out: Path,
    *,
    beside: tuple[str, Callable[[int], bytes]] | None = None,
    among: Callable[[int], bytes] | None = None,
) -> Path:
    with av.open(str(flown.video)) as old, av.open(str(out), "w") as new:
        video = old.streams.video[0]
        copied = new.add_stream_from_template(video)
        other = None
        if beside and beside[0] == "klv":
            other = new.add_data_stream("klv")
        elif beside:
            other = new.add_stream(beside[0])
            other.codec_context.subtitle_header = ASS
            other.time_base = Fraction(1, 1000)
        packets = [packet for packet in old.demux(video) if packet.dts is not None]
        order = {pts: k for k, pts in enumerate(sorted(packet.pts for packet in packets))}
        for packet in packets:
            k, t = order[packet.pts], packet.pts * packet.time_base
            if among:
                changed = av.Packet(among(k) + bytes(packet))
                changed.pts, changed.dts, changed.time_base = packet.pts, packet.dts, packet.time_base
                changed.duration, changed.is_keyframe = packet.duration, packet.is_keyframe
                packet = changed
            packet.stream = copied
            new.mux(packet)
            if other is not None and beside:
                extra = av.Packet(beside[1](k))
                extra.stream, extra.time_base = other, Fraction(1, 90_000)
                extra.pts = extra.dts = round(t * 90_000)
                extra.duration = 900
                new.mux(extra)
    return out
