"""TCP links: one that connects and connects again, one that others connect to. One parser per connection."""

from __future__ import annotations

import errno
import select
import socket
import time

from mavlink.errors import LinkError
from mavlink.frame import FrameCounts, Framer
from mavlink.link_owner import owner_of
from mavlink.link_tally import LinkCounts, Tally, now_us
from mavlink.link_url import LinkUrl
from mavlink.packet import Packet

__all__ = ["Stream", "TcpIn", "TcpOut"]

_CHUNK = 65536
_CLIENTS = 32
_RETRY_S = 1.0
_CONNECT_S = 2.0
_SEND_S = 1.0


class Stream:
    """Packets out of one byte stream, counted.

    Args:
        tally: of the link.
        index: of the link.
    """

    def __init__(self, tally: Tally, index: int) -> None:
        self._framer = Framer()
        self._tally = tally
        self._index = index

    def take(self, data: bytes, t_us: int) -> list[Packet]:
        """The packets that these bytes complete; empty bytes are the end of the stream."""
        before = self._framer.counts
        frames = self._framer.feed(data) if data else self._framer.finish()
        after = self._framer.counts
        self._tally.take(
            len(data),
            FrameCounts(
                after.good - before.good,
                after.bad - before.bad,
                after.junk_bytes - before.junk_bytes,
                after.unknown - before.unknown,
            ),
        )
        return [Packet(t_us, frame, self._index) for frame in frames]


class TcpOut:
    """Connects to a server, and again a second after the connection was lost or refused.

    Raises:
        LinkError: no such host.
    """

    def __init__(self, url: LinkUrl, index: int) -> None:
        self.name = url.name
        self.connections = 0
        """How often it connected."""
        self._index = index
        self._tally = Tally()
        self._stream = Stream(self._tally, index)
        self._socket: socket.socket | None = None
        self._open = True
        self._next_try_s = 0.0
        try:
            self._address = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_STREAM)[0][4]
        except (OSError, UnicodeError) as error:
            raise LinkError(f"{self.name}: no such host: {error}") from error

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._socket is not None

    def read(self, timeout_s: float) -> list[Packet]:
        """Waits for bytes, connecting first when need be; empty after the timeout, on loss and when closed."""
        sock = self._socket or self._connect(timeout_s)
        if sock is None:
            return []
        try:
            if not select.select([sock], [], [], timeout_s)[0]:
                return []
            data = sock.recv(_CHUNK)
        except (OSError, ValueError):
            data = b""
        packets = self._stream.take(data, now_us())
        if not data:
            self._lose()
        return packets

    def send(self, data: bytes) -> None:
        """Sends to the server.

        Raises:
            LinkError: not connected, or the connection broke.
        """
        sock = self._socket
        if sock is None:
            raise LinkError(f"{self.name}: not connected")
        try:
            sock.sendall(data)
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error.strerror or error}") from error

    def close(self) -> None:
        """Closes the connection; a read in another thread comes back empty."""
        self._open = False
        self._lose()

    def _connect(self, timeout_s: float) -> socket.socket | None:
        """A connection, or None after waiting until one may be tried again."""
        wait_s = self._next_try_s - time.monotonic()
        if not self._open or wait_s > 0.0:
            time.sleep(max(0.0, min(wait_s, timeout_s)))
            return None
        self._next_try_s = time.monotonic() + _RETRY_S
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            sock.settimeout(max(0.05, min(timeout_s, _CONNECT_S)))
            sock.connect(self._address)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.settimeout(_SEND_S)
        except OSError:
            sock.close()
            return None
        self._stream = Stream(self._tally, self._index)
        self._socket = sock
        self.connections += 1
        return sock

    def _lose(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()


class TcpIn:
    """Lets vehicles or routers connect, each with a parser of its own.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    def __init__(self, url: LinkUrl, index: int) -> None:
        self.name = url.name
        self._index = index
        self._tally = Tally()
        self._clients: dict[socket.socket, Stream] = {}
        self._open = True
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            # for TCP this only lets a port be taken again at once, never by two at a time
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind((url.host, url.port))
            self._server.listen(_CLIENTS)
            self._server.setblocking(False)
        except (OSError, UnicodeError) as error:
            self._server.close()
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                text = f"{self.name}: TCP port {url.port} is in use{owner_of('tcp', url.port)}; stop it or use another"
                raise LinkError(text) from None
            raise LinkError(f"{self.name}: cannot listen: {error}") from error

    @property
    def counts(self) -> LinkCounts:
        """What came so far, over all connections."""
        return self._tally.counts

    @property
    def clients(self) -> int:
        """Connections that stand."""
        return len(self._clients)

    @property
    def port(self) -> int:
        """Port listened on."""
        port: int = self._server.getsockname()[1]
        return port

    def read(self, timeout_s: float) -> list[Packet]:
        """Waits for bytes on any connection; empty after the timeout and when closed."""
        try:
            ready = select.select([self._server, *self._clients], [], [], timeout_s)[0] if self._open else []
        except (OSError, ValueError):
            if self._open:
                raise
            return []
        packets: list[Packet] = []
        for sock in ready:
            packets += self._accept() if sock is self._server else self._receive(sock)
        return packets

    def send(self, data: bytes) -> None:
        """Sends to every connection; one that does not take it is closed.

        Raises:
            LinkError: nobody is connected.
        """
        clients = list(self._clients)
        if not clients:
            raise LinkError(f"{self.name}: nobody is connected")
        for sock in clients:
            try:
                sock.sendall(data)
            except OSError:
                sock.shutdown(socket.SHUT_RDWR)  # the reading thread then sees its end and takes it out

    def close(self) -> None:
        """Closes everything; a read in another thread comes back empty."""
        self._open = False
        for sock in [self._server, *self._clients]:
            sock.close()
        self._clients.clear()

    def _accept(self) -> list[Packet]:
        try:
            sock, _ = self._server.accept()
        except OSError:
            return []  # gone before it was let in
        if len(self._clients) >= _CLIENTS:
            sock.close()
            return []
        sock.settimeout(_SEND_S)
        self._clients[sock] = Stream(self._tally, self._index)
        return []

    def _receive(self, sock: socket.socket) -> list[Packet]:
        try:
            data = sock.recv(_CHUNK)
        except OSError:
            data = b""
        stream = self._clients.get(sock)
        if stream is None:
            return []
        packets = stream.take(data, now_us())
        if not data:
            self._clients.pop(sock, None)
            sock.close()
        return packets
