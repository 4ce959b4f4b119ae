"""A place of a recording worked out ahead of the analysis, because somebody looks at it.

Names depend on all that came before, so that the analysis goes from the start to the end. Where one looks ahead of it,
a second fold begins some seconds before that place. Its names are provisional: evidence from before is missing. What
is final is always the analysis from the start; once it has passed, this costs nothing any more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from gcs.playback.snapshot_store import SnapshotStore
from gcs.snapshot import Snapshot

AHEAD_US: Final = 3_000_000
"""Time analysed beyond the place that is looked at: playing does not wait."""
BEFORE_US: Final = 1_000_000
"""Time analysed before that place: a step back finds something."""
JUMP_US: Final = 8_000_000
"""Distance ahead beyond which it is cheaper to start again than to go on."""

Moments = Iterator[tuple[int, Snapshot]]


class Preview:
    """The second fold: one thread advances it, another one may look things up.

    Args:
        begin: fold that is provisional, from a Unix time in µs on.
    """

    def __init__(self, begin: Callable[[int], Moments]) -> None:
        self._begin = begin
        self._moments: Moments = iter(())
        self._start_us: int | None = None
        """Start of the preview, None for nothing."""
        self._found = SnapshotStore()
        self._ended = False

    def wants(self, t_us: int) -> bool:
        """Tell whether something is to be worked out for a place, or beyond it."""
        if not self._is_near(t_us):
            return True
        return not self._ended and (not len(self._found) or self._found.stop_us < t_us + AHEAD_US)

    def advance(self, t_us: int) -> None:
        """Work out one moment more, at or before a place or somewhat beyond it."""
        if not self._is_near(t_us):
            self.clear()
            self._start_us = t_us - BEFORE_US
            self._moments = self._begin(self._start_us)
        moment = next(self._moments, None)
        if moment is None:
            self._ended = True
        else:
            self._found.add(*moment)

    def clear(self) -> None:
        """Let go of all of it."""
        self._moments, self._found, self._ended = iter(()), SnapshotStore(), False
        self._start_us = None

    def at(self, t_us: int) -> tuple[SnapshotStore, int] | None:
        """The snapshot of a moment, and its number; None: it was not worked out."""
        start_us, found = self._start_us, self._found
        if start_us is None or not len(found) or not start_us <= t_us <= found.stop_us:
            return None
        return found, max(found.place(t_us), 0)

    def _is_near(self, t_us: int) -> bool:
        if self._start_us is None:
            return False
        stop_us = self._found.stop_us if len(self._found) else self._start_us
        return self._start_us <= t_us <= max(stop_us, self._start_us) + JUMP_US
