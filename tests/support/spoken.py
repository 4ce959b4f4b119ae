"""Frames to and from a station that speaks."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet

UAV, UGV = MavlinkEncoder(1), MavlinkEncoder(7)
PARSER = dialect.MAVLink(None)


def message(raw: bytes):
    (parsed,) = PARSER.parse_buffer(raw)
    return parsed


def packet(raw: bytes, *, link: int = 0, t_us: int = 1_000_000, auth: Auth = Auth.OPEN, peer: int = 1) -> Packet:
    return Packet(t_us, raw, link, peer, auth)
