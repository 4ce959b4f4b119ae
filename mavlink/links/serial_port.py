"""Serial links, for telemetry radios. A port that is unplugged is opened again when it comes back."""

from __future__ import annotations

import time

import serial

from mavlink.errors import LinkError
from mavlink.links.batch import Batch, Claim
from mavlink.links.byte_stream import PATIENCE_S, Backoff, Stream
from mavlink.links.counters import LinkCounts, Tally, now_us
from mavlink.links.reader import Reader
from mavlink.links.url import LinkUrl

__all__ = ["SerialLink"]

_CHUNK = 4096
_FRAME_BITS = 280 * 10
"""The longest frame; a byte goes as ten bits."""


class SerialLink(Reader):
    """A serial port, taken for this program alone where the system can do that. Nothing here waits.

    Args:
        url: the link.
        index: of the link.
        must: whether the port must be there now; otherwise it is waited for.

    Raises:
        LinkError: no such device, no right to it, or in use.
    """

    def __init__(self, url: LinkUrl, index: int, *, must: bool = True) -> None:
        super().__init__(url.name, index)
        self.connections = 0
        """How often the port was opened."""
        self._device = url.device
        self._baud = url.baud
        self._tally = Tally()
        self._stream = self._new_stream()
        self._backoff = Backoff()
        self._port: serial.Serial | None = None
        try:
            self._plug_in()
        except (OSError, ValueError) as error:
            if must:
                raise LinkError(f"{self.name}: cannot be opened: {error}; is it plugged in, and free?") from error

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def connected(self) -> bool:
        """Whether the port is there."""
        return self._port is not None

    @property
    def files(self) -> tuple[int, ...]:
        """What to wait for; nothing while it is unplugged, or where ports cannot be waited for."""
        port = self._port
        try:
            return (port.fileno(),) if port is not None else ()
        except (OSError, ValueError):
            return ()

    @property
    def overdue(self) -> bool:
        """Whether an unfinished frame has hidden others for too long."""
        return self._port is not None and self._stream.overdue

    def take(self) -> Batch:
        """What is there, without waiting; nothing while the port is unplugged and when closed."""
        batch, port = Batch(), self._port
        if port is None:
            return batch
        try:
            waiting = port.in_waiting
            # a port that can be read and has nothing is one that was unplugged: the read then says so
            data = port.read(min(max(waiting, 1), _CHUNK))
        except (OSError, TypeError):  # pyserial raises TypeError when another thread closes the port
            self._lose()
            return self.rest()
        self._stream.take(data or None, now_us(), batch)
        return batch

    def rest(self) -> Batch:
        """What an unfinished frame still hides."""
        batch = Batch()
        self._stream.take(b"", now_us(), batch)
        return batch

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """The device was chosen by whoever wrote the URL; nothing more is to be known."""

    def tend(self) -> None:
        """Opens the port again when it has come back."""
        if self._port is None and self._open and self._backoff.due(time.monotonic()):
            try:
                self._plug_in()
            except (OSError, ValueError):
                return  # not yet

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to the other end, the only peer there is.

        Raises:
            LinkError: the port is unplugged or does not take it.
        """
        port = self._port
        if port is None:
            raise LinkError(f"{self.name}: unplugged")
        try:
            taken = port.write(data)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error}") from error
        if taken != len(data):
            raise LinkError(f"{self.name}: cannot send: the port is busy")

    def close(self) -> None:
        """Closes the port; a read in another thread comes back empty."""
        self._open = False
        self._lose()

    def _new_stream(self) -> Stream:
        # twice what the longest frame takes at this rate, where that is longer than anybody pauses
        return Stream(self._tally, 1, patience_s=max(PATIENCE_S, 2.0 * _FRAME_BITS / self._baud))

    def _plug_in(self) -> None:
        self._port = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
        self.connections += 1
        self._stream = self._new_stream()
        self._backoff.succeeded()

    def _lose(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()
