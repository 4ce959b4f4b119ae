"""Who sends to a UDP port: numbers for all whose frames are kept, and trust for those whose frames were good.

Both tables are bounded. Where trust is full it goes to those who have been heard most often: a crowd that comes with
one good frame each pushes out its own.
"""

from __future__ import annotations

import socket
import struct
from collections import Counter
from collections.abc import Mapping, Set
from dataclasses import dataclass
from itertools import islice

__all__ = ["Peers", "key_of"]

TRUSTED = 256
NUMBERED = 4096
TOLD = 32
QUIET_US = 60_000_000
"""Trust ends when nothing good was heard for this long."""
BAD_A_LOOK = 100
"""Datagrams without a good frame, between two reviews, that cost trust."""
BARRED_US = 10_000_000
"""For how long such a sender is not trusted again."""
_KEY = struct.Struct("=q")
_SENDER = struct.Struct("=H2s4s")


def key_of(address: tuple[str, int]) -> int:
    """An IPv4 address and port as the first eight bytes of the system's sockaddr_in, in one number."""
    host, port = address
    packed = _SENDER.pack(socket.AF_INET, port.to_bytes(2, "big"), socket.inet_aton(host))
    return int(_KEY.unpack(packed)[0])


def _dotted(host: int) -> str:
    return socket.inet_ntoa(host.to_bytes(4, "big"))


@dataclass(slots=True)
class _Trust:
    heard_us: int
    times: int = 0
    """Reviews before which it was heard."""


class Peers:
    """Senders of one port, by the number that their packets carry."""

    def __init__(self) -> None:
        self.numbers: dict[int, int] = {}
        """Sender (:func:`key_of`) → number, from 1."""
        self.trusted: dict[int, _Trust] = {}
        """Number → since when; look-ups of a number say whether it is trusted."""
        self.changes = 0
        """Grows whenever the set of those trusted changes."""
        self._keys: dict[int, int] = {}
        self._last = 0
        self._bad: Counter[int] = Counter()
        self._heard: set[int] = set()
        self._told: tuple[int, dict[int, tuple[str, int]]] = (-1, {})
        self._barred: dict[int, int] = {}

    def number(self, key: int) -> int:
        """A sender's number; a new one if it has none."""
        known = self.numbers.get(key)
        if known is not None:
            return known
        if len(self.numbers) >= NUMBERED:
            self._forget_one()
        self._last += 1
        self.numbers[key] = self._last
        self._keys[self._last] = key
        return self._last

    def trust(self, numbers: Set[int], t_us: int) -> None:
        """These have just sent good frames."""
        self._heard |= numbers
        for number in numbers - self.trusted.keys():
            if number not in self._keys or number in self._barred:
                continue  # forgotten meanwhile, or not to be trusted
            if len(self.trusted) >= TRUSTED:
                self._drop(min(self.trusted, key=lambda other: self.trusted[other].times))
            self.trusted[number] = _Trust(t_us)
            self.changes += 1

    def misbehaved(self, number: int) -> None:
        """One who is trusted sent a datagram without a good frame."""
        self._bad[number] += 1

    def review(self, t_us: int) -> None:
        """Ends the trust in those who are silent and in those who send junk in masses."""
        for number in self._heard & self.trusted.keys():
            self.trusted[number].heard_us = t_us
            self.trusted[number].times += 1
        self._heard.clear()
        for number in [n for n, until_us in self._barred.items() if until_us <= t_us]:
            del self._barred[number]
        for number, bad in self._bad.items():
            if bad >= BAD_A_LOOK:
                self._drop(number)
                self._barred[number] = t_us + BARRED_US
        self._bad.clear()
        for number in [n for n, entry in self.trusted.items() if t_us - entry.heard_us > QUIET_US]:
            self._drop(number)

    def adopt(self, known: Mapping[int, tuple[str, int]], last: int, t_us: int) -> None:
        """Goes on with the numbers, and the trust, of a table that ended without notice.

        Args:
            known: number → address of those who were trusted.
            last: highest number ever given.
            t_us: now.
        """
        for number, address in known.items():
            key = key_of(address)
            self.numbers[key], self._keys[number] = number, key
        self.trust(known.keys(), t_us)
        self._last = max(self._last, last, *known.keys())

    @property
    def last(self) -> int:
        """Highest number given so far."""
        return self._last

    def addresses(self) -> dict[int, tuple[str, int]]:
        """Number → address of those who are trusted, as sockets take them."""
        if self._told[0] != self.changes:
            hosts = ((_dotted(host), port) for host, port in self.senders())
            self._told = self.changes, dict(zip(list(self.trusted), hosts, strict=True))
        return self._told[1]

    def strangers(self) -> dict[int, str]:
        """Number → host and port of the latest who are not trusted, to tell an operator."""
        latest = (number for number in reversed(self.numbers.values()) if number not in self.trusted)
        return {number: self.address(number) for number in islice(latest, TOLD)}

    def address(self, number: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        if number not in self._keys:
            return ""
        host, port = self._sender(number)
        return f"{_dotted(host)}:{port}"

    def senders(self) -> list[tuple[int, int]]:
        """Addresses and ports of those who are trusted, as numbers."""
        return [self._sender(number) for number in list(self.trusted)]

    def _sender(self, number: int) -> tuple[int, int]:
        _, port, host = _SENDER.unpack(_KEY.pack(self._keys[number]))
        return int.from_bytes(host, "big"), int.from_bytes(port, "big")

    def _drop(self, number: int) -> None:
        if self.trusted.pop(number, None) is not None:
            self.changes += 1

    def _forget_one(self) -> None:
        """The oldest who is not trusted; there always is one, as more are numbered than trusted."""
        key = next(key for key, number in self.numbers.items() if number not in self.trusted)
        del self._keys[self.numbers.pop(key)]
