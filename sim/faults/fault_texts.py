"""Texts and datagrams of hostile or broken senders."""

from __future__ import annotations

import random
from typing import Final

__all__ = ["BOOT_WORDS", "HOSTILE_TEXTS", "poison"]

HOSTILE_TEXTS: Final = (
    "[/x]",
    "[@click=app.quit]x[/]",
    "[bold red]x[/bold red] [link=http://x]y[/link]",
    "\x1b[2J\x1b]0;pwned\x07\x1b[31mred",
    "\x1b]52;c;cm0gLXJmIH4=\x07clipboard",
    "\x1bPq#0;2;0;0;0#0~~@@vv\x1b\\sixel",
    "\x9b31mC1 \x90\x9d0;t\x9c",
    "a\r\nb\tc\x00d\x08\x08\x7f",
    "\u202eesrever\u2066 \u2069\u200f",
    "zero\u200bwidth\u200d\u2060\ufeff\u00ad",
    "\U0001f916\U0001f468\u200d\U0001f469\u200d\U0001f467 \u6f22\u5b57 e\u0301\u0323\u0308",
    "\U000e0041\U000e0042 tags \ue000\U0010ffff",
    "{}%s{0}$(x)`x`\\'\"<>&;|",
    "W" * 50,
)
"""Each goes into a STATUSTEXT as its first 50 bytes of UTF-8."""

BOOT_WORDS: Final = (b"\n\nInit ArduRover V4.6.0\n\nFree RAM: 131072\n", b"Init Gyro", b"*", b"0 ")
"""Plain text, as autopilots send it before their first packet."""


def poison(rng: random.Random, good: bytes) -> bytes:
    """One datagram that is no frame: headers without a body, noise, text, a frame cut short or with a bit turned.

    Args:
        rng: chooses.
        good: a whole frame to spoil.
    """
    kind = rng.randrange(6)
    if kind == 0:
        return bytes([0xFD, 0xFF, rng.randrange(2)])
    if kind == 1:
        return rng.randbytes(rng.randrange(1, 300))
    if kind == 2:
        return rng.choice(BOOT_WORDS)
    if kind == 3:
        return good[: rng.randrange(1, len(good))]
    if kind == 4:
        return b"\xfd\xff\x00\x00" * rng.randrange(1, 300)
    bit = rng.randrange(8 * 10, 8 * len(good))
    spoilt = bytearray(good)
    spoilt[bit >> 3] ^= 1 << (bit & 7)
    return bytes(spoilt)
