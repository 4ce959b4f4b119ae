"""What is told once: the air repeats itself, an operator's event log should not."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["Once"]


class Once:
    """Texts that were told already.

    Args:
        most: texts told in all; whoever sends a new one each time is not worth more.
    """

    def __init__(self, most: int = 30) -> None:
        self._most = most
        self._told: set[str] = set()

    def new(self, texts: Iterable[str]) -> list[str]:
        """Those that were not told before, in order."""
        fresh = [text for text in dict.fromkeys(texts) if text not in self._told][: self._most - len(self._told)]
        self._told.update(fresh)
        return fresh
