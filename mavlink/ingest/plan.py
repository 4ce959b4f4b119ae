"""Plan that the ingest process is given when its turn comes: paths of keys, never keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec

from mavlink.errors import LinkError
from mavlink.links.kinds import parse_url
from mavlink.links.url import LinkUrl


@dataclass(frozen=True, slots=True, kw_only=True)
class Signing:
    """Place of the keys, and what may come without."""

    keys: str = ""
    """Folder with keys; empty: nothing is verified."""
    unsigned: tuple[int, ...] | None = None
    """Messages that may come unsigned; None: as :class:`mavlink.signing.verifier.Verifier` has it."""
    keyless: Literal["refused", "open"] = "refused"
    accept_late: tuple[int, ...] = ()
    """Systems that are accepted without a proof that their packets are made now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """Outputs that packets go on to; see :class:`mavlink.forwarding.forward.Forwarder`."""

    urls: tuple[str, ...] = ()
    uav: int = 0
    """System id of the UAV, to which `?rw` lets programs send."""
    refused: bool = False
    own: int = 0
    """System id of this station."""


class Plan(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """All that one ingest process needs to know."""

    urls: tuple[str, ...]
    sockets: tuple[int, ...]
    """File descriptor of each link that the station has opened; −1: the process opens it."""
    memory: int
    """File descriptor of the shared memory."""
    journal: int
    """File descriptor of the memory in which records wait for the disk."""
    wake: int
    """File descriptor of a pipe that gets a byte whenever packets have been put into the memory."""
    log: str
    """Path of the log's first segment."""
    generation: int = 1
    """Counts the processes of one flight."""
    system_ids: tuple[int, ...] = ()
    """System ids whose frames make a sender known; empty: all."""
    signing: Signing = Signing()
    outputs: Outputs = Outputs()


def check_links(links: Sequence[LinkUrl], outputs: Sequence[str]) -> None:
    """Refuse what would record everything twice: a link that is named twice, an output into a port of our own.

    Raises:
        LinkError: there is one.
    """
    names = [link.name for link in links]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise LinkError(f"{name}: given twice; name each link once")
    for output in outputs:
        out = parse_url(output.partition("?")[0])
        for link in links:
            here = out.host == link.host or (_is_local(out.host) and (link.host == "0.0.0.0" or _is_local(link.host)))
            if out.scheme.removesuffix("out") + "in" == link.scheme and out.port == link.port and here:
                raise LinkError(f"{output}: leads back to this station's own {link.name}; forward to another port")


def _is_local(host: str) -> bool:
    return host == "localhost" or host.startswith("127.")
