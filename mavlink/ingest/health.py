"""Health of the ingest, reported by its process and read by the station."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec

from infra.files.record_state import RecordState
from mavlink.forwarding.outputs import OutputCounts
from mavlink.links.report import LinkCounts, LinkReport

_NOTHING = RecordState(name="")


@dataclass(frozen=True, slots=True, kw_only=True)
class IngestHealth:
    """Health of the ingest."""

    links: tuple[LinkReport, ...] = ()
    outputs: tuple[OutputCounts, ...] = ()
    record: RecordState = _NOTHING
    refused: int = 0
    """Packets recorded and rejected."""
    packets: int = 0
    """Recorded in all, over restarts, those of this station too."""
    sent: int = 0
    """Packets among those that this station sent."""
    overrun: int = 0
    """Packets recorded that the station was too slow to take."""
    restarts: int = 0
    gap_s: float = 0.0
    """Time for which nothing was received, s, over all restarts."""
    cpu_s: float = math.nan
    """Processor time of the present process."""
    troubles: tuple[str, ...] = ()
    """Troubles of the moment, in plain words."""

    def encode(self) -> bytes:
        """Bytes that :meth:`decode` reads."""
        return msgspec.msgpack.encode(self)

    @classmethod
    def decode(cls, data: bytes) -> IngestHealth:
        """Health that :meth:`encode` wrote.

        Raises:
            ValueError: it is not that.
        """
        try:
            return msgspec.msgpack.decode(data, type=cls)
        except msgspec.DecodeError as error:
            raise ValueError(f"no health of an ingest: {error}") from error

    def plus(self, before: tuple[LinkCounts, ...]) -> IngestHealth:
        """Add what processes before this one had counted."""
        pairs = zip(self.links, before, strict=False)
        links = tuple(replace(link, counts=_sum(link.counts, old)) for link, old in pairs)
        return replace(self, links=links + self.links[len(links) :])


def _sum(now: LinkCounts, before: LinkCounts) -> LinkCounts:
    return replace(
        now,
        packets=now.packets + before.packets,
        bytes=now.bytes + before.bytes,
        bad=now.bad + before.bad,
        junk_bytes=now.junk_bytes + before.junk_bytes,
        unknown=now.unknown + before.unknown,
        dropped=now.dropped + before.dropped,
        turned_away=now.turned_away + before.turned_away,
    )
