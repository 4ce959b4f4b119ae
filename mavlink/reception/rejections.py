"""What a vehicle said that could not be right: counted by reason, told now and then."""

from __future__ import annotations

from infra.reporting import Throttle

__all__ = ["REPORT_AGAIN_US", "Refusals"]

REPORT_AGAIN_US = 30_000_000
"""What a vehicle does wrong all the time is reported so often."""


class Refusals:
    """Counts of one vehicle."""

    def __init__(self) -> None:
        self.positions = 0
        """Positions that could not be right."""
        self.last_us = 0
        """Arrival of the last of them, 0 never."""
        self.reason = ""
        """Why, while no good position has come since."""
        self.reports = Throttle(REPORT_AGAIN_US)
        self._counts: dict[str, int] = {}

    def count(self, reason: str) -> None:
        """A value that is left out; the rest of its report may be used."""
        self._counts[reason] = self._counts.get(reason, 0) + 1

    def position(self, t_us: int, reason: str) -> bool:
        """A position that cannot be right; True when the operator should hear of it."""
        self.count(reason)
        self.positions += 1
        self.last_us, self.reason = t_us, reason
        return self.reports.due(reason, t_us)

    @property
    def counts(self) -> tuple[tuple[str, int], ...]:
        """How often for which reason, in order of first occurrence."""
        return tuple(self._counts.items())
