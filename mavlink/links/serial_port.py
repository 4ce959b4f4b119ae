"""Serial links, for telemetry radios. A port that is unplugged is opened again when it comes back."""

from __future__ import annotations

import time

import serial

from mavlink.errors import LinkError
from mavlink.links.base import LinkOptions
from mavlink.links.byte_stream import PATIENCE_S, Connection, FrameStream, queue_bytes
from mavlink.links.stream_link import StreamLink
from mavlink.links.url import LinkUrl, serial_url

_CHUNK = 4096
_FRAME_BITS = 280 * 10
"""The longest frame; a byte goes as ten bits."""


class SerialLink(StreamLink):
    """A serial port, taken for this program alone where the system can do that. Nothing here waits.

    Raises:
        LinkError: no such device, no right to it, or in use.
    """

    example = "/dev/ttyUSB0,57600"

    def __init__(self, url: LinkUrl, options: LinkOptions | None = None) -> None:
        options = options or LinkOptions()
        super().__init__(url, options)
        self._device = url.device
        self._baud = url.baud
        self._queue_bytes = queue_bytes(options.is_output)
        try:
            self._plug_in()
        except (OSError, ValueError) as error:
            if not options.waits_for_device:
                raise LinkError(f"{self.name}: cannot be opened: {error}; is it plugged in, and free?") from error

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """A device and its baud rate."""
        return serial_url(rest)

    def maintain(self) -> None:
        """Opens the port again when it has come back."""
        if self._connection is None and self._open and self._backoff.due(time.monotonic()):
            try:
                self._plug_in()
            except (OSError, ValueError):
                return  # not yet

    def _plug_in(self) -> None:
        port = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
        frames = FrameStream(self._counters, 1, patience_s=patience_s(self._baud))
        self._opened(Connection(port, lambda: _receive(port), frames, queue_bytes=self._queue_bytes))


def patience_s(baud: int) -> float:
    """Twice what the longest frame takes at this rate, where that is longer than any sender pauses."""
    return max(PATIENCE_S, 2.0 * _FRAME_BITS / baud)


def _receive(port: serial.Serial) -> bytes | None:
    """Bytes that are there, None when nothing is, empty where the port is gone."""
    try:
        # a port that can be read and has nothing is one that was unplugged: the read then fails
        return port.read(min(max(port.in_waiting, 1), _CHUNK)) or None
    except (OSError, TypeError):  # pyserial raises TypeError when another thread closes the port
        return b""
