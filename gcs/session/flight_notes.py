"""What ``session.toml`` has beside the mission: what a replay has to know of the flight.

Keys and models are noted by what they are recognised by, never by what is in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import TypeVar

from mavlink.signing.keys import KeyRing

__all__ = ["PROGRAM", "FlightNotes", "key_notes"]

Kind = TypeVar("Kind")

PROGRAM = f"rollcall-gcs {version('rollcall-gcs')}"
FLEET = "fleet"
"""In place of a system id: the key of all who have none of their own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightNotes:
    """The notes of a recording; all empty for one that was not flown."""

    flown: bool = False
    """Whether this program recorded it in flight."""
    program: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints by system id, as text, or ``FLEET``."""
    models: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the networks that looked, by what they are for."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Rows that the disk did not take, by file."""
    refused: int | None = None
    """Records that were not believed; None: the flight was not ended in order."""

    @classmethod
    def from_table(cls, table: object) -> FlightNotes:
        """From the ``[session]`` table; what is not of the right kind is left out."""
        if not isinstance(table, Mapping):
            return cls()
        refused = table.get("refused")
        return cls(
            flown="started" in table,
            program=str(table.get("program", "")),
            keys=_values_of(str, table.get("keys")),
            models=_values_of(str, table.get("models")),
            lost=_values_of(int, table.get("lost")),
            refused=refused if isinstance(refused, int) else None,
        )

    def had_key_for(self, system_id: int) -> bool:
        """Whether the flight had a key for a system."""
        return str(system_id) in self.keys or FLEET in self.keys


def key_notes(ring: KeyRing) -> dict[str, str]:
    """Fingerprints of all keys."""
    notes = {str(system_id): key.fingerprint for system_id, key in sorted(ring.keys.items())}
    return notes | ({FLEET: ring.default.fingerprint} if ring.default else {})


def _values_of(kind: type[Kind], table: object) -> dict[str, Kind]:
    """The values of a table that are of a kind."""
    if not isinstance(table, Mapping):
        return {}
    return {str(name): value for name, value in table.items() if isinstance(value, kind)}
