"""Bytes of a good file as hostile hands and bad disks change them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"1e999", b"-0", b"9" * 400, b"0x1f", b"1_0", b"", b"181", b"-1", b"1e18"),
    *(b"9e18", b"9223372036854775808", b"18446744073709551615", b"4294967296", b"true", b'"a"', b"[]", b"null"),
)
WORDS = (b"\0", b"\n", b"\xff\xfe", b"[" * 2000, b"{" * 2000, b'"', b"*a", b"&a [*a]", b"%", b"\x1b[31m", b"../", b"=")
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, (1 << 63) - 1, (1 << 64) - 1)
NUMBER = re.compile(rb"\d+\.?\d*")
Mishap = Callable[[bytes, random.Random], bytes]


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    at = rng.randrange(len(data))
    return at, min(len(data), at + rng.randrange(1, 400))


def _flipped(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 3, 20))):
        changed[rng.randrange(len(changed))] ^= rng.randrange(1, 256)
    return bytes(changed)


def _cut(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return rng.choice((data[:at], data[at:], data[:at] + data[end:], data[at:] + data[:at]))


def _zeroed(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return data[:at] + rng.choice((b"\0", b"\xff")) * (end - at) + data[end:]


def _repeated(data: bytes, rng: random.Random) -> bytes:
    at, end = _span(data, rng)
    return data[:at] + data[at:end] * rng.choice((2, 2, 1000)) + data[end:]


def _extreme(data: bytes, rng: random.Random) -> bytes:
    """A number in the binary, little or big endian, at its largest."""
    size, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
    at = rng.randrange(len(data))
    value = rng.choice(EXTREMES) & ((1 << 8 * size) - 1)
    return data[:at] + value.to_bytes(size, "little" if order == "little" else "big") + data[at + size :]


def _renumbered(data: bytes, rng: random.Random) -> bytes:
    share = rng.choice((0.02, 0.2))
    return NUMBER.sub(lambda found: rng.choice(NUMBERS) if rng.random() < share else found[0], data)


def _shuffled(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    return b"".join(lines)


def _with_words(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + rng.choice(WORDS) + data[at:]


def _recoded(data: bytes, rng: random.Random) -> bytes:
    return data.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-16-be", "cp1252", "utf-7")), "replace")


ANY = (_flipped, _cut, _zeroed, _repeated, _extreme, _flipped, _extreme)
OF_TEXTS = (_renumbered, _renumbered, _shuffled, _with_words, _recoded)


def spoilt(data: bytes, rng: random.Random) -> bytes:
    """A file after one to three mishaps."""
    mishaps: tuple[Mishap, ...] = ANY if b"\0" in data[:1000] else ANY + OF_TEXTS
    for _ in range(rng.randrange(1, 4)):
        if data:
            data = rng.choice(mishaps)(data, rng)
    return data
