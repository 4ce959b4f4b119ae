"""The bundled recordings, and copies of them: shorter, without some files, or with other telemetry."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from pathlib import Path

import av

from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog

ROOT = Path(__file__).parents[2]
"""The repository's root."""


SWARM = ROOT / "sitl_logs" / "ardupilot-swarm"
"""A minute of pictures, ten a second; its telemetry begins 15 s earlier."""
CURVED_ROAD = ROOT / "sitl_logs" / "curved-road"


def shortened(session: Path, folder: Path, frames: int) -> Path:
    """A copy of a recording that ends after so many frames."""
    folder.mkdir(exist_ok=True)
    for path in session.iterdir():
        if path.suffix == ".csv":
            header, *rows = path.read_text().splitlines()
            kept = [row for row in rows if int(row.split(",")[0]) < frames]
            (folder / path.name).write_text("\n".join([header, *kept]))
        elif path.suffix == ".mp4":
            _shorten_video(path, folder / path.name, frames)
        else:
            (folder / path.name).write_bytes(path.read_bytes())
    last_us = int((folder / "frames.csv").read_text().splitlines()[-1].split(",")[1])
    (folder / "telemetry.tlog").unlink()
    Tlog.open(session / "telemetry.tlog").cut(folder / "telemetry.tlog", None, last_us + 1_000_000)
    return folder


def swarm_session(
    tmp_path: Path,
    *,
    frames: int = 150,
    without: Iterable[str] = (),
    toml: Callable[[str], str] = str,
    tlog: Callable[[bytes], bytes] = bytes,
) -> Path:
    """The beginning of the swarm, 15 seconds of pictures or fewer, with its telemetry up to then.

    Args:
        tmp_path: where the session's folder is made.
        frames: so many, ten a second.
        without: files that are left out.
        toml: what becomes of session.toml.
        tlog: what becomes of the telemetry.
    """
    folder = shortened(SWARM, tmp_path / "session", frames)
    (folder / "session.toml").write_text(toml((SWARM / "session.toml").read_text()))
    (folder / "telemetry.tlog").write_bytes(tlog((folder / "telemetry.tlog").read_bytes()))
    for name in without:
        (folder / name).unlink()
    return folder


def _shorten_video(source: Path, target: Path, frames: int) -> None:
    with av.open(str(source)) as old, av.open(str(target), "w") as new:
        stream = old.streams.video[0]
        copied = new.add_stream_from_template(stream)
        packets = [packet for packet in old.demux(stream) if packet.dts is not None]
        for packet in packets[:frames]:
            packet.stream = copied
            new.mux(packet)


def with_packets(session: Path, folder: Path, edit: Callable[[Packet], Iterable[Packet]]) -> Path:
    """A copy of a recording whose telemetry is, packet by packet, what ``edit`` makes of it, in order of time."""
    folder.mkdir(exist_ok=True)
    for path in session.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    packets = [new for packet in Tlog.open(session / "telemetry.tlog").packets() for new in edit(packet)]
    packets.sort(key=lambda packet: packet.t_us)
    records = (struct.pack(">Q", packet.t_us) + packet.raw for packet in packets)
    (folder / "telemetry.tlog").write_bytes(b"".join(records))
    return folder


def with_payload(raw: bytes, change: Callable[[bytearray], None]) -> bytes:
    """A MAVLink 2 frame whose payload was changed; its checksum is right."""
    payload = bytearray(raw[10 : 10 + raw[1]])
    change(payload)
    return _with_checksum(raw[:10] + bytes(payload))


def with_sender(raw: bytes, system_id: int) -> bytes:
    """A MAVLink 2 frame as if another system had sent it."""
    return _with_checksum(raw[:5] + bytes([system_id]) + raw[6 : 10 + raw[1]])


def _with_checksum(body: bytes) -> bytes:
    extra = DEFINITIONS[int.from_bytes(body[7:10], "little")][1]
    return body + struct.pack("<H", checksum(body, extra))
