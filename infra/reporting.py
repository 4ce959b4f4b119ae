"""Times to report or try again what goes on without end: each class answers that for one thing, or for one of each key.

Time is whatever the caller counts in, one unit and one clock for an object; counts of rounds will do.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence


class ReportOnce:
    """Filter for texts that are reported once each.

    Args:
        most: texts in all; whoever makes up a new one each time is not worth more.
    """

    def __init__(self, most: int = 30) -> None:
        self._most = most
        self._reported: set[str] = set()

    def new(self, texts: Iterable[str]) -> list[str]:
        """Return the items that were not reported before, in order; now they are."""
        fresh = [text for text in dict.fromkeys(texts) if text not in self._reported]
        fresh = fresh[: self._most - len(self._reported)]
        self._reported.update(fresh)
        return fresh


class Throttle:
    """Filter that lets the same thing be reported again only after a while."""

    __slots__ = ("_every", "_reported")

    def __init__(self, every: float) -> None:
        self._every = every
        self._reported: dict[Hashable, float] = {}

    def due(self, key: Hashable, now: float) -> bool:
        """Tell whether this was not reported for a while; then it counts as reported now. A clock may be set back."""
        last = self._reported.get(key)
        if last is not None and abs(now - last) < self._every:
            return False
        self._reported[key] = now
        return True


class ReportGrowth:
    """Filter for a count that keeps growing: reported at first, whenever it has grown many times, and again after a
    rest.

    Args:
        first: least count that is reported.
        factor: it is reported again when it is this many times what was reported.
        rest: growth after this long without any is as new.
        every: least time between two reports.
    """

    __slots__ = ("_count", "_every", "_factor", "_first", "_grown", "_reported", "_reported_at", "_rest")

    def __init__(self, *, first: int = 1, factor: float = 2.0, rest: float = math.inf, every: float = 0.0) -> None:
        self._first, self._factor, self._rest, self._every = first, factor, rest, every
        self._count = self._reported = 0
        self._grown = self._reported_at = -math.inf

    def due(self, count: int, now: float = 0.0) -> bool:
        """Tell whether a count is to be reported; one that is less than before was started again."""
        if count < self._count:
            self._count = self._reported = 0
        if count == self._count:
            return False
        if abs(now - self._grown) > self._rest:
            self._reported = 0
        self._count, self._grown = count, now
        if count < max(self._first, self._factor * self._reported) or abs(now - self._reported_at) < self._every:
            return False
        self._reported, self._reported_at = count, now
        return True


class Hysteresis:
    """A level of trouble, 0 for none, that is reported when it lasts, and forgotten only when it is over for a while.

    Args:
        rises_after: it must be worse for this long to be reported.
        falls_after: it must be better for this long before it can be reported again.
    """

    __slots__ = ("_better_since", "_falls_after", "_rises_after", "_worse_since", "reported")

    def __init__(self, *, rises_after: float, falls_after: float) -> None:
        self._rises_after, self._falls_after = rises_after, falls_after
        self.reported = 0
        """The level reported last that is not over."""
        self._worse_since = self._better_since = math.inf

    def rises(self, level: int, now: float) -> bool:
        """Note the level of now; whether it is to be reported."""
        self._worse_since = min(self._worse_since, now) if level else math.inf
        self._better_since = min(self._better_since, now) if level < self.reported else math.inf
        if now - self._better_since >= self._falls_after:
            self.reported = level
        if level <= self.reported or now - self._worse_since < self._rises_after:
            return False
        self.reported = level
        return True


class TokenBucket:
    """Token bucket: lets this many a second through for ever, and a burst at once.

    Args:
        burst: tokens when full, as it is at first.
        now_s: seconds; a clock that is set back gives nothing.
    """

    __slots__ = ("_burst", "_per_s", "_tokens", "last_s")

    def __init__(self, per_s: float, burst: float, now_s: float) -> None:
        self._per_s, self._burst, self._tokens = per_s, burst, burst
        self.last_s = now_s
        """Time at which it was asked last."""

    def allows(self, now_s: float) -> bool:
        """Tell whether one more may pass; then it has."""
        self._tokens = min(self._burst, self._tokens + max(0.0, now_s - self.last_s) * self._per_s)
        self.last_s = max(self.last_s, now_s)
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class Backoff:
    """Pauses before something is tried again: longer after each failure in a row.

    Args:
        pauses_s: after the first, second, third failure in a row; the last repeats.
    """

    def __init__(self, pauses_s: Sequence[float]) -> None:
        self._pauses_s = tuple(pauses_s)
        self._failures = 0
        self._next_s = 0.0

    def failed(self) -> float:
        """Pause from now, after one more failure, s."""
        pause_s = self._pauses_s[min(self._failures, len(self._pauses_s) - 1)]
        self._failures += 1
        return pause_s

    def succeeded(self) -> None:
        """End the row."""
        self._failures = 0

    def due(self, now_s: float) -> bool:
        """Tell whether to try now (monotonic), for who does not wait: it counts as failed until it succeeds."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self.failed()
        return True
