"""Instead of a time: waiting for what other threads and processes do, and counting how much work a call is."""

import sys
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


def calls_of(work: Callable[[], object]) -> int:
    """Calls of Python and compiled functions that some work makes in this thread."""
    calls = 0

    def count(frame, event, arg):
        nonlocal calls
        calls += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        work()
    finally:
        sys.setprofile(before)
    return calls


def instructions_of(work: Callable[[], object]) -> int:
    """Instructions of Python's virtual machine that some work takes in this thread."""
    instructions = 0

    def count(frame, event, arg):
        nonlocal instructions
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        instructions += event == "opcode"
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        work()
    finally:
        sys.settrace(before)
    return instructions
