"""MISB ST 0601: which whole numbers stand for which values, and how a set is put together.

A set is a 16 byte key, its length (BER), items of tag (BER-OID), length, value. Time comes first, last a checksum:
the sum of all before its value as 16 bit words. Values: degrees, metres, Unix µs. Reference: MISB ST 0601.17.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

SETS_KEY: Final = bytes.fromhex("060e2b34020b01010e01030101000000")
CHECKSUM: Final = 1
TIME: Final = 2
VERSION: Final = 65
"""Tag of the standard's own number."""
MAX_TEXT: Final = 127
"""Longest text, bytes."""
_ST_0601: Final = b"\x11"

UNSIGNED: Final[Mapping[int, tuple[int, float, float]]] = {
    5: (2, 0.0, 360.0),
    15: (2, -900.0, 19_000.0),
    16: (2, 0.0, 180.0),
    17: (2, 0.0, 180.0),
    18: (4, 0.0, 360.0),
    20: (4, 0.0, 360.0),
    21: (4, 0.0, 5_000_000.0),
    25: (2, -900.0, 19_000.0),
}
"""Tag: bytes, and the values of the least and the largest whole number.

5 heading of the platform; 15 altitude of the sensor; 16 and 17 its field of view across and down; 18 and 20 its azimuth
and roll from the platform; 21 slant range; 25 elevation of the picture's centre on the ground.
"""
SIGNED: Final[Mapping[int, tuple[int, float]]] = {
    6: (2, 20.0),
    7: (2, 50.0),
    13: (4, 90.0),
    14: (4, 180.0),
    19: (4, 180.0),
    23: (4, 90.0),
    24: (4, 180.0),
    **{tag: (4, 90.0 if tag % 2 == 0 else 180.0) for tag in range(82, 90)},
    90: (4, 90.0),
    91: (4, 90.0),
}
"""Tag: bytes, and the value of the largest whole number; the least stands for unknown.

6 and 7 pitch and roll of the platform, 90 and 91 the same over their full range; 13 and 14 latitude and longitude of
the sensor; 19 its elevation from the platform; 23 and 24 the picture's centre on the ground; 82–89 its corners there,
upper left first, clockwise.
"""


def klv_set(t_us: int, values: Mapping[int, float], texts: Mapping[int, str] | None = None) -> bytes:
    """A whole set.

    Args:
        t_us: when what it tells was so.
        values: of the tags above; those that are unknown or that their tag cannot hold are left out.
        texts: of tags of plain text, cut to 127 bytes.
    """
    items = [(TIME, t_us.to_bytes(8, "big"))]
    items += [(tag, _text(text)) for tag, text in (texts or {}).items() if text]
    items += [(tag, raw) for tag, value in sorted(values.items()) if (raw := _raw(tag, value)) is not None]
    items.append((VERSION, _ST_0601))
    # the checksum's own tag and length are summed up, too
    body = b"".join(_item(tag, raw) for tag, raw in items) + bytes([CHECKSUM, 2])
    data = SETS_KEY + _length(len(body) + 2) + body
    return data + checksum(data).to_bytes(2, "big")


def checksum(data: Iterable[int]) -> int:
    """Checksum of all bytes of a set before the checksum's value."""
    data = bytes(data)
    return (sum(data[::2]) << 8) + sum(data[1::2]) & 0xFFFF


def _raw(tag: int, value: float) -> bytes | None:
    if not math.isfinite(value):
        return None
    if tag in UNSIGNED:
        size, least, largest = UNSIGNED[tag]
        if not least <= value <= largest:
            return None
        return round((value - least) / (largest - least) * ((1 << 8 * size) - 1)).to_bytes(size, "big")
    size, largest = SIGNED[tag]
    if abs(value) > largest:
        return None
    return round(value / largest * ((1 << 8 * size - 1) - 1)).to_bytes(size, "big", signed=True)


def _text(text: str) -> bytes:
    """Cut a text without leaving half a character at the end."""
    return text.encode()[:MAX_TEXT].decode(errors="ignore").encode()


def _item(tag: int, raw: bytes) -> bytes:
    return bytes([tag]) + _length(len(raw)) + raw


def _length(size: int) -> bytes:
    """BER: one byte up to 127, else how many bytes follow."""
    if size < 128:
        return bytes([size])
    raw = size.to_bytes((size.bit_length() + 7) // 8, "big")
    return bytes([128 + len(raw)]) + raw
