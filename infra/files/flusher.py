"""The thread that has recordings put on the disk and repairs them."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from infra.files.append import AppendFile

_CLOSE_S = 5.0


class Flusher:
    """Maintains some files until it is stopped.

    Args:
        files: maintained in this order, one after the other.
        period_s: from the end of one round to the start of the next.
    """

    def __init__(self, files: Sequence[AppendFile], period_s: float) -> None:
        self._files = files
        self._period_s = period_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread; a disk that hangs is left after five seconds."""
        self._stop.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            for file in self._files:
                file.maintain()
