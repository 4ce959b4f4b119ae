"""A link that is one byte stream to one other end, a serial port or a TCP connection: opened again after it was lost.

Nothing here waits: a peer that does not answer, or does not take what is sent, never holds up another link.
"""

from __future__ import annotations

import errno
import select
import socket
import time
from abc import abstractmethod

import serial

from infra.reporting import Backoff
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import Batch
from mavlink.links.byte_stream import PATIENCE_S, Connection, FrameStream, queue_bytes
from mavlink.links.url import LinkUrl, network_url, serial_url

PAUSES_S = (0.5, 1.0, 2.0, 4.0)
"""Pauses before the stream is opened again, s."""
_CHUNK = 4096
_FRAME_BITS = 280 * 10
"""The longest frame; a byte goes as ten bits."""
DEFAULT_PORT = 5760
"""TCP port at which ArduPilot's simulator and most bridges listen."""
_TCP_CHUNK = 65536
_CONNECT_S = 5.0
"""An answer that takes longer is not waited for."""
_PENDING = (errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY, errno.EINTR)


class StreamLink(Link):
    """Base of TCP clients and serial ports."""

    def __init__(self, url: LinkUrl, options: LinkOptions) -> None:
        super().__init__(url, options)
        self.connections = 0
        """Number of times that it was opened."""
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
        """Send to the other end, the only peer there is.

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
        """Open the stream again if needed, by :meth:`_opened`."""

    def close(self) -> None:
        """Close the stream."""
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
        """Open the port again when it has come back."""
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


def tcp_connection(sock: socket.socket, frames: FrameStream, options: LinkOptions) -> Connection:
    """An open connection, as a stream of frames."""
    sock.setblocking(False)

    def receive() -> bytes | None:
        try:
            return sock.recv(_TCP_CHUNK)
        except (BlockingIOError, InterruptedError):
            return None
        except (OSError, ValueError):
            return b""

    return Connection(sock, receive, frames, queue_bytes=queue_bytes(options.is_output))


class TcpOut(StreamLink):
    """Connects to a server, and again soon after the connection was lost or refused.

    Raises:
        LinkError: no such host.
    """

    example = "tcp:host:port"

    def __init__(self, url: LinkUrl, options: LinkOptions | None = None) -> None:
        self._options = options or LinkOptions()
        super().__init__(url, self._options)
        self._address = _resolve(url)
        self._calling: socket.socket | None = None
        """A connection that the server has not answered yet."""
        self._give_up_s = 0.0

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Host and port of a server."""
        return network_url("tcp", rest, default_port=DEFAULT_PORT)

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Look the host up: a process that receives must not wait for that."""
        host, port = _resolve(url)
        return LinkUrl(scheme=url.scheme, host=host, port=port), None

    def maintain(self) -> None:
        """Connect when need be."""
        now_s = time.monotonic()
        if self._calling is not None:
            self._look_for_answer(self._calling, now_s)
        elif self._connection is None and self._open and self._backoff.due(now_s):
            self._call(now_s)

    def _call(self, now_s: float) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        code = sock.connect_ex(self._address)
        if code and code not in _PENDING:
            sock.close()
            return
        self._calling, self._give_up_s = sock, now_s + _CONNECT_S
        self._look_for_answer(sock, now_s)

    def _look_for_answer(self, sock: socket.socket, now_s: float) -> None:
        if not select.select([], [sock], [], 0.0)[1]:
            if now_s > self._give_up_s:
                self._hang_up()
            return
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._hang_up()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._calling = None
        self._opened(tcp_connection(sock, FrameStream(self._counters, 1), self._options))

    def _hang_up(self) -> None:
        sock, self._calling = self._calling, None
        if sock is not None:
            sock.close()

    def _lose(self) -> None:
        self._hang_up()
        super()._lose()


def _resolve(url: LinkUrl) -> tuple[str, int]:
    try:
        host, port = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_STREAM)[0][4][:2]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{url.name}: no such host: {error}") from error
    return str(host), int(port)
