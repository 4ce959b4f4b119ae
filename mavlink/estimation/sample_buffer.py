"""What one vehicle said lately: rows ordered by the vehicle's own time, however they arrived."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from typing import Generic, Literal, TypeVar

__all__ = ["History", "Outcome"]

Row = TypeVar("Row")
Outcome = Literal["added", "duplicate", "late"]


class History(Generic[Row]):
    """A bounded list of rows by time.

    Args:
        size: rows kept, at least; never more than twice as many.
        late_us: rows older than the newest by more than this are refused.
    """

    __slots__ = ("_late_us", "_rows", "_size", "_times")

    def __init__(self, size: int = 1000, late_us: int = 3_000_000) -> None:
        self._size = size
        self._late_us = late_us
        self._times: list[int] = []
        self._rows: list[Row] = []

    def __len__(self) -> int:
        return len(self._times)

    def add(self, time_us: int, row: Row) -> Outcome:
        """Puts a row in its place."""
        times = self._times
        if not times or time_us > times[-1]:
            times.append(time_us)
            self._rows.append(row)
            if len(times) > 2 * self._size:
                del times[: self._size], self._rows[: self._size]
            return "added"
        if time_us < times[-1] - self._late_us:
            return "late"
        place = bisect_left(times, time_us)
        if times[place] == time_us:
            return "duplicate"
        times.insert(place, time_us)
        self._rows.insert(place, row)
        return "added"

    def has(self, time_us: int) -> bool:
        """Whether there is a row of exactly this time."""
        place = bisect_left(self._times, time_us)
        return place < len(self._times) and self._times[place] == time_us

    @property
    def last(self) -> tuple[int, Row] | None:
        """The newest row and its time."""
        return (self._times[-1], self._rows[-1]) if self._times else None

    def around(self, time_us: int) -> tuple[tuple[int, Row] | None, tuple[int, Row] | None]:
        """The newest row at or before a time, and the oldest after it."""
        place = bisect_right(self._times, time_us)
        before = (self._times[place - 1], self._rows[place - 1]) if place else None
        after = (self._times[place], self._rows[place]) if place < len(self._times) else None
        return before, after

    def replace(self, change: Callable[[list[Row]], list[Row]]) -> None:
        """Puts other rows in the place of all, in the same order."""
        if self._rows:
            self._rows = change(self._rows)

    def clear(self) -> None:
        """Forgets everything."""
        self._times.clear()
        self._rows.clear()
