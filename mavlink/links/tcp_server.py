"""A TCP link that others connect to, with a parser for each connection. Nothing here waits for any of them."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass, replace

from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import Batch, Claim
from mavlink.links.byte_stream import Connection, FrameStream
from mavlink.links.port_owner import cannot_listen
from mavlink.links.report import LinkReport
from mavlink.links.stream_link import DEFAULT_PORT, tcp_connection
from mavlink.links.url import LinkUrl, network_url

_SENDERS, _RECEIVERS = 32, 8
"""Connections at a time: of senders to this station, and of programs that packets are forwarded to."""


@dataclass(slots=True)
class _Client:
    connection: Connection
    address: str
    received_s: float
    """Time at which it last sent a good frame, or connected; monotonic."""
    known: bool


class TcpIn(Link):
    """Lets vehicles or routers connect, each with a parser of its own; or programs, to forward to.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    example = "tcpin:0.0.0.0:5760"

    def __init__(self, url: LinkUrl, options: LinkOptions | None = None) -> None:
        self._options = options or LinkOptions()
        super().__init__(url, self._options)
        self._clients: dict[socket.socket, _Client] = {}
        self._accepted = 0
        self._server = self._options.sock or _listen(url)

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Address and port to listen on."""
        return network_url("tcpin", rest, default_port=DEFAULT_PORT, default_host="0.0.0.0")

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Take the port, which then outlives the process that receives."""
        return url, _listen(url)

    @property
    def last_peer(self) -> int:
        """Connections let in so far; also the number of the last."""
        return self._accepted

    @property
    def clients(self) -> int:
        """Open connections."""
        return len(self._clients)

    @property
    def port(self) -> int:
        """Port listened on."""
        port: int = self._server.getsockname()[1]
        return port

    @property
    def fds(self) -> tuple[int, ...]:
        """Descriptors to wait for: the listening socket and every connection."""
        return tuple(sock.fileno() for sock in [self._server, *self._clients]) if self._open else ()

    @property
    def overdue(self) -> bool:
        """True if a connection has an unfinished frame that has hidden others for too long, or is to be closed."""
        return any(client.connection.overdue for client in self._clients.values())

    def read_batch(self) -> Batch:
        """Batch of what is there on all connections, without waiting."""
        batch = Batch()
        if self._open:
            self._accept(batch)
            for sock in list(self._clients):
                self._receive(sock, batch)
        return batch

    def read_rest(self) -> Batch:
        """Batch of what unfinished frames still hide."""
        batch = Batch()
        for client in self._clients.values():
            client.connection.frames.add(b"", now_us(), batch)
        return batch

    def address(self, peer: int) -> str:
        """Host and port of a connected client, empty for others."""
        return self._addresses().get(peer, "")

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """Mark clients as known: they may be sent to."""
        peers = {peer for peer, _ in claims}
        for client in self._clients.values():
            client.known = client.known or client.connection.frames.peer in peers

    def send(self, frame: bytes, peer: int = 0) -> bool:
        """Send to every client that is known, or to one.

        Args:
            peer: number of the one client that is to get it, known or not; 0: all that are known.

        Raises:
            LinkError: no such client is connected.
        """
        clients = [client.connection for client in list(self._clients.values()) if client.known or peer]
        wanted = [each for each in clients if not each.is_broken and peer in (0, each.frames.peer)]
        if not wanted:
            raise LinkError(f"{self.name}: no sender of good frames is connected")
        return any([each.send(frame) for each in wanted])

    def report(self) -> LinkReport:
        """State of the link, with its clients."""
        return replace(super().report(), peers=self.clients, others=tuple(self._addresses().items()))

    def resume(self, before: LinkReport) -> None:
        """Numbers go on where they ended; the connections themselves have ended with the process before."""
        self._accepted = before.last_peer

    def close(self) -> None:
        """Close everything."""
        self._open = False
        for sock in [self._server, *self._clients]:
            sock.close()
        self._clients.clear()

    def _addresses(self) -> dict[int, str]:
        """Number → host and port of those who are connected."""
        return {client.connection.frames.peer: client.address for client in self._clients.values()}

    def _accept(self, batch: Batch) -> None:
        try:
            sock, (host, port) = self._server.accept()
        except OSError:
            return  # no client, or gone before it was accepted
        if self._options.is_output and len(self._clients) >= _RECEIVERS:
            sock.close()  # clients here only listen: none is closed for being silent
            return
        if len(self._clients) >= _SENDERS:
            # closed first: clients that never sent a frame, of the others the one that was silent longest
            order = [(client.known, client.received_s, other) for other, client in self._clients.items()]
            oldest = min(order, key=lambda entry: entry[:2])[2]
            self._receive(oldest, batch)
            self._drop(oldest, batch)
        self._accepted += 1
        connection = tcp_connection(sock, FrameStream(self._counters, self._accepted), self._options)
        self._clients[sock] = _Client(connection, f"{host}:{port}", time.monotonic(), known=self._options.is_output)

    def _receive(self, sock: socket.socket, batch: Batch) -> None:
        client = self._clients[sock]
        goes_on, good = client.connection.read_into(batch)
        if good:
            client.received_s = time.monotonic()
            client.known = client.known or self._options.trusts_checksums
        if not goes_on:
            self._drop(sock, batch)

    def _drop(self, sock: socket.socket, batch: Batch) -> None:
        """Close a connection; what its last unfinished frame hides comes out."""
        client = self._clients.pop(sock, None)
        if client is not None:
            client.connection.frames.add(b"", now_us(), batch)
        sock.close()


def _listen(url: LinkUrl) -> socket.socket:
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        # for TCP this only lets a port be taken again at once, never by two at a time
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind((url.host, url.port))
        server.listen(_SENDERS)
        server.setblocking(False)
    except (OSError, UnicodeError) as error:
        server.close()
        raise cannot_listen(url, "tcp", error) from error
    return server
