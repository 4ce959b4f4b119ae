"""Senders to a UDP port: numbers for the addresses of kept frames, and which senders are trusted after good frames.

A source address can be forged, so trust is for one address with one system id, never for all that comes from an
address, and nothing that only claims to come from there ends it. All tables are bounded, and few addresses are trusted
for one system, those received most often: many impostors of one system displace each other, not the vehicle.
"""

from __future__ import annotations

import socket
import struct
from collections import Counter, OrderedDict
from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass
from itertools import islice

from mavlink.links.batch import MIXED, Claim, Sender
from mavlink.links.bpf import FilterSource

TRUSTED = 512
"""Senders trusted at a time, of all systems."""
NUMBERED = 4096
"""Addresses that have a number at a time."""
ADDRESSES_PER_SYSTEM = 4
"""Addresses trusted for one system: it may come over several routes, and from a new one after a reboot."""
WAITING = 512
"""Senders that may wait for trust while all addresses of their system are taken."""
REPORTED = 32
"""Untrusted senders whose addresses are reported."""
TRUSTED_US = 60_000_000
"""Time without a good frame after which trust ends."""
WAITING_US = 5_000_000
"""Time without a good frame after which a waiting sender is forgotten."""
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
    """Updates of trust before which it was received."""


class Peers:
    """Senders of one port, by the number that their packets carry."""

    def __init__(self) -> None:
        self.numbers: OrderedDict[int, int] = OrderedDict()
        """Address (:func:`key_of`) → number, from 1; the oldest first."""
        self.trusted: dict[Claim, _Trust] = {}
        """Trusted senders, those with good frames."""
        self.changes = 0
        """Grows whenever what is trusted changes."""
        self._waiting: dict[Claim, _Trust] = {}
        """Senders with good frames while all addresses of their system were taken."""
        self._addresses_of: Counter[int] = Counter()
        """System id → how many of the trusted send as it."""
        self._known: Counter[int] = Counter()
        """Number → for how many systems it is trusted."""
        self._mixed: set[int] = set()
        """Numbers from where good frames came in datagrams that were not one frame each."""
        self.keys: dict[int, int] = {}
        """Number → address, as in :attr:`numbers`."""
        self._last = 0
        self._good_claims: set[Claim] = set()
        self._address_cache: tuple[int, dict[int, tuple[str, int]]] = (-1, {})

    def number(self, key: int) -> int:
        """An address's number; a new one if it has none."""
        known = self.numbers.get(key)
        if known is not None:
            return known
        if len(self.numbers) >= NUMBERED:
            self._evict_oldest()
        self._last += 1
        self.numbers[key] = self._last
        self.keys[self._last] = key
        return self._last

    def note_good_frames(self, claims: set[Claim]) -> None:
        """Note good frames of senders that are trusted already."""
        self._good_claims |= claims

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """Note good frames of senders, and trust those that there is room for."""
        self.note_good_frames(claims)
        for claim in claims.difference(self.trusted):
            if claim[0] not in self.keys:
                continue  # forgotten meanwhile
            if self._addresses_of[claim[1]] < ADDRESSES_PER_SYSTEM and len(self.trusted) < TRUSTED:
                self._admit(claim, _Trust(t_us))
            elif claim in self._waiting or len(self._waiting) < WAITING:
                self._waiting.setdefault(claim, _Trust(t_us)).heard_us = t_us

    def note_mixed(self, numbers: Set[int]) -> None:
        """Note that good frames came from these addresses in datagrams that were not one frame each."""
        new = {number for number in numbers - self._mixed if number in self.keys}
        if new:
            self._mixed |= new
            self.changes += 1

    def update_trust(self, t_us: int) -> None:
        """End the trust in silent senders, and trust waiting ones instead."""
        for table in (self.trusted, self._waiting):
            for claim in self._good_claims.intersection(table):
                table[claim].heard_us = t_us
                table[claim].times += 1
        self._good_claims.clear()
        for claim in [claim for claim, entry in self.trusted.items() if t_us - entry.heard_us > TRUSTED_US]:
            self._revoke(claim)
        if self._waiting:
            self._admit_waiting(t_us)

    def restore(
        self,
        known: Mapping[int, tuple[str, int]],
        claims: Collection[Claim],
        mixed: Collection[int],
        last: int,
        t_us: int,
    ) -> None:
        """Take over the numbers and the trust of another process that has ended.

        Args:
            known: number → address of those who were trusted.
            mixed: numbers of those whose datagrams were not always one frame.
            last: highest number ever given.
        """
        for number, address in known.items():
            key = key_of(address)
            self.numbers[key], self.keys[number] = number, key
        self.trust(set(claims), t_us)
        self.note_mixed(set(mixed))
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
        """Number → address of trusted senders, as sockets take them."""
        if self._address_cache[0] != self.changes:
            self._address_cache = (
                self.changes,
                {number: address for number in self._known for address in self.socket_addresses(number)},
            )
        return self._address_cache[1]

    def untrusted(self) -> dict[int, str]:
        """Number → host and port of the latest senders that are not trusted, for operators."""
        latest = (number for number in reversed(self.numbers.values()) if number not in self._known)
        return {number: self.address(number) for number in islice(latest, REPORTED)}

    def socket_addresses(self, number: int) -> list[tuple[str, int]]:
        """A sender's address as sockets take it, trusted or not; empty where it is forgotten."""
        if number not in self.keys:
            return []
        host, port = self._source(number)
        return [(socket.inet_ntoa(host.to_bytes(4, "big")), port)]

    def address(self, number: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        key = self.keys.get(number)
        return "" if key is None else address_of(key)

    def trusts(self, sender: Sender) -> bool:
        """Tell whether a sender is trusted with this class of datagrams."""
        number, kind = sender
        return sender in self.trusted or (kind == MIXED and number in self._mixed and number in self._known)

    def systems(self) -> dict[Sender, int]:
        """Trusted senders by class of datagrams → for how many systems each sends."""
        systems = dict.fromkeys(self.trusted, 1)
        if self._mixed:
            systems |= {(number, MIXED): self._known[number] for number in self._mixed.intersection(self._known)}
        return systems

    def source(self, sender: Sender) -> FilterSource:
        """A sender as the kernel's filter knows it."""
        return (*self._source(sender[0]), sender[1])

    def _source(self, number: int) -> tuple[int, int]:
        _, port, host = _SENDER.unpack(_KEY.pack(self.keys[number]))
        return int.from_bytes(host, "big"), int.from_bytes(port, "big")

    def _admit(self, claim: Claim, entry: _Trust) -> None:
        self.trusted[claim] = entry
        self._addresses_of[claim[1]] += 1
        self._known[claim[0]] += 1
        self.changes += 1

    def _admit_waiting(self, t_us: int) -> None:
        """Admit one waiting sender of each system to a free place, or that of one that was received less often."""
        first: dict[int, Claim] = {}
        for claim, entry in list(self._waiting.items()):
            if t_us - entry.heard_us > WAITING_US or claim[0] not in self.keys:
                del self._waiting[claim]
            elif claim[1] not in first or entry.times > self._waiting[first[claim[1]]].times:
                first[claim[1]] = claim
        last: dict[int, Claim] = {}
        for claim, entry in self.trusted.items():
            if claim[1] not in last or entry.times < self.trusted[last[claim[1]]].times:
                last[claim[1]] = claim
        for system_id, claim in first.items():
            if self._addresses_of[system_id] >= ADDRESSES_PER_SYSTEM:
                other = last[system_id]
            elif len(self.trusted) >= TRUSTED:
                other = min(last.values(), key=lambda placed: self.trusted[placed].times)
            else:
                self._admit(claim, self._waiting.pop(claim))
                continue
            if self.trusted[other].times < self._waiting[claim].times:
                self._waiting[other] = self.trusted[other]
                self._revoke(other)
                self._admit(claim, self._waiting.pop(claim))
                last[system_id] = claim

    def _revoke(self, claim: Claim) -> None:
        del self.trusted[claim]
        self._addresses_of[claim[1]] -= 1
        self._known[claim[0]] -= 1
        if not self._known[claim[0]]:
            del self._known[claim[0]]
        self.changes += 1

    def _evict_oldest(self) -> None:
        """Evict the oldest sender that is not trusted; there always is one, as more are numbered than trusted."""
        while self.numbers[key := next(iter(self.numbers))] in self._known:
            self.numbers.move_to_end(key)
        number = self.numbers.pop(key)
        del self.keys[number]
        self._mixed.discard(number)
