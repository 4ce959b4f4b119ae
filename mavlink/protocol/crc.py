"""Checksums of frames whose definitions are not in the dialect.

MAVLink's checksum is the X.25 CRC of header and payload with one more byte at the end, the definition's CRC extra:

    c = T[(s ⊕ e) mod 256] ⊕ ⌊s / 256⌋,   s the CRC without the extra, e the extra, T the table of one byte

For given s there are 256 right values of c among 65,536. So a whole frame of an unknown message always has an extra
that makes it right, and damaged bytes have one in a case of 256.

Format: https://mavlink.io/en/guide/serialization.html#checksum
"""

from __future__ import annotations


def _entry(value: int) -> int:
    for _ in range(8):
        value = (value >> 1) ^ 0x8408 if value & 1 else value >> 1
    return value


CRC_TABLE = tuple(_entry(byte) for byte in range(256))
"""T: CRC of one byte from 0 on, polynomial 0x1021 reflected."""

_BYTE_OF = {entry: byte for byte, entry in enumerate(CRC_TABLE)}


def extra_for(state: int, crc: int) -> int:
    """The CRC extra that turns ``state`` into ``crc``, −1 when none of the 256 does."""
    byte = _BYTE_OF.get(crc ^ (state >> 8))
    return -1 if byte is None else byte ^ (state & 0xFF)
