"""A TCP link that others connect to, with a parser for each connection. Nothing here waits for any of them."""

from __future__ import annotations

import errno
import socket
import time
from dataclasses import dataclass

from mavlink.errors import LinkError
from mavlink.links.batch import Batch, Claim
from mavlink.links.byte_stream import Stream
from mavlink.links.counters import LinkCounts, Tally, now_us
from mavlink.links.port_owner import owner_of
from mavlink.links.reader import Reader
from mavlink.links.tcp_client import receive_now, send_now
from mavlink.links.url import LinkUrl

__all__ = ["TcpIn", "listen_tcp"]

_CLIENTS = 32


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


@dataclass(slots=True)
class _Client:
    stream: Stream
    address: str
    heard_s: float
    known: bool = False
    broken: bool = False
    """Whether it does not take what is sent: what has come from it is read before it is closed."""


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

    def addresses(self) -> dict[int, str]:
        """Number → host and port of those who are connected."""
        return {client.stream.peer: client.address for client in self._clients.values()}

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
            self._accept(batch)
            for sock in list(self._clients):
                self._receive(sock, batch)
        return batch

    @property
    def overdue(self) -> bool:
        """Whether an unfinished frame of somebody has hidden others for too long, or somebody is to be closed."""
        return any(client.broken or client.stream.overdue for client in self._clients.values())

    def rest(self) -> Batch:
        """What unfinished frames still hide."""
        batch = Batch()
        for client in self._clients.values():
            client.stream.take(b"", now_us(), batch)
        return batch

    def address(self, peer: int) -> str:
        """Host and port of one who is connected, empty for others."""
        return self.addresses().get(peer, "")

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """These clients have proved who they are: they may be sent to."""
        peers = {peer for peer, _ in claims}
        for client in self._clients.values():
            client.known = client.known or client.stream.peer in peers

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to every client that sent good frames, or to one; one that does not take it is closed.

        Args:
            data: one frame.
            peer: number of the only client that is to get it, of whom nothing else is asked; 0: all of them.

        Raises:
            LinkError: nobody is connected.
        """
        clients = list(self._clients.items())
        open_ = [(sock, client) for sock, client in clients if not client.broken]
        known = [sock for sock, client in open_ if (client.stream.peer == peer if peer else client.known)]
        if not known:
            raise LinkError(f"{self.name}: nobody is connected who was heard")
        for sock in known:
            if not send_now(sock, data):
                self._clients[sock].broken = True

    def close(self) -> None:
        """Closes everything; a read in another thread comes back empty."""
        self._open = False
        for sock in [self._server, *self._clients]:
            sock.close()
        self._clients.clear()

    def _accept(self, batch: Batch) -> None:
        try:
            sock, (host, port) = self._server.accept()
        except OSError:
            return  # nobody, or gone before it was let in
        if len(self._clients) >= _CLIENTS:
            # whoever says nothing makes room, and of those who do the one who has been silent longest
            order = [(client.known, client.heard_s, other) for other, client in self._clients.items()]
            oldest = min(order, key=lambda entry: entry[:2])[2]
            self._receive(oldest, batch)
            self._drop(oldest, batch)
        sock.setblocking(False)
        self.accepted += 1
        self._clients[sock] = _Client(Stream(self._tally, self.accepted), f"{host}:{port}", time.monotonic())

    def _receive(self, sock: socket.socket, batch: Batch) -> None:
        data, client = receive_now(sock), self._clients[sock]
        if data is None and client.broken:
            data = b""
        if client.stream.take(data, now_us(), batch):
            client.heard_s = time.monotonic()
            client.known = client.known or self._vouch
        if data == b"":
            self._drop(sock, batch)

    def _drop(self, sock: socket.socket, batch: Batch) -> None:
        """Closes a connection; what its last unfinished frame hides comes out."""
        client = self._clients.pop(sock, None)
        if client is not None:
            client.stream.take(b"", now_us(), batch)
        sock.close()
