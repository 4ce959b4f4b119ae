"""Reading a link by itself, one thread to a link; the ingest process waits for all its links at once instead."""

from __future__ import annotations

import select
import time
from abc import ABC, abstractmethod

from mavlink.links.batch import Batch
from mavlink.protocol.packet import Packet

__all__ = ["Reader"]

_STEP_S = 0.05


class Reader(ABC):
    """What all links have in common: a name, an index, and waiting for whatever :meth:`take` then gives.

    Args:
        name: the link's URL.
        index: put into every packet as its ``link``.
    """

    def __init__(self, name: str, index: int) -> None:
        self.name = name
        self._index = index
        self._open = True

    @property
    @abstractmethod
    def files(self) -> tuple[int, ...]:
        """File descriptors to wait for; they change as connections come and go."""

    @property
    def overdue(self) -> bool:
        """Whether :meth:`take` may have something though no file is ready."""
        return False

    @abstractmethod
    def take(self) -> Batch:
        """What is there, without waiting."""

    def rest(self) -> Batch:
        """What was held back so far, before the link is closed."""
        return Batch()

    def tend(self) -> None:  # noqa: B027 - most links need none
        """Looks after the link; to be called every tenth of a second or so."""

    def address(self, peer: int) -> str:
        """Host and port of a sender; empty where there is none or it is not known."""
        del peer
        return ""

    def read(self, timeout_s: float) -> list[Packet]:
        """Waits for packets; empty after the timeout and when closed."""
        stop_s = time.monotonic() + timeout_s
        while self._open:
            self.tend()
            batch = self.take()
            left_s = stop_s - time.monotonic()
            if batch.frames or left_s <= 0.0:
                return batch.packets(self._index)
            self._wait(min(left_s, _STEP_S))
        return []

    def _wait(self, timeout_s: float) -> None:
        files = [file for file in self.files if file >= 0]
        try:
            if files:
                select.select(files, [], [], timeout_s)
            else:
                time.sleep(timeout_s)
        except (OSError, ValueError):
            return  # closed by another thread: take says so
