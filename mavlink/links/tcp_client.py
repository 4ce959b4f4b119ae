"""A TCP link that connects, and connects again.

Nothing here waits: a peer that does not answer, or does not take what is sent, never holds up another link.
"""

from __future__ import annotations

import errno
import select
import socket
import time

from mavlink.errors import LinkError
from mavlink.links.batch import Batch, Claim
from mavlink.links.byte_stream import Backoff, Stream
from mavlink.links.counters import LinkCounts, Tally, now_us
from mavlink.links.reader import Reader
from mavlink.links.url import LinkUrl

__all__ = ["TcpOut", "receive_now", "resolve_tcp", "send_now"]

_CHUNK = 65536
_CONNECT_S = 5.0
_PENDING = (errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY, errno.EINTR)


def resolve_tcp(url: LinkUrl) -> tuple[str, int]:
    """Address of a host.

    Raises:
        LinkError: no such host.
    """
    try:
        host, port = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_STREAM)[0][4][:2]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{url.name}: no such host: {error}") from error
    return str(host), int(port)


def receive_now(sock: socket.socket) -> bytes | None:
    """Bytes that are there; empty at the end of the connection, None when there is nothing yet."""
    try:
        return sock.recv(_CHUNK)
    except (BlockingIOError, InterruptedError):
        return None
    except (OSError, ValueError):
        return b""


def send_now(sock: socket.socket, data: bytes) -> bool:
    """Whether all of it was taken at once: half a frame spoils what follows."""
    try:
        return sock.send(data) == len(data)
    except OSError:
        return False


class TcpOut(Reader):
    """Connects to a server, and again soon after the connection was lost or refused.

    Args:
        url: the link.
        index: of the link.
        address: from :func:`resolve_tcp`; None: it is looked up.

    Raises:
        LinkError: no such host.
    """

    def __init__(self, url: LinkUrl, index: int, address: tuple[str, int] | None = None) -> None:
        super().__init__(url.name, index)
        self.connections = 0
        """How often it connected."""
        self._address = address or resolve_tcp(url)
        self._tally = Tally()
        self._stream = Stream(self._tally, 1)
        self._socket: socket.socket | None = None
        self._calling: socket.socket | None = None
        self._broken = False
        """Whether the connection does not take what is sent: what has come is read before it is let go."""
        self._backoff = Backoff()
        self._give_up_s = 0.0

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._socket is not None and not self._broken

    @property
    def overdue(self) -> bool:
        """Whether an unfinished frame has hidden others for too long, or the connection is to be let go."""
        return self._socket is not None and (self._broken or self._stream.overdue)

    @property
    def files(self) -> tuple[int, ...]:
        """What to wait for; nothing while there is no connection."""
        sock = self._socket
        return (sock.fileno(),) if sock is not None else ()

    def take(self) -> Batch:
        """What is there, without waiting; at the end of the connection what was hidden behind an unfinished frame."""
        batch, sock = Batch(), self._socket
        if sock is None:
            return batch
        data = receive_now(sock)
        if data is None and self._broken:
            data = b""
        self._stream.take(data, now_us(), batch)
        if data == b"":
            self._lose()
        return batch

    def rest(self) -> Batch:
        """What an unfinished frame still hides."""
        batch = Batch()
        self._stream.take(b"", now_us(), batch)
        return batch

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """The server was chosen by whoever wrote the URL; nothing more is to be known."""

    def tend(self) -> None:
        """Connects when need be."""
        now_s = time.monotonic()
        if self._calling is not None:
            self._answered(self._calling, now_s)
        elif self._socket is None and self._open and self._backoff.due(now_s):
            self._call(now_s)

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to the server, the only peer there is.

        Raises:
            LinkError: not connected, or the connection broke.
        """
        sock = self._socket
        if sock is None or self._broken:
            raise LinkError(f"{self.name}: not connected")
        if not send_now(sock, data):
            self._broken = True
            raise LinkError(f"{self.name}: the connection broke, or does not take what is sent")

    def close(self) -> None:
        """Closes the connection; a read in another thread comes back empty."""
        self._open = False
        self._lose()

    def _call(self, now_s: float) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        code = sock.connect_ex(self._address)
        if code and code not in _PENDING:
            sock.close()
            return
        self._calling, self._give_up_s = sock, now_s + _CONNECT_S
        self._answered(sock, now_s)

    def _answered(self, sock: socket.socket, now_s: float) -> None:
        """Looks whether the server has answered."""
        if not select.select([], [sock], [], 0.0)[1]:
            if now_s > self._give_up_s:
                self._hang_up()
            return
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._hang_up()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connections += 1
        self._stream = Stream(self._tally, 1)
        self._socket, self._calling, self._broken = sock, None, False
        self._backoff.succeeded()

    def _hang_up(self) -> None:
        sock, self._calling = self._calling, None
        if sock is not None:
            sock.close()

    def _lose(self) -> None:
        self._hang_up()
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()
