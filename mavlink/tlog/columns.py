"""Messages of one kind as a numpy structured array, straight from a log's bytes."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.errors import TlogError
from mavlink.protocol.packet import MAGIC_V2
from mavlink.tlog.scan import Bytes, Ints, gather

__all__ = ["message_dtype", "message_number", "read_columns"]


def message_number(name: str) -> int:
    """Number of a message by its name.

    Raises:
        TlogError: the dialect has no such message.
    """
    for number, message in ardupilotmega.mavlink_map.items():
        if message.msgname == name:
            return int(number)
    raise TlogError(f"message {name!r}: not in the ardupilotmega dialect; names are as in GLOBAL_POSITION_INT")


@cache
def message_dtype(message_id: int) -> np.dtype[np.void]:
    """Packed dtype of a message's payload with all extensions, fields in wire order under their own names.

    Raises:
        TlogError: the dialect has no such message.
    """
    message = ardupilotmega.mavlink_map.get(message_id)
    if message is None:
        raise TlogError(f"message {message_id}: not in the ardupilotmega dialect")
    fields = []
    for name in message.ordered_fieldnames:
        position = message.fieldnames.index(name)
        count = message.array_lengths[message.ordered_fieldnames.index(name)]
        kind = message.fieldtypes[position]
        fields.append((name, *_field(kind, count)))
    dtype = np.dtype(fields)
    if dtype.itemsize != message.unpacker.size:
        raise TlogError(f"message {message_id}: its definition has {message.unpacker.size} bytes, not {dtype.itemsize}")
    return dtype


def _field(kind: str, count: int) -> tuple[str] | tuple[str, tuple[int]]:
    """numpy type of a field; text is bytes, cut at NUL by numpy."""
    if kind == "char":
        return (f"S{max(count, 1)}",)
    code = {"uint8_t_mavlink_version": "u1", "float": "<f4", "double": "<f8"}.get(kind)
    if code is None:
        sign = "u" if kind.startswith("u") else "i"
        bits = int(kind.removeprefix("u").removeprefix("int").removesuffix("_t"))
        code = f"<{sign}{bits // 8}"
    return (code, (count,)) if count else (code,)


def read_columns(data: Bytes, offset: Ints, message_id: int) -> NDArray[np.void]:
    """Payloads of the frames at these offsets, which must all be of this message and undamaged.

    Args:
        data: (size,) the file.
        offset: (n,) where the frames begin.
        message_id: their message.

    Returns:
        (n,) structured array; bytes that MAVLink 2 left out are zero.

    Raises:
        TlogError: the dialect has no such message.
    """
    dtype = message_dtype(message_id)
    payload = np.zeros((offset.size, dtype.itemsize), dtype=np.uint8)
    if offset.size:
        start = offset + np.where(data[offset] == MAGIC_V2, 10, 6)
        length = data[offset + 1]
        for width in np.unique(length):
            if width:
                chosen = length == width
                payload[chosen, :width] = gather(data, start[chosen], int(width))
    return payload.view(dtype).ravel()
