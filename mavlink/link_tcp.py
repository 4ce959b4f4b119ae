"""TCP links: one that connects and connects again, one that others connect to. One parser per connection.

Nothing here waits: a peer that does not answer, or does not take what is sent, never holds up another link.
"""

from __future__ import annotations

import errno
import select
import socket
import time
from collections.abc import Set
from dataclasses import dataclass

from mavlink.errors import LinkError
from mavlink.link_batch import Batch
from mavlink.link_owner import owner_of
from mavlink.link_reader import Reader
from mavlink.link_stream import Backoff, Stream
from mavlink.link_tally import LinkCounts, Tally, now_us
from mavlink.link_url import LinkUrl

__all__ = ["TcpIn", "TcpOut", "listen_tcp", "resolve_tcp"]

_CHUNK = 65536
_CLIENTS = 32
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


def listen_tcp(url: LinkUrl) -> socket.socket:
    """A socket that others connect to.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        # for TCP this only lets a port be taken again at once, never by two at a time
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind((url.host, url.port))
        server.listen(_CLIENTS)
        server.setblocking(False)
    except (OSError, UnicodeError) as error:
        server.close()
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            text = f"{url.name}: TCP port {url.port} is in use{owner_of('tcp', url.port)}; stop it or use another"
            raise LinkError(text) from None
        raise LinkError(f"{url.name}: cannot listen: {error}") from error
    return server


def _receive(sock: socket.socket) -> bytes | None:
    """Bytes that are there; empty at the end of the connection, None when there is nothing yet."""
    try:
        return sock.recv(_CHUNK)
    except (BlockingIOError, InterruptedError):
        return None
    except (OSError, ValueError):
        return b""


def _sent(sock: socket.socket, data: bytes) -> bool:
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
        self._backoff = Backoff()
        self._give_up_s = 0.0

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._socket is not None

    @property
    def files(self) -> tuple[int, ...]:
        """What to wait for; nothing while there is no connection."""
        sock = self._socket
        return (sock.fileno(),) if sock is not None else ()

    def take(self) -> Batch:
        """What is there, without waiting; at the end of the connection what was hidden behind an unfinished frame."""
        batch, sock = Batch(), self._socket
        data = _receive(sock) if sock is not None else None
        if data is None:
            return batch
        self._stream.take(data, now_us(), batch)
        if not data:
            self._lose()
        return batch

    def trust(self, peers: Set[int], t_us: int) -> None:
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
        if sock is None:
            raise LinkError(f"{self.name}: not connected")
        if not _sent(sock, data):
            self._lose()
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
        self._socket, self._calling = sock, None
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


@dataclass(slots=True)
class _Client:
    stream: Stream
    heard_s: float
    known: bool = False


class TcpIn(Reader):
    """Lets vehicles or routers connect, each with a parser of its own.

    Args:
        url: the link.
        index: of the link.
        sock: from :func:`listen_tcp`; None: one is made.
        vouch: whether a right checksum makes a client known; otherwise whoever checks signatures calls :meth:`trust`.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    def __init__(self, url: LinkUrl, index: int, sock: socket.socket | None = None, *, vouch: bool = True) -> None:
        super().__init__(url.name, index)
        self._vouch = vouch
        self._tally = Tally()
        self._clients: dict[socket.socket, _Client] = {}
        self.accepted = 0
        """Connections let in so far; also the number of the last."""
        self._server = sock or listen_tcp(url)

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

    @property
    def files(self) -> tuple[int, ...]:
        """What to wait for: the door and every connection."""
        return tuple(sock.fileno() for sock in [self._server, *self._clients]) if self._open else ()

    def take(self) -> Batch:
        """What is there on all connections, without waiting."""
        batch = Batch()
        if self._open:
            self._accept()
            for sock in list(self._clients):
                self._receive(sock, batch)
        return batch

    def trust(self, peers: Set[int], t_us: int) -> None:
        """These clients have proved who they are: they may be sent to."""
        for client in self._clients.values():
            client.known = client.known or client.stream.peer in peers

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to every client that sent good frames; one that does not take it is closed.

        Args:
            data: one frame.
            peer: number of the one client that is to get it; 0: all.

        Raises:
            LinkError: nobody is connected.
        """
        clients = list(self._clients.items())
        known = [sock for sock, client in clients if client.known and peer in (0, client.stream.peer)]
        if not known:
            raise LinkError(f"{self.name}: nobody is connected who was heard")
        for sock in known:
            if not _sent(sock, data):
                self._drop(sock)

    def close(self) -> None:
        """Closes everything; a read in another thread comes back empty."""
        self._open = False
        for sock in [self._server, *self._clients]:
            sock.close()
        self._clients.clear()

    def _accept(self) -> None:
        try:
            sock, _ = self._server.accept()
        except OSError:
            return  # nobody, or gone before it was let in
        if len(self._clients) >= _CLIENTS:
            # whoever says nothing makes room, and of those who do the one who has been silent longest
            order = [(client.known, client.heard_s, other) for other, client in self._clients.items()]
            self._drop(min(order, key=lambda entry: entry[:2])[2])
        sock.setblocking(False)
        self.accepted += 1
        self._clients[sock] = _Client(Stream(self._tally, self.accepted), time.monotonic())

    def _receive(self, sock: socket.socket, batch: Batch) -> None:
        data = _receive(sock)
        client = self._clients.get(sock)
        if data is None or client is None:
            return
        if client.stream.take(data, now_us(), batch):
            client.heard_s = time.monotonic()
            client.known = client.known or self._vouch
        if not data:
            self._drop(sock)

    def _drop(self, sock: socket.socket) -> None:
        self._clients.pop(sock, None)
        sock.close()
