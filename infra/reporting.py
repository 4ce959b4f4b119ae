"""When to do or say a thing again that would otherwise repeat without end."""

from __future__ import annotations

__all__ = ["Backoff"]


class Backoff:
    """When to try again: twice as long after each failure, and soon again after a success.

    Args:
        first_s: wait after the first failure.
        most_s: longest wait.
    """

    def __init__(self, first_s: float = 0.5, most_s: float = 4.0) -> None:
        self._first_s, self._most_s = first_s, most_s
        self._wait_s = first_s
        self._next_s = 0.0

    def due(self, now_s: float) -> bool:
        """Whether it may be tried now (monotonic seconds); the next time is then later."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._wait_s
        self._wait_s = min(2.0 * self._wait_s, self._most_s)
        return True

    def succeeded(self) -> None:
        """What was tried worked."""
        self._wait_s = self._first_s
