"""Whether one system id has two senders.

A vehicle has one kind, one clock, one place and one hardware id at a time. Whoever says something else speaks in turn
with the vehicle, and that is what is looked for: contradictions whose speaker changes again and again. A reboot, a new
address, a jump of a receiver or a late copy changes once or for an instant, and is none.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

from mavlink.reception import Speaker

__all__ = ["Claim", "Conflict", "Contest"]

Claim = Literal["kind", "clock", "place", "jump", "attitude", "uid"]

_PAUSE_US = 3_000_000  # turns farther apart than this are not of one dispute
_SPAN_US = 900_000
_TURNS: dict[Claim, int] = {"kind": 3, "clock": 3, "place": 3, "attitude": 3, "jump": 4}
_HOLD_US = 10_000_000
_HOLD_UID_US = 60_000_000


@dataclass(frozen=True, slots=True)
class Conflict:
    """What two senders of one system id contradict each other in, and where they are heard."""

    claim: Claim
    detail: str
    one: Speaker
    other: Speaker


class _Dispute:
    __slots__ = ("first_us", "last_us", "other", "speaker", "turns", "where")

    def __init__(self, speaker: Hashable, where: Speaker, other: Speaker, t_us: int) -> None:
        self.speaker = speaker
        self.where, self.other = where, other
        self.first_us = self.last_us = t_us
        self.turns = 1


class Contest:
    """Collects contradictions; contested for ten seconds after the last one (a minute after two hardware ids)."""

    def __init__(self) -> None:
        self.conflict: Conflict | None = None
        """The newest conflict that was found."""
        self._disputes: dict[Claim, _Dispute] = {}
        self._last_us = 0
        self._hold_us = 0

    def contested(self, t_us: int) -> bool:
        """Whether two senders use the id at a Unix time in µs."""
        return abs(t_us - self._last_us) < self._hold_us

    def disputed(self, claim: Claim, t_us: int) -> bool:
        """Whether somebody contradicted in the last seconds, so that the other's turn counts."""
        dispute = self._disputes.get(claim)
        return dispute is not None and 0 <= t_us - dispute.last_us < _PAUSE_US

    def take(
        self, claim: Claim, speaker: Hashable, where: Speaker, t_us: int, detail: str, other: Speaker | None = None
    ) -> None:
        """One contradiction.

        Args:
            claim: what is contradicted.
            speaker: which of the two sides says it now.
            where: how that packet came.
            t_us: Unix µs of its arrival.
            detail: in words for the operator.
            other: how the other side was heard last, where known.
        """
        dispute = self._disputes.get(claim)
        if dispute is None or not 0 <= t_us - dispute.last_us < _PAUSE_US:
            self._disputes[claim] = _Dispute(speaker, where, other or where, t_us)
            return
        if speaker == dispute.speaker:
            return
        dispute.speaker, dispute.other, dispute.where = speaker, dispute.where, where
        dispute.turns += 1
        dispute.last_us = t_us
        if dispute.turns >= _TURNS[claim] and t_us - dispute.first_us >= _SPAN_US:
            self.declare(claim, detail, where, dispute.other, t_us)

    def declare(self, claim: Claim, detail: str, one: Speaker, other: Speaker, t_us: int) -> None:
        """Two senders for certain."""
        if not self.contested(t_us):
            self.conflict = Conflict(claim, detail, one, other)
        hold_us = _HOLD_UID_US if claim == "uid" else _HOLD_US
        if t_us + hold_us > self._last_us + self._hold_us or not self.contested(t_us):
            self._last_us, self._hold_us = t_us, hold_us
