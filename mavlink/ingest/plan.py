"""What the ingest process is told when it starts. It passes through the command line: paths of keys, never keys."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal

__all__ = ["Outputs", "Plan", "Signing"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Signing:
    """Where keys are and what may come without."""

    keys: str = ""
    """Folder with keys; empty: nothing is verified."""
    unsigned: tuple[int, ...] | None = None
    """Messages that may come unsigned; None: as :class:`mavlink.signing.verifier.Verifier` has it."""
    keyless: Literal["refused", "open"] = "refused"
    accept_late: tuple[int, ...] = ()
    """Systems that are believed without a proof that their packets are made now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """Where packets go on to; see :class:`mavlink.forwarding.forward.Forwarder`."""

    urls: tuple[str, ...] = ()
    uav: int = 0
    """System id of the UAV, to which `?rw` lets programs speak."""
    refused: bool = False
    own: int = 0
    """System id of this station."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """All that one ingest process needs to know."""

    urls: tuple[str, ...]
    sockets: tuple[int, ...]
    """File descriptor of each link that the station has opened; −1: the process opens it."""
    memory: int
    """File descriptor of the shared memory."""
    journal: int
    """File descriptor of the memory in which records wait for the disk."""
    control: int
    """File descriptor of the socket between the two."""
    log: str
    """Path of the log's first segment."""
    generation: int = 0
    """Counts the processes of one flight, from 1; told when it is the process's turn."""
    system_ids: tuple[int, ...] = ()
    """Whose frames make a sender known; empty: anybody's."""
    signing: Signing = Signing()
    outputs: Outputs = Outputs()

    def to_text(self) -> str:
        """As one argument."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> Plan:
        """The plan that :meth:`to_text` wrote."""
        table = json.loads(text)
        signing, outputs = table.pop("signing"), table.pop("outputs")
        if signing["unsigned"] is not None:
            signing["unsigned"] = tuple(signing["unsigned"])
        signing["accept_late"] = tuple(signing["accept_late"])
        outputs["urls"] = tuple(outputs["urls"])
        for name in ("urls", "sockets", "system_ids"):
            table[name] = tuple(table[name])
        return cls(**table, signing=Signing(**signing), outputs=Outputs(**outputs))
