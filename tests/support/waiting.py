"""Waiting for what other threads and processes do."""

import time
from collections.abc import Callable

POLL_S = 0.005


def until(condition: Callable[[], object], timeout_s: float = 60.0) -> bool:
    """Whether a condition comes to hold in time; returns as soon as it does."""
    stop_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() >= stop_s:
            return False
        time.sleep(POLL_S)
    return True
