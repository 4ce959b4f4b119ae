"""A socket filter in the kernel: known senders pass, or a random share of them; of all others a random share.

A datagram that the filter drops costs no memory and no time of this process, so a flood cannot push others out of the
socket's buffer. A sender is known by source address and the system id in its frames: other datagrams from that
address, which can be forged, count as unknown. Unknown datagrams are of two classes: those whose size agrees with their
MAVLink header, and the rest, which is junk or several frames at once.

Reference: Linux networking/filter.rst (classic BPF, SO_ATTACH_FILTER, SKF_AD_RANDOM).
"""

from __future__ import annotations

import ctypes
import socket
import struct
from collections.abc import Iterable, Mapping

from mavlink.links.batch import MIXED

FilterSource = tuple[int, int, int]
"""IPv4 address and port as numbers, and the system id or :data:`mavlink.links.batch.MIXED`."""

_SO_ATTACH_FILTER, _SO_DETACH_FILTER = 26, 27
_INSTRUCTION = struct.Struct("=HBBI")
_PROGRAM = struct.Struct("@HP")
_MAX_INSTRUCTIONS = 4096  # instructions that the kernel takes
_MAX_JUMP = 200  # a condition jumps over 255 instructions at most
_HASH_IP, _HASH_KIND = 0x9E3779B1, 0x85EBCA6B
_KIND = 0  # place in the filter's memory
_LOAD_NUMBER, _LOAD_MEMORY, _STORE = 0x00, 0x60, 0x02
_LOAD, _LOAD_HALF, _LOAD_BYTE, _LOAD_LENGTH = 0x20, 0x28, 0x30, 0x80
_JUMP, _IF_EQUAL, _IF_MORE, _IF_AT_LEAST = 0x05, 0x15, 0x25, 0x35
_TIMES, _PLUS_X, _MINUS_X, _TO_X, _RETURN = 0x24, 0x0C, 0x1C, 0x07, 0x06
_SOURCE_IP = 0xFFF00000 + 12  # SKF_NET_OFF, the address in the IP header
_RANDOM = 0xFFFFF000 + 56  # SKF_AD_OFF + SKF_AD_RANDOM
_PASS, _REFUSE = 0xFFFFFFFF, 0
# Offsets from the UDP header on, which is eight bytes long.
_SOURCE_PORT, _MAGIC, _PAYLOAD_LENGTH, _FLAGS = 0, 8, 9, 10
_SYSTEM_V1, _SYSTEM_V2 = 8 + 3, 8 + 5
_FIXED_V1, _FIXED_V2, _SIGNATURE = 8 + 8, 8 + 12, 13

_Code = list[tuple[int, int, int, int]]
_KEY: _Code = [
    # the kind is that of a datagram that is not exactly one frame …
    (_LOAD_NUMBER, 0, 0, MIXED),
    (_STORE, 0, 0, _KIND),
    (_LOAD_LENGTH, 0, 0, 0),
    (_IF_AT_LEAST, 0, 23, _FIXED_V1),
    (_LOAD_BYTE, 0, 0, _MAGIC),
    (_IF_EQUAL, 1, 0, 0xFD),
    (_IF_EQUAL, 13, 20, 0xFE),
    # … or, for MAVLink 2 where datagram − payload − 13 · signed = 20, the system id
    (_LOAD_BYTE, 0, 0, _FLAGS),
    (_IF_MORE, 18, 0, 1),
    (_TIMES, 0, 0, _SIGNATURE),
    (_TO_X, 0, 0, 0),
    (_LOAD_BYTE, 0, 0, _PAYLOAD_LENGTH),
    (_PLUS_X, 0, 0, 0),
    (_TO_X, 0, 0, 0),
    (_LOAD_LENGTH, 0, 0, 0),
    (_MINUS_X, 0, 0, 0),
    (_IF_EQUAL, 0, 10, _FIXED_V2),
    (_LOAD_BYTE, 0, 0, _SYSTEM_V2),
    (_STORE, 0, 0, _KIND),
    (_JUMP, 0, 0, 7),
    # … or, for MAVLink 1 where datagram − payload = 16, the system id
    (_LOAD_BYTE, 0, 0, _PAYLOAD_LENGTH),
    (_TO_X, 0, 0, 0),
    (_LOAD_LENGTH, 0, 0, 0),
    (_MINUS_X, 0, 0, 0),
    (_IF_EQUAL, 0, 2, _FIXED_V1),
    (_LOAD_BYTE, 0, 0, _SYSTEM_V1),
    (_STORE, 0, 0, _KIND),
    # A = ip · odd + port + kind · another odd
    (_LOAD_HALF, 0, 0, _SOURCE_PORT),
    (_TO_X, 0, 0, 0),
    (_LOAD, 0, 0, _SOURCE_IP),
    (_TIMES, 0, 0, _HASH_IP),
    (_PLUS_X, 0, 0, 0),
    (_TO_X, 0, 0, 0),
    (_LOAD_MEMORY, 0, 0, _KIND),
    (_TIMES, 0, 0, _HASH_KIND),
    (_PLUS_X, 0, 0, 0),
]


def program(known: Iterable[FilterSource], own: Mapping[FilterSource, float], likely: float, other: float) -> bytes:
    """The filter's instructions.

    Args:
        own: senders of whose datagrams a share passes, 0..1.
        likely: share of unknown datagrams that pass if they look like one MAVLink frame, 0..1.
        other: share of other unknown datagrams that pass, 0..1.

    Raises:
        ValueError: more instructions than the kernel takes.
    """
    shares = {_hash(*source): share for source, share in own.items()}
    code = [*_KEY]
    for key, share in sorted(shares.items()):
        share_code = _pass_share(share)
        code += [(_IF_EQUAL, 0, len(share_code), key), *share_code]
    code += _pass_known(sorted({_hash(*source) for source in known} - shares.keys()))
    code += [
        (_LOAD_MEMORY, 0, 0, _KIND),
        (_IF_EQUAL, 0, len(_pass_share(other)), MIXED),
        *_pass_share(other),
        *_pass_share(likely),
    ]
    if len(code) > _MAX_INSTRUCTIONS:
        raise ValueError(f"{len(code)} instructions are more than the {_MAX_INSTRUCTIONS} that the kernel takes")
    return b"".join(_INSTRUCTION.pack(*step) for step in code)


def _hash(ip: int, port: int, kind: int) -> int:
    """A 32-bit hash (ip · odd + port + kind · another odd). Collisions do no harm: who can send from a chosen address
    can forge the known one as well."""
    return (ip * _HASH_IP + port + kind * _HASH_KIND) & 0xFFFFFFFF


def _pass_known(keys: list[int]) -> _Code:
    """Code that lets datagrams with one of these hashes pass."""
    code: _Code = []
    for start in range(0, len(keys), _MAX_JUMP):
        block = keys[start : start + _MAX_JUMP]
        code += [(_IF_EQUAL, len(block) - k, 0, key) for k, key in enumerate(block)]
        code += [(_JUMP, 0, 0, 1), (_RETURN, 0, 0, _PASS)]
    return code


def _pass_share(share: float) -> _Code:
    """Code that lets a random share pass."""
    below = round(share * 2.0**32)
    if below > 0xFFFFFFFF:
        return [(_RETURN, 0, 0, _PASS)]
    return [(_LOAD, 0, 0, _RANDOM), (_IF_AT_LEAST, 1, 0, below), (_RETURN, 0, 0, _PASS), (_RETURN, 0, 0, _REFUSE)]


def attach(sock: socket.socket, code: bytes) -> None:
    """Put a filter on a socket, in place of the one before.

    Raises:
        OSError: the system has no such filters, or does not take this one.
    """
    memory = ctypes.create_string_buffer(code, len(code))
    described = _PROGRAM.pack(len(code) // _INSTRUCTION.size, ctypes.addressof(memory))
    sock.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, described)


def detach(sock: socket.socket) -> None:
    """Take the filter off; without one this does nothing."""
    try:
        sock.setsockopt(socket.SOL_SOCKET, _SO_DETACH_FILTER, 0)
    except OSError:
        return  # there was none
