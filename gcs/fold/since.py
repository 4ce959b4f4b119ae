"""Record of since when something has had the value that it has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")

BRIEF_US = 1_000_000
"""An interruption shorter than this does not count: a detector misses a vehicle for a few frames and sees it again."""
MAX_KEYS = 1000
"""Keys that are remembered: tracks of minutes."""


@dataclass(slots=True)
class _Lasting(Generic[Value]):
    value: Value
    since_us: int
    before: Value
    """State before that, and since when."""
    before_us: int


class Since(Generic[Key, Value]):
    """Remembers for each key since when it has had its value."""

    def __init__(self) -> None:
        self._lasting: dict[Key, _Lasting[Value]] = {}

    def update(self, t_us: int, key: Key, value: Value) -> int:
        """Take in a value; return since when the key has had it, apart from brief interruptions."""
        known = self._lasting.pop(key, None) or _Lasting(value, t_us, value, t_us)
        if value != known.value:
            back = value == known.before and t_us - known.since_us < BRIEF_US
            known = _Lasting(value, known.before_us if back else t_us, known.value, known.since_us)
        # put in again, the key that was not asked for longest is the first
        self._lasting[key] = known
        if len(self._lasting) > MAX_KEYS:
            del self._lasting[next(iter(self._lasting))]
        return known.since_us
