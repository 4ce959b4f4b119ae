"""Whether one system id has two senders.

A vehicle has one kind, one mode, one clock, one place and one hardware id at a time. Places are compared by
:mod:`mavlink.duplicate_id.claimed_places`. Whoever else says something else speaks in turn with the vehicle, and that
is what is looked for: contradictions whose speaker changes again and again. A reboot, a new address or a late copy
changes once or for an instant, and is none; a receiver that jumps has one sender.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

from mavlink.reception.reception import Speaker

__all__ = ["Claim", "Conflict", "Contest", "Turns"]

Claim = Literal["autopilot", "kind", "mode", "clock", "boot", "place", "attitude", "uid"]

_PAUSE_US = 3_000_000  # turns farther apart than this are not of one dispute
_SPAN_US = 900_000
_TURNS: dict[Claim, int] = {"autopilot": 3, "kind": 3, "mode": 4, "clock": 3, "boot": 3, "attitude": 3}
_HOLD_US = 4_500_000
"""Longer than the longest pause within a dispute: two who beat once a second and lose packets are one contest."""
_HOLD_UID_US = 60_000_000
"""Hardware ids are told rarely."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """What two senders of one system id contradict each other in, and where they are heard."""

    claim: Claim
    detail: str
    one: Speaker
    other: Speaker


class Turns:
    """Two who speak by turns: how often the speaker has changed, without a longer pause, and for how long."""

    __slots__ = ("_first_us", "_last_us", "_speaker", "_turns", "other", "where")

    def __init__(self) -> None:
        self.where = self.other = Speaker(-1, 0, 0)
        """How the one who spoke last was heard, and the one before."""
        self._speaker: Hashable = None
        self._turns = 0
        self._first_us = self._last_us = 0

    def take(self, speaker: Hashable, where: Speaker, other: Speaker, t_us: int) -> bool:
        """Somebody speaks, True when it is another than before; ``other`` is how the other side was heard last."""
        if not self._turns or not self.running(t_us):
            self._turns, self._first_us = 1, t_us
        elif speaker == self._speaker:
            return False
        else:
            self._turns += 1
        self._speaker, self.where, self.other, self._last_us = speaker, where, other, t_us
        return True

    def running(self, t_us: int) -> bool:
        """Whether the last change of speaker was in the last seconds."""
        return self._turns > 0 and 0 <= t_us - self._last_us < _PAUSE_US

    def established(self, turns: int, t_us: int) -> bool:
        """Whether this has gone on for so many turns, and for about a second."""
        return self._turns >= turns and self.running(t_us) and self._last_us - self._first_us >= _SPAN_US


class Contest:
    """Collects contradictions; contested for some seconds after the last one (a minute after two hardware ids)."""

    def __init__(self) -> None:
        self.conflict: Conflict | None = None
        """The newest conflict that was found."""
        self._disputes: dict[Claim, Turns] = {}
        self._last_us = 0
        self._hold_us = 0

    def contested(self, t_us: int) -> bool:
        """Whether two senders use the id at a Unix time in µs."""
        return abs(t_us - self._last_us) < self._hold_us

    def disputed(self, claim: Claim, t_us: int) -> bool:
        """Whether somebody contradicted in the last seconds, so that the other's turn counts."""
        dispute = self._disputes.get(claim)
        return dispute is not None and dispute.running(t_us)

    def take(self, claim: Claim, speaker: Hashable, where: Speaker, t_us: int, detail: str, other: Speaker) -> None:
        """One contradiction.

        Args:
            claim: what is contradicted.
            speaker: which of the two sides says it now.
            where: how that packet came.
            t_us: Unix µs of its arrival.
            detail: in words for the operator.
            other: how the other side was heard last.
        """
        dispute = self._disputes.setdefault(claim, Turns())
        if dispute.take(speaker, where, other, t_us) and dispute.established(_TURNS[claim], t_us):
            self.declare(claim, detail, where, dispute.other, t_us)

    def declare(self, claim: Claim, detail: str, one: Speaker, other: Speaker, t_us: int) -> None:
        """Two senders for certain."""
        if not self.contested(t_us):
            self.conflict = Conflict(claim, detail, one, other)
        hold_us = _HOLD_UID_US if claim == "uid" else _HOLD_US
        if t_us + hold_us > self._last_us + self._hold_us or not self.contested(t_us):
            self._last_us, self._hold_us = t_us, hold_us
