"""How the ingest is doing, told by its process as JSON and read by the station."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from typing import Any

from infra.files.record_state import RecordState
from mavlink.forwarding.outputs import InboundFrames, OutputCounts
from mavlink.links.flood_limiter import Limit
from mavlink.links.report import LinkCounts, LinkReport

__all__ = ["IngestHealth", "Notice"]


_NOTHING = RecordState(name="")


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something that an operator should know."""

    t_us: int
    level: str
    """``info``, ``warning`` or ``alarm``."""
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class IngestHealth:
    """How the ingest is doing."""

    links: tuple[LinkReport, ...] = ()
    outputs: tuple[OutputCounts, ...] = ()
    record: RecordState = _NOTHING
    refused: int = 0
    """Packets recorded and not believed."""
    packets: int = 0
    """Recorded in all, over restarts, those of this station too."""
    sent: int = 0
    """Of those, what this station sent."""
    overrun: int = 0
    """Packets recorded that the station was too slow to take."""
    restarts: int = 0
    gap_s: float = 0.0
    """For how long nothing was received, over all restarts."""
    cpu_s: float = math.nan
    """Processor time of the present process."""
    troubles: tuple[str, ...] = ()
    """What does not work at the moment, in plain words."""

    def to_json(self) -> bytes:
        """As :meth:`from_json` reads it."""
        return json.dumps(self, default=_fields).encode()

    @classmethod
    def from_json(cls, text: bytes) -> IngestHealth:
        """What :meth:`to_json` wrote.

        Raises:
            ValueError: it is not that.
        """
        table: dict[str, Any] = json.loads(text)
        try:
            table["links"] = tuple(_link(link) for link in table["links"])
            table["outputs"] = tuple(map(_output, table["outputs"]))
            table["record"] = RecordState(**table["record"])
            table["troubles"] = tuple(table["troubles"])
            return cls(**table)
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"no health of an ingest: {error}") from error

    def plus(self, before: tuple[LinkCounts, ...]) -> IngestHealth:
        """With what processes before this one had counted."""
        pairs = zip(self.links, before, strict=False)
        links = tuple(replace(link, counts=_sum(link.counts, old)) for link, old in pairs)
        return replace(self, links=links + self.links[len(links) :])


def _fields(record: Any) -> dict[str, Any]:  # noqa: ANN401 - any of the dataclasses here
    return {name: getattr(record, name) for name in record.__slots__}


def _link(table: dict[str, Any]) -> LinkReport:
    addresses = tuple((number, host, port) for number, host, port in table["addresses"])
    others = tuple((number, address) for number, address in table["others"])
    lists = {
        "addresses": addresses,
        "others": others,
        "claims": tuple((number, system_id) for number, system_id in table["claims"]),
        "mixed": tuple(table["mixed"]),
        "limits": tuple(Limit(**limit) for limit in table["limits"]),
    }
    return LinkReport(**table | {"counts": LinkCounts(**table["counts"])} | lists)


def _output(table: dict[str, Any]) -> OutputCounts:
    return OutputCounts(**table | {"inbound": tuple(InboundFrames(**frames) for frames in table["inbound"])})


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
