"""Requests for message rates: the interval of one message, or the older streams of many.

Definitions: https://mavlink.io/en/messages/common.html, MAV_CMD_SET_MESSAGE_INTERVAL and REQUEST_DATA_STREAM.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.addressing import target_of
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet

SYSTEM_TIME, GPS_RAW_INT, ATTITUDE, GLOBAL_POSITION_INT, COMMAND_ACK, GIMBAL_ATTITUDE = 2, 24, 30, 33, 77, 285
DISTANCE_SENSOR, TERRAIN_REPORT = 132, 136
STREAMS: Mapping[int, int] = {
    SYSTEM_TIME: 12,
    GPS_RAW_INT: 2,
    ATTITUDE: 10,
    GLOBAL_POSITION_INT: 6,
    GIMBAL_ATTITUDE: 12,
    DISTANCE_SENSOR: 12,
    TERRAIN_REPORT: 12,
}
"""message id → MAV_DATA_STREAM that brings it with ArduPilot."""
PARAMETERS: Mapping[int, str] = {
    SYSTEM_TIME: "EXTRA3",
    GPS_RAW_INT: "EXT_STAT",
    ATTITUDE: "EXTRA1",
    GLOBAL_POSITION_INT: "POSITION",
}
"""message id → end of ArduPilot's parameter for that stream."""
_SET_MESSAGE_INTERVAL = 511


def interval_request(encoder: MavlinkEncoder, system_id: int, message_id: int, hz: float) -> bytes:
    """Request one message of an autopilot."""
    return encoder.pack(
        ardupilotmega.MAVLink_command_long_message(
            system_id, 1, _SET_MESSAGE_INTERVAL, 0, message_id, round(1e6 / hz), 0, 0, 0, 0, 0
        )
    )


def stream_request(encoder: MavlinkEncoder, system_id: int, message_id: int, hz: float) -> bytes:
    """Request the stream that a message belongs to."""
    rate = max(1, math.ceil(hz))
    return encoder.pack(ardupilotmega.MAVLink_request_data_stream_message(system_id, 1, STREAMS[message_id], rate, 1))


def interval_answer(packet: Packet, own: int) -> int | None:
    """MAV_RESULT of a request for an interval, None for answers to other requests or other stations.

    Args:
        own: system id that asked.
    """
    payload = packet.payload.ljust(3, b"\0")
    asker, _ = target_of(packet.raw)
    ours = int.from_bytes(payload[:2], "little") == _SET_MESSAGE_INTERVAL and asker in (0, own)
    return payload[2] if ours else None
