"""Serial links, for telemetry radios. A port that is unplugged is opened again when it comes back."""

from __future__ import annotations

import time

import serial

from mavlink.errors import LinkError
from mavlink.link_tally import LinkCounts, Tally, now_us
from mavlink.link_tcp import Stream
from mavlink.link_url import LinkUrl
from mavlink.packet import Packet

__all__ = ["SerialLink"]

_CHUNK = 4096
_RETRY_S = 1.0
_SEND_S = 1.0


class SerialLink:
    """A serial port, taken for this program alone where the system can do that.

    Raises:
        LinkError: no such device, no right to it, or in use.
    """

    def __init__(self, url: LinkUrl, index: int) -> None:
        self.name = url.name
        self._device = url.device
        self._baud = url.baud
        self._index = index
        self._tally = Tally()
        self._stream = Stream(self._tally, index)
        self._open = True
        self._next_try_s = 0.0
        try:
            self._port: serial.Serial | None = self._connect()
        except (OSError, ValueError) as error:
            raise LinkError(f"{self.name}: cannot be opened: {error}; is it plugged in, and free?") from error

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def connected(self) -> bool:
        """Whether the port is there."""
        return self._port is not None

    def read(self, timeout_s: float) -> list[Packet]:
        """Waits for bytes; empty after the timeout, while the port is unplugged and when closed."""
        port = self._port or self._again(timeout_s)
        if port is None:
            return []
        try:
            port.timeout = timeout_s
            first = port.read(1)
            t_us = now_us()
            data = first + port.read(min(port.in_waiting, _CHUNK)) if first else b""
        except (OSError, TypeError):  # pyserial raises TypeError when another thread closes the port
            self._lose()
            return []
        return self._stream.take(data, t_us) if data else []

    def send(self, data: bytes) -> None:
        """Sends to the other end.

        Raises:
            LinkError: the port is unplugged or does not take it.
        """
        port = self._port
        if port is None:
            raise LinkError(f"{self.name}: unplugged")
        try:
            port.write(data)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error}") from error

    def close(self) -> None:
        """Closes the port; a read in another thread comes back empty."""
        self._open = False
        self._lose()

    def _connect(self) -> serial.Serial:
        return serial.Serial(self._device, self._baud, timeout=0, write_timeout=_SEND_S, exclusive=True)

    def _again(self, timeout_s: float) -> serial.Serial | None:
        wait_s = self._next_try_s - time.monotonic()
        if not self._open or wait_s > 0.0:
            time.sleep(max(0.0, min(wait_s, timeout_s)))
            return None
        self._next_try_s = time.monotonic() + _RETRY_S
        try:
            self._port = self._connect()
        except OSError:
            return None
        self._stream = Stream(self._tally, self._index)
        return self._port

    def _lose(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()
