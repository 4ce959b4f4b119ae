"""The system and component that a frame is addressed to."""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.packet import MAGIC_V2

BROADCAST = (0, 0)
"""Target system and component of a broadcast."""
_MANUAL_CONTROL = 69


def _offset(message: Any, field: str) -> int | None:  # noqa: ANN401  (the dialect's messages carry no types)
    """Offset of a one-byte field in a message's payload, None when it has no such field."""
    names: list[str] = message.ordered_fieldnames
    formats: str = message.native_format.decode()[1:]
    if field not in names:
        return None
    counts: list[int] = [max(1, count) for count in message.array_lengths]
    return sum(struct.calcsize(f"<{formats[i]}") * counts[i] for i in range(names.index(field)))


_OFFSETS: dict[int, tuple[int | None, int | None]] = {
    number: (_offset(message, "target_system"), _offset(message, "target_component"))
    for number, message in ardupilotmega.mavlink_map.items()
    if "target_system" in message.fieldnames
} | {_MANUAL_CONTROL: (_offset(ardupilotmega.mavlink_map[_MANUAL_CONTROL], "target"), None)}


def target_of(raw: bytes) -> tuple[int, int]:
    """System and component that a frame is addressed to; 0 means all.

    Args:
        raw: a good frame of a known message, MAVLink 1 or 2. Trailing zero bytes that MAVLink 2 leaves out read 0.
    """
    v2 = raw[0] == MAGIC_V2
    offsets = _OFFSETS.get(raw[7] | raw[8] << 8 | raw[9] << 16 if v2 else raw[5])
    if offsets is None:
        return BROADCAST
    start, length = (10 if v2 else 6), raw[1]
    system, component = (raw[start + at] if at is not None and at < length else 0 for at in offsets)
    return system, component
