"""Who sends to a UDP port: numbers for the addresses of all whose frames are kept, and trust for what has proved good.

A source address can be forged, so trust is in what comes from an address under one system id, never in all that comes
from there, and nothing that only claims to come from there ends it. All tables are bounded, and of one system only a
few addresses are trusted, those heard most often: a crowd that speaks in its name pushes out its own.
"""

from __future__ import annotations

import socket
import struct
from collections import Counter, OrderedDict
from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass
from itertools import islice

from mavlink.links.batch import MIXED, Claim, Sender
from mavlink.links.bpf import Source

__all__ = ["Peers", "address_of", "key_of"]

TRUSTED = 512
NUMBERED = 4096
PLACES = 4
"""Addresses trusted for one system: it may be heard over some routes at once, and has a new one when it reboots."""
WAITING = 512
"""Senders that may wait for a place."""
TOLD = 32
QUIET_US = 60_000_000
"""Trust ends when nothing good was heard for this long."""
GONE_US = 5_000_000
"""Nor does anybody wait for a place who says nothing for this long."""
_KEY = struct.Struct("=q")
_SENDER = struct.Struct("=H2s4s")


def key_of(address: tuple[str, int]) -> int:
    """An IPv4 address and port as the first eight bytes of the system's sockaddr_in, in one number."""
    host, port = address
    packed = _SENDER.pack(socket.AF_INET, port.to_bytes(2, "big"), socket.inet_aton(host))
    return int(_KEY.unpack(packed)[0])


def address_of(key: int) -> str:
    """Host and port of what :func:`key_of` gives."""
    _, port, host = _SENDER.unpack(_KEY.pack(key))
    return f"{socket.inet_ntoa(host)}:{int.from_bytes(port, 'big')}"


@dataclass(slots=True)
class _Trust:
    heard_us: int
    times: int = 0
    """Reviews before which it was heard."""


class Peers:
    """Senders of one port, by the number that their packets carry."""

    def __init__(self) -> None:
        self.numbers: OrderedDict[int, int] = OrderedDict()
        """Address (:func:`key_of`) → number, from 1; the oldest first."""
        self.trusted: dict[Claim, _Trust] = {}
        """Those whose frames were good and who have a place; look-ups say whether somebody is trusted."""
        self.changes = 0
        """Grows whenever what is trusted changes."""
        self._waiting: dict[Claim, _Trust] = {}
        """Those whose frames were good while all places of their system were taken."""
        self._places: Counter[int] = Counter()
        """System id → how many of the trusted speak for it."""
        self._known: Counter[int] = Counter()
        """Number → for how many systems it is trusted."""
        self._mixed: set[int] = set()
        """Numbers from where good frames came in datagrams that were not one frame each."""
        self.keys: dict[int, int] = {}
        """Number → address, as in :attr:`numbers`."""
        self._last = 0
        self._heard: set[Claim] = set()
        self._told: tuple[int, dict[int, tuple[str, int]]] = (-1, {})

    def number(self, key: int) -> int:
        """An address's number; a new one if it has none."""
        known = self.numbers.get(key)
        if known is not None:
            return known
        if len(self.numbers) >= NUMBERED:
            self._forget_one()
        self._last += 1
        self.numbers[key] = self._last
        self.keys[self._last] = key
        return self._last

    def hear(self, claims: set[Claim]) -> None:
        """Good frames have just come from these, who are trusted already."""
        self._heard |= claims

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """Good frames have just come from these addresses under these system ids."""
        self.hear(claims)
        for claim in claims.difference(self.trusted):
            if claim[0] not in self.keys:
                continue  # forgotten meanwhile
            if self._places[claim[1]] < PLACES and len(self.trusted) < TRUSTED:
                self._place(claim, _Trust(t_us))
            elif claim in self._waiting or len(self._waiting) < WAITING:
                self._waiting.setdefault(claim, _Trust(t_us)).heard_us = t_us

    def mix(self, numbers: Set[int]) -> None:
        """Good frames have come from these addresses in datagrams that were not one frame each."""
        new = {number for number in numbers - self._mixed if number in self.keys}
        if new:
            self._mixed |= new
            self.changes += 1

    def review(self, t_us: int) -> None:
        """Ends the trust in those who are silent, and gives their places to others."""
        for table in (self.trusted, self._waiting):
            for claim in self._heard.intersection(table):
                table[claim].heard_us = t_us
                table[claim].times += 1
        self._heard.clear()
        for claim in [claim for claim, entry in self.trusted.items() if t_us - entry.heard_us > QUIET_US]:
            self._drop(claim)
        if self._waiting:
            self._fill_places(t_us)

    def adopt(
        self,
        known: Mapping[int, tuple[str, int]],
        claims: Collection[Claim],
        mixed: Collection[int],
        last: int,
        t_us: int,
    ) -> None:
        """Goes on with the numbers, and the trust, of a table that ended without notice.

        Args:
            known: number → address of those who were trusted.
            claims: what they were trusted for.
            mixed: numbers of those whose datagrams were not always one frame.
            last: highest number ever given.
            t_us: now.
        """
        for number, address in known.items():
            key = key_of(address)
            self.numbers[key], self.keys[number] = number, key
        self.trust(set(claims), t_us)
        self.mix(set(mixed))
        self._last = max(self._last, last, *known.keys())

    @property
    def last(self) -> int:
        """Highest number given so far."""
        return self._last

    @property
    def mixed(self) -> frozenset[int]:
        """Numbers of those trusted whose datagrams are not always one frame each."""
        return frozenset(self._mixed.intersection(self._known))

    def addresses(self) -> dict[int, tuple[str, int]]:
        """Number → address of those who are trusted, as sockets take them."""
        if self._told[0] != self.changes:
            self._told = self.changes, {number: address for number in self._known for address in self.one(number)}
        return self._told[1]

    def strangers(self) -> dict[int, str]:
        """Number → host and port of the latest who are not trusted, to tell an operator."""
        latest = (number for number in reversed(self.numbers.values()) if number not in self._known)
        return {number: self.address(number) for number in islice(latest, TOLD)}

    def one(self, number: int) -> list[tuple[str, int]]:
        """A sender's address, as sockets take it, trusted or not; none where it is forgotten."""
        if number not in self.keys:
            return []
        host, port = self._source(number)
        return [(socket.inet_ntoa(host.to_bytes(4, "big")), port)]

    def address(self, number: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        key = self.keys.get(number)
        return "" if key is None else address_of(key)

    def knows(self, sender: Sender) -> bool:
        """Whether somebody is trusted, in this form of his datagrams."""
        number, kind = sender
        return sender in self.trusted or (kind == MIXED and number in self._mixed and number in self._known)

    def systems(self) -> dict[Sender, int]:
        """Those who are trusted, by the form of their datagrams → for how many systems each speaks so."""
        systems = dict.fromkeys(self.trusted, 1)
        if self._mixed:
            systems |= {(number, MIXED): self._known[number] for number in self._mixed.intersection(self._known)}
        return systems

    def source(self, sender: Sender) -> Source:
        """One of those, as the kernel's filter knows it."""
        return (*self._source(sender[0]), sender[1])

    def _source(self, number: int) -> tuple[int, int]:
        _, port, host = _SENDER.unpack(_KEY.pack(self.keys[number]))
        return int.from_bytes(host, "big"), int.from_bytes(port, "big")

    def _place(self, claim: Claim, entry: _Trust) -> None:
        self.trusted[claim] = entry
        self._places[claim[1]] += 1
        self._known[claim[0]] += 1
        self.changes += 1

    def _fill_places(self, t_us: int) -> None:
        """One of each system who wait takes a place that is free, or that of one who was heard less often."""
        first: dict[int, Claim] = {}
        for claim, entry in list(self._waiting.items()):
            if t_us - entry.heard_us > GONE_US or claim[0] not in self.keys:
                del self._waiting[claim]
            elif claim[1] not in first or entry.times > self._waiting[first[claim[1]]].times:
                first[claim[1]] = claim
        last: dict[int, Claim] = {}
        for claim, entry in self.trusted.items():
            if claim[1] not in last or entry.times < self.trusted[last[claim[1]]].times:
                last[claim[1]] = claim
        for system_id, claim in first.items():
            if self._places[system_id] >= PLACES:
                other = last[system_id]
            elif len(self.trusted) >= TRUSTED:
                other = min(last.values(), key=lambda placed: self.trusted[placed].times)
            else:
                self._place(claim, self._waiting.pop(claim))
                continue
            if self.trusted[other].times < self._waiting[claim].times:
                self._waiting[other] = self.trusted[other]
                self._drop(other)
                self._place(claim, self._waiting.pop(claim))
                last[system_id] = claim

    def _drop(self, claim: Claim) -> None:
        del self.trusted[claim]
        self._places[claim[1]] -= 1
        self._known[claim[0]] -= 1
        if not self._known[claim[0]]:
            del self._known[claim[0]]
        self.changes += 1

    def _forget_one(self) -> None:
        """The oldest who is not trusted; there always is one, as more are numbered than trusted."""
        while self.numbers[key := next(iter(self.numbers))] in self._known:
            self.numbers.move_to_end(key)
        number = self.numbers.pop(key)
        del self.keys[number]
        self._mixed.discard(number)
