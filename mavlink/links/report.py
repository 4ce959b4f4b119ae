"""The state of a link: for operators, and for the process that takes over when this one has died."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink.links.batch import Claim
from mavlink.links.flood_limiter import FloodLimit


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCounts:
    """Counts of what a link has brought so far."""

    packets: int = 0
    """Good frames, and those of unknown messages."""
    bytes: int = 0
    bad: int = 0
    """Frames with a wrong checksum."""
    junk_bytes: int = 0
    unknown: int = 0
    """Frames of unknown messages among the packets."""
    dropped: int = 0
    """Datagrams that the system dropped because they were not read in time."""
    turned_away: int = 0
    """Datagrams that the filter dropped during floods."""
    silent_s: float = math.inf
    """Time since the last packet, s; inf before the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkReport:
    """One link."""

    name: str
    counts: LinkCounts
    buffer_bytes: int = 0
    """Receive buffer that the system granted; 0 where there is none to ask for."""
    system_drops: int = 0
    """The system's own count of what its socket dropped, for whatever reason."""
    peers: int = 0
    """Senders that are known."""
    addresses: tuple[tuple[int, str, int], ...] = ()
    """Number, host and port of those, on a UDP port."""
    others: tuple[tuple[int, str], ...] = ()
    """Number and address in words of the latest who are not known there, and of those connected by TCP."""
    last_peer: int = 0
    """Highest number given to a sender."""
    connected: bool = True
    claims: tuple[Claim, ...] = ()
    """Claims that the known senders are trusted for."""
    mixed: tuple[int, ...] = ()
    """Numbers of those whose datagrams are not always one frame."""
    limits: tuple[FloodLimit, ...] = ()
    """Senders that flood it and of which only a share passes."""

    @property
    def narrow(self) -> bool:
        """True if a sender floods it and only a share of it passes."""
        return bool(self.limits)
