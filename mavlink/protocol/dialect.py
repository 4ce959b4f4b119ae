"""Message definitions: lengths, CRC extras and names of the ardupilotmega dialect, as plain tables."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega

DEFINITIONS: dict[int, tuple[int, int]] = {
    message_id: (message.unpacker.size, message.crc_extra) for message_id, message in ardupilotmega.mavlink_map.items()
}
"""message id → (full payload length with extensions in bytes, CRC extra)."""
HEARTBEAT: int = ardupilotmega.MAVLINK_MSG_ID_HEARTBEAT
RADIO_STATUS: int = ardupilotmega.MAVLINK_MSG_ID_RADIO_STATUS
SETUP_SIGNING: int = ardupilotmega.MAVLINK_MSG_ID_SETUP_SIGNING
TIMESYNC: int = ardupilotmega.MAVLINK_MSG_ID_TIMESYNC


def message_name(message_id: int) -> str:
    """Name of a message, ``UNKNOWN_<id>`` when the dialect does not have it."""
    message = ardupilotmega.mavlink_map.get(message_id)
    return str(message.msgname) if message is not None else f"UNKNOWN_{message_id}"
