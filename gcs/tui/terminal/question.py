"""Asking the terminal before the screens begin; its replies are taken whole: no end of one is left as keys."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time
import tty
from codecs import getincrementaldecoder
from typing import Final

from gcs.tui.terminal.replies import Replies

LAST_QUESTION: Final = b"\x1b[c"
"""The primary device attributes, to which all terminals reply, and in order: then no other reply will come."""
WAIT_S: Final = 0.3
"""Time for the replies: a slow line's way and back. Those that come later are no keys to the screens either."""
REST_S: Final = 0.2
"""Time for the rest of a reply that has begun."""


def ask(reads: int, writes: int, questions: bytes) -> list[str]:
    """Reply of a terminal, ending with its device attributes; less where it is slow or does not know them.

    Keys pressed meanwhile are dropped: nobody has seen yet what they would act on.
    """
    found: list[str] = []
    replies = Replies(found.append)
    decode = getincrementaldecoder("utf-8")("replace").decode
    with contextlib.suppress(OSError, termios.error):
        before = termios.tcgetattr(reads)
        try:
            tty.setcbreak(reads, termios.TCSANOW)
            os.write(writes, questions + LAST_QUESTION)
            until_s = time.monotonic() + WAIT_S
            while not any(reply.startswith("\x1b[?") and reply.endswith("c") for reply in found):
                left_s = until_s + (REST_S if replies.hold_s is not None else 0.0) - time.monotonic()
                data = os.read(reads, 1024) if left_s > 0 and select.select([reads], [], [], left_s)[0] else b""
                if not data:
                    break
                replies.keys_in(decode(data))
        finally:
            termios.tcsetattr(reads, termios.TCSANOW, before)
    return found
