"""Messages between the station and the ingest process. The plan comes first; nothing is opened before.

What changes many times a second is in shared memory instead (:mod:`mavlink.ingest.ingest_memory`).
"""

from __future__ import annotations

import msgspec

from mavlink.ingest.plan import Plan


class SendFrame(msgspec.Struct, frozen=True, tag=True):
    """Request to send a frame over a link, to one peer or, 0, to all who are known there."""

    link: int
    frame: bytes
    peer: int


class AcceptHeld(msgspec.Struct, frozen=True, tag=True):
    """Request to accept a system whose packets are held: an operator vouches for it."""

    system_id: int


class KnownFleet(msgspec.Struct, frozen=True, tag=True):
    """Ids whose frames make a sender known from now on, where that was not decided when the links were opened."""

    system_ids: tuple[int, ...]
    uav: int
    """System id of the UAV, to which programs behind outputs may send."""


class Opened(msgspec.Struct, frozen=True, tag=True):
    """Report that everything is open."""


class CannotOpen(msgspec.Struct, frozen=True, tag=True):
    """Report that something cannot be opened: the class of the error and its text."""

    error: str
    text: str


IngestRequest = Plan | SendFrame | AcceptHeld | KnownFleet
IngestReport = Opened | CannotOpen
