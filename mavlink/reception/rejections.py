"""What a vehicle said that could not be right: counted by reason, told now and then."""

from __future__ import annotations

__all__ = ["Refusals", "Told"]

_REPEATED_US = 30_000_000


class Told:
    """Says whether it is time to tell something again."""

    __slots__ = ("_every_us", "_told")

    def __init__(self, every_us: int = _REPEATED_US) -> None:
        self._every_us = every_us
        self._told: dict[str, int] = {}

    def due(self, text: str, t_us: int) -> bool:
        """Whether this was not told for a while; then it counts as told now."""
        last_us = self._told.get(text)
        if last_us is not None and abs(t_us - last_us) < self._every_us:
            return False
        self._told[text] = t_us
        return True


class Refusals:
    """Counts of one vehicle."""

    def __init__(self) -> None:
        self.positions = 0
        """Positions that could not be right."""
        self.last_us = 0
        """Arrival of the last of them, 0 never."""
        self.reason = ""
        """Why, while no good position has come since."""
        self.told = Told()
        self._counts: dict[str, int] = {}

    def count(self, reason: str) -> None:
        """A value that is left out; the rest of its report may be used."""
        self._counts[reason] = self._counts.get(reason, 0) + 1

    def position(self, t_us: int, reason: str) -> bool:
        """A position that cannot be right; True when the operator should hear of it."""
        self.count(reason)
        self.positions += 1
        self.last_us, self.reason = t_us, reason
        return self.told.due(reason, t_us)

    @property
    def counts(self) -> tuple[tuple[str, int], ...]:
        """How often for which reason, in order of first occurrence."""
        return tuple(self._counts.items())
