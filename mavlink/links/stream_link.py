"""A link that is one byte stream to one other end, opened again soon after it was lost."""

from __future__ import annotations

from abc import abstractmethod

from infra.reporting import Backoff
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import Batch
from mavlink.links.byte_stream import Connection
from mavlink.links.url import LinkUrl

PAUSES_S = (0.5, 1.0, 2.0, 4.0)
"""Before it is opened again."""


class StreamLink(Link):
    """Base of TCP clients and serial ports."""

    def __init__(self, url: LinkUrl, options: LinkOptions) -> None:
        super().__init__(url, options)
        self.connections = 0
        """How often it was opened."""
        self._connection: Connection | None = None
        self._backoff = Backoff(PAUSES_S)

    @property
    def connected(self) -> bool:
        """True if the stream is open, as far as is known."""
        return self._connection is not None and not self._connection.is_broken

    @property
    def overdue(self) -> bool:
        """True if an unfinished frame has hidden others for too long, or the stream is to be closed."""
        return self._connection is not None and self._connection.overdue

    @property
    def fds(self) -> tuple[int, ...]:
        """Descriptors to wait for; nothing while it is lost."""
        return self._connection.fds if self._connection is not None else ()

    def read_batch(self) -> Batch:
        """Batch of what is there, without waiting; at the end of the stream what an unfinished frame hid."""
        batch, connection = Batch(), self._connection
        if connection is not None and not connection.read_into(batch)[0]:
            self._lose()
        return batch

    def read_rest(self) -> Batch:
        """Batch of what an unfinished frame still hides."""
        batch = Batch()
        if self._connection is not None:
            self._connection.frames.add(b"", now_us(), batch)
        return batch

    def send(self, frame: bytes, peer: int = 0) -> bool:
        """Sends to the other end, the only peer there is.

        Raises:
            LinkError: not connected, it broke, or it takes nothing at the moment.
        """
        connection = self._connection
        if connection is None or connection.is_broken:
            raise LinkError(f"{self.name}: not connected")
        if not connection.send(frame):
            raise LinkError(f"{self.name}: the connection broke, or does not take what is sent")
        return True

    @abstractmethod
    def maintain(self) -> None:
        """Opens it again when need be, by :meth:`_opened`."""

    def close(self) -> None:
        """Closes it."""
        self._open = False
        self._lose()

    def _opened(self, connection: Connection) -> None:
        self._connection = connection
        self.connections += 1
        self._backoff.succeeded()

    def _lose(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()
