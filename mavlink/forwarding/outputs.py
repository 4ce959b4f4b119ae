"""Places that frames are forwarded to. None of them ever waits: what cannot be taken at once is dropped and counted.

``udpout:host:port`` sends to one address, ``udpin:host:port`` to whoever sent a good frame there in the last minute,
``tcp:host:port`` connects and connects again, ``tcpin:host:port`` lets others connect, ``/dev/ttyUSB0,57600`` is a
radio.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

import serial

from mavlink.errors import LinkError
from mavlink.links.batch import Batch
from mavlink.links.byte_stream import Stream
from mavlink.links.counters import Tally, now_us
from mavlink.links.port_owner import owner_of
from mavlink.links.url import LinkUrl, parse_url
from mavlink.protocol.framing import split

__all__ = ["Output", "open_output"]

_CHUNK = 65536
_BATCH = 64
_PENDING = 1 << 18
_CLIENTS = 8
_RETRY_S = 2.0
_PEER_S = 60.0

_Address = tuple[str, int]
T = TypeVar("T")


class Output(Protocol):
    """One receiver of forwarded frames."""

    name: str

    @property
    def files(self) -> tuple[int, ...]:
        """File descriptors that become readable when something came back."""

    def write(self, raw: bytes) -> bool:
        """Hands over one whole frame; whether somebody took it."""

    def read(self) -> list[tuple[bytes, str]]:
        """Frames that came back, without waiting, each with the address that it came from."""

    def close(self) -> None:
        """Closes it."""


class _UdpOut:
    """One address; whether anybody listens there is only known when the system says so."""

    def __init__(self, url: LinkUrl) -> None:
        self.name = url.name
        self._nobody = False
        self._who = f"{url.host}:{url.port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect((url.host, url.port))
        except (OSError, UnicodeError) as error:
            self._socket.close()
            raise LinkError(f"{self.name}: no such host to forward to: {error}") from error

    @property
    def files(self) -> tuple[int, ...]:
        return (self._socket.fileno(),)

    def write(self, raw: bytes) -> bool:
        nobody, self._nobody = self._nobody, False
        try:
            self._socket.send(raw)
        except OSError:
            return False
        return not nobody

    def read(self) -> list[tuple[bytes, str]]:
        return [(frame, self._who) for data in _drain(self._receive) for frame in split(data)[0]]

    def _receive(self) -> bytes:
        try:
            return self._socket.recv(_CHUNK)
        except ConnectionRefusedError:  # the answer to the frame before
            self._nobody = True
            raise

    def close(self) -> None:
        self._socket.close()


class _UdpIn:
    """A port that others speak to first."""

    def __init__(self, url: LinkUrl) -> None:
        self.name = url.name
        self._peers: dict[_Address, float] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        _bind(self._socket, url, "udp")

    @property
    def files(self) -> tuple[int, ...]:
        return (self._socket.fileno(),)

    def write(self, raw: bytes) -> bool:
        since_s = time.monotonic() - _PEER_S
        taken = False
        for peer in [peer for peer, heard_s in self._peers.items() if heard_s >= since_s]:
            try:
                self._socket.sendto(raw, peer)
                taken = True
            except OSError:
                continue
        return taken

    def read(self) -> list[tuple[bytes, str]]:
        frames: list[tuple[bytes, str]] = []
        for data, peer in _drain(lambda: self._socket.recvfrom(_CHUNK)):
            good, counts = split(data)
            if counts.good and (peer in self._peers or len(self._peers) < _CLIENTS):
                self._peers[peer] = time.monotonic()
            frames += ((frame, f"{peer[0]}:{peer[1]}") for frame in good)
        self._peers = {peer: s for peer, s in self._peers.items() if s >= time.monotonic() - _PEER_S}
        return frames

    def close(self) -> None:
        self._socket.close()


class _Pipe:
    """A byte stream that keeps frames whole: what it has begun to send it ends before the next."""

    def __init__(self, file: int, who: str) -> None:
        self.file = file
        self.who = who
        """Address of the other end."""
        self._stream = Stream(Tally(), 0)
        self._pending = b""

    def write(self, raw: bytes) -> bool:
        """Takes a frame unless too much waits already; raises OSError when the other end is gone."""
        if len(self._pending) > _PENDING:
            self._flush()
            if len(self._pending) > _PENDING:
                return False
        self._pending += raw
        self._flush()
        return True

    def _flush(self) -> None:
        try:
            if self._pending:
                self._pending = self._pending[os.write(self.file, self._pending) :]
        except BlockingIOError:
            return

    def read(self) -> list[bytes]:
        """Frames that came, after sending what waits; raises OSError when the other end is gone."""
        self._flush()
        data: bytes | None = None
        with contextlib.suppress(BlockingIOError):
            data = os.read(self.file, _CHUNK)
        if data == b"":
            raise ConnectionResetError("closed by the other end")
        batch = Batch()
        self._stream.take(data, now_us(), batch)
        return batch.frames


class _Stream:
    """A connection or a port that is opened again two seconds after it was lost."""

    def __init__(self, name: str, connect: Callable[[], socket.socket | serial.Serial]) -> None:
        self.name = name
        self._connect = connect
        self._held: socket.socket | serial.Serial | None = None
        self._pipe: _Pipe | None = None
        self._next_try_s = 0.0

    @property
    def files(self) -> tuple[int, ...]:
        return () if self._pipe is None else (self._pipe.file,)

    def write(self, raw: bytes) -> bool:
        pipe = self._ready()
        try:
            return pipe is not None and pipe.write(raw)
        except OSError:
            self.close()
            return False

    def read(self) -> list[tuple[bytes, str]]:
        try:
            pipe = self._pipe
            return [(frame, pipe.who) for frame in pipe.read()] if pipe is not None else []
        except OSError:
            self.close()
            return []

    def close(self) -> None:
        if self._held is not None:
            self._held.close()
        self._held = self._pipe = None

    def _ready(self) -> _Pipe | None:
        if self._pipe is None and time.monotonic() >= self._next_try_s:
            self._next_try_s = time.monotonic() + _RETRY_S
            try:
                self._held = self._connect()
                self._pipe = _Pipe(self._held.fileno(), self.name)
            except OSError:
                return None
        return self._pipe


class _TcpIn:
    """Others connect; each gets everything."""

    def __init__(self, url: LinkUrl) -> None:
        self.name = url.name
        self._clients: dict[socket.socket, _Pipe] = {}
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setblocking(False)
        # for TCP this only lets a port be taken again at once, never by two at a time
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        _bind(self._server, url, "tcp")
        self._server.listen(_CLIENTS)

    @property
    def files(self) -> tuple[int, ...]:
        return (self._server.fileno(), *(pipe.file for pipe in self._clients.values()))

    def write(self, raw: bytes) -> bool:
        taken = [self._each(client, lambda pipe: pipe.write(raw), False) for client in list(self._clients)]
        return any(taken)

    def read(self) -> list[tuple[bytes, str]]:
        for client, (host, port) in _drain(self._server.accept):
            if len(self._clients) >= _CLIENTS:
                client.close()
                continue
            client.setblocking(False)
            self._clients[client] = _Pipe(client.fileno(), f"{host}:{port}")
        frames: list[tuple[bytes, str]] = []
        for client in list(self._clients):
            who = self._clients[client].who
            came: list[bytes] = self._each(client, _Pipe.read, [])
            frames += ((frame, who) for frame in came)
        return frames

    def close(self) -> None:
        for sock in [self._server, *self._clients]:
            sock.close()
        self._clients.clear()

    def _each(self, client: socket.socket, act: Callable[[_Pipe], T], gone: T) -> T:
        try:
            return act(self._clients[client])
        except OSError:
            del self._clients[client]
            client.close()
            return gone


def _drain(receive: Callable[[], T]) -> list[T]:
    """Everything that is there now, up to some dozens."""
    got: list[T] = []
    for _ in range(_BATCH):
        try:
            got.append(receive())
        except BlockingIOError:
            break
        except OSError:
            continue  # an earlier datagram of ours found nobody
    return got


def _bind(sock: socket.socket, url: LinkUrl, protocol: str) -> None:
    try:
        sock.bind((url.host, url.port))
    except (OSError, UnicodeError) as error:
        sock.close()
        owner = owner_of("udp" if protocol == "udp" else "tcp", url.port)
        raise LinkError(f"{url.name}: cannot forward from this port{owner}: {error}; use another") from error


def _tcp_out(url: LinkUrl) -> _Stream:
    try:
        address = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_STREAM)[0][4]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{url.name}: no such host to forward to: {error}") from error

    def connect() -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setblocking(False)
        sock.connect_ex(address)  # ends later; until then nothing is taken
        return sock

    return _Stream(url.name, connect)


def _serial_out(url: LinkUrl) -> _Stream:
    def connect() -> serial.Serial:
        return serial.Serial(url.device, url.baud, timeout=0, write_timeout=0, exclusive=True)

    try:
        connect().close()
    except (OSError, ValueError) as error:
        raise LinkError(f"{url.name}: cannot forward to it: {error}; is it plugged in, and free?") from error
    return _Stream(url.name, connect)


_OPENERS: dict[str, Callable[[LinkUrl], Output]] = {
    "udpout": _UdpOut,
    "udpin": _UdpIn,
    "tcpout": _tcp_out,
    "tcpin": _TcpIn,
    "serial": _serial_out,
}


def open_output(url: str) -> Output:
    """Opens a place to forward to.

    Args:
        url: any link URL, see :func:`mavlink.links.url.parse_url`.

    Raises:
        LinkError: bad URL, port in use, no such device or host.
    """
    parsed = parse_url(url)
    return _OPENERS[parsed.kind](parsed)
