"""How often something comes, measured over the last seconds."""

from __future__ import annotations

__all__ = ["Arrivals"]

_WINDOW_US = 2_000_000


class Arrivals:
    """Counts arrivals in windows that begin and end with one: a steady sender's rate comes out exactly."""

    __slots__ = ("_count", "_hz", "_since_us", "last_us")

    def __init__(self) -> None:
        self.last_us = 0
        """Unix µs of the newest arrival, 0 never."""
        self._since_us = 0
        self._count = 0
        self._hz = 0.0

    def take(self, t_us: int) -> None:
        """Counts one arrival."""
        self.last_us = t_us
        if not self._since_us:
            self._since_us = t_us
            return
        self._count += 1
        elapsed_us = t_us - self._since_us
        if elapsed_us >= _WINDOW_US or elapsed_us < 0:
            self._hz = self._count / elapsed_us * 1e6 if elapsed_us > 0 else 0.0
            self._since_us, self._count = t_us, 0

    def hz(self, t_us: int) -> float:
        """Arrivals a second at a Unix time in µs; falls towards 0 while nothing comes."""
        elapsed_us = t_us - self._since_us
        if elapsed_us <= 0 or not self._since_us:
            return self._hz
        overdue = elapsed_us > _WINDOW_US + (2e6 / self._hz if self._hz else 0.0)
        return self._count / elapsed_us * 1e6 if overdue or not self._hz else self._hz
