"""Signals that ask a process to end, noted for its main thread to look at."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(slots=True)
class AskedBySignals:
    """Requests by signals so far.

    Plain values, not events: a handler that interrupts the thread that waits for an event, while that holds the event's
    lock, would wait for the lock for ever.
    """

    to_end: bool = False
    """True once SIGINT or SIGTERM asked for the end."""
    hung_up: bool = False
    """SIGHUP came: the terminal may be gone; whoever has dealt with that resets it."""


@contextlib.contextmanager
def noted_signals() -> Iterator[AskedBySignals]:
    """Note SIGINT, SIGTERM and SIGHUP, of which none then ends or interrupts anything, as often as it comes.

    For the main thread.
    """
    asked = AskedBySignals()

    def end(*_: object) -> None:
        asked.to_end = True

    def hang_up(*_: object) -> None:
        asked.hung_up = True

    handlers = {signal.SIGINT: end, signal.SIGTERM: end, signal.SIGHUP: hang_up}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
