"""The wall clock, and when it is set."""

from __future__ import annotations

import time
from collections.abc import Callable

STEP_US = 50_000
"""A clock that is set by less is taken for one that is slewed."""
_READ_NS = 5_000_000
"""Time between the readings of two clocks beyond which they are not compared: the thread was held up between them."""


def now_us() -> int:
    """Unix time, µs."""
    return time.time_ns() // 1000


def steady_us(t_us: int) -> int:
    """A past Unix time on the monotonic clock, which nobody sets, µs.

    How long ago it was is read off the wall clock, so that it does not matter how late this is asked. Where the wall
    clock was set back in between it is now.

    Args:
        t_us: Unix µs.
    """
    return time.monotonic_ns() // 1000 - max(now_us() - t_us, 0)


class ClockWatch:
    """Compares the wall clock with the monotonic one, which cannot be set; slewing moves both and is no step.

    Args:
        wall_ns: Unix ns.
        monotonic_ns: ns since some fixed moment.

    Attributes:
        offset_us: wall minus monotonic when last looked at, µs.
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall_ns, self._monotonic_ns = wall_ns, monotonic_ns
        self.offset_us = (wall_ns() - monotonic_ns()) // 1000

    def now_us(self) -> int:
        """Time of the monotonic clock, µs."""
        return self._monotonic_ns() // 1000

    def stepped(self) -> int | None:
        """The offset before, µs, when the clock was set by more than 50 ms since the last look; None: it was not."""
        before_ns = self._monotonic_ns()
        offset_us = (self._wall_ns() - before_ns) // 1000
        moved_us = offset_us - self.offset_us
        if -STEP_US <= moved_us <= STEP_US:
            self.offset_us = offset_us
            return None
        if self._monotonic_ns() - before_ns > _READ_NS:
            return None
        previous_us, self.offset_us = self.offset_us, offset_us
        return previous_us
