"""UDP links. No frame ever crosses a datagram, so nothing a stranger sends can spoil what another sent."""

from __future__ import annotations

import errno
import select
import socket
import struct
import sys

from mavlink.errors import LinkError
from mavlink.frame import split
from mavlink.link_owner import owner_of
from mavlink.link_tally import LinkCounts, Tally, now_us
from mavlink.link_url import LinkUrl
from mavlink.packet import Packet

__all__ = ["UdpIn", "UdpOut"]

_BUFFER_BYTES = 8 << 20
_BATCH = 256
_PEERS = 64
_PEER_US = 60_000_000
_LINUX = sys.platform.startswith("linux")
# Not named by the socket module: Linux's count of datagrams dropped on this socket, and its time of arrival.
_SO_RXQ_OVFL, _SO_TIMESTAMPNS = 40, 35
_OVFL, _TIMESPEC = struct.Struct("=I"), struct.Struct("=qq")
_ANCILLARY = 128
_CLOCK_GAP_US = 10_000_000

_Address = tuple[str, int]


def _udp_socket() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    if _LINUX:
        for option in (_SO_RXQ_OVFL, _SO_TIMESTAMPNS):
            try:
                sock.setsockopt(socket.SOL_SOCKET, option, 1)
            except OSError:
                continue  # an older kernel: drops then go uncounted, arrival is stamped after reading
    return sock


class _Udp:
    """What listening and connected sockets have in common."""

    def __init__(self, url: LinkUrl, index: int) -> None:
        self.name = url.name
        self._index = index
        self._tally = Tally()
        self._socket = _udp_socket()
        self._buffer = bytearray(65536)
        self._view = memoryview(self._buffer)
        self._open = True

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        return self._tally.counts

    @property
    def buffer_bytes(self) -> int:
        """Receive buffer that the system granted."""
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    def read(self, timeout_s: float) -> list[Packet]:
        """Waits for datagrams and drains the socket, up to some hundred of them.

        Returns:
            Packets in order of arrival, empty after the timeout or when closed.
        """
        packets: list[Packet] = []
        if not self._wait(timeout_s):
            return packets
        for _ in range(_BATCH):
            received = self._receive()
            if received is None:
                break
            data, t_us, sender = received
            frames, counts = split(data)
            self._tally.take(len(data), counts)
            if counts.good:
                self._know(sender, t_us)
            packets += [Packet(t_us, frame, self._index) for frame in frames]
        return packets

    def close(self) -> None:
        """Closes the socket; a read in another thread comes back empty."""
        self._open = False
        self._socket.close()

    def _wait(self, timeout_s: float) -> bool:
        try:
            return self._open and bool(select.select([self._socket], [], [], timeout_s)[0])
        except (OSError, ValueError):
            if self._open:
                raise
            return False  # closed by another thread

    def _receive(self) -> tuple[bytes, int, _Address] | None:
        """One datagram, its arrival in Unix µs and its sender; None when there is none."""
        try:
            if not _LINUX:
                size, sender = self._socket.recvfrom_into(self._buffer)
                return bytes(self._view[:size]), now_us(), sender
            size, ancillary, _, sender = self._socket.recvmsg_into([self._buffer], _ANCILLARY)
        except (BlockingIOError, InterruptedError, ConnectionError):
            return None  # nothing there, or an earlier datagram of ours found nobody
        except OSError:
            if self._open:
                raise
            return None
        t_us = now_us()
        for level, kind, value in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(value) >= _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack_from(value)
                arrived_us = seconds * 1_000_000 + nanoseconds // 1000
                t_us = arrived_us if 0 <= t_us - arrived_us < _CLOCK_GAP_US else t_us
            elif level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL and len(value) >= _OVFL.size:
                self._tally.dropped = _OVFL.unpack_from(value)[0]
        return bytes(self._view[:size]), t_us, sender

    def _know(self, sender: _Address, t_us: int) -> None:
        """A sender of good frames was heard."""


class UdpIn(_Udp):
    """Listens on a port that is its own: two programs on one port would take packets from each other.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    def __init__(self, url: LinkUrl, index: int) -> None:
        super().__init__(url, index)
        self._peers: dict[_Address, int] = {}
        try:
            self._socket.bind((url.host, url.port))
        except (OSError, UnicodeError) as error:
            self._socket.close()
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                text = f"{self.name}: UDP port {url.port} is in use{owner_of('udp', url.port)}; stop it or use another"
                raise LinkError(text) from None
            raise LinkError(f"{self.name}: cannot listen: {error}") from error

    @property
    def port(self) -> int:
        """Port listened on."""
        port: int = self._socket.getsockname()[1]
        return port

    def send(self, data: bytes) -> None:
        """Sends to everybody who sent good frames in the last minute, and to nobody else.

        Raises:
            LinkError: nobody was heard yet.
        """
        since_us = now_us() - _PEER_US
        peers = [peer for peer, t_us in list(self._peers.items()) if t_us >= since_us]
        if not peers:
            raise LinkError(f"{self.name}: nobody to send to, nothing was heard in the last minute")
        for peer in peers:
            try:
                self._socket.sendto(data, peer)
            except OSError as error:
                raise LinkError(f"{self.name}: cannot send to {peer[0]}:{peer[1]}: {error.strerror}") from error

    def _know(self, sender: _Address, t_us: int) -> None:
        if sender not in self._peers and len(self._peers) >= _PEERS:
            del self._peers[min(self._peers, key=self._peers.__getitem__)]
        self._peers[sender] = t_us


class UdpOut(_Udp):
    """Connected to one address: the system drops what others send. Sends nothing of its own.

    Raises:
        LinkError: no such host.
    """

    def __init__(self, url: LinkUrl, index: int) -> None:
        super().__init__(url, index)
        try:
            self._socket.connect((url.host, url.port))
        except (OSError, UnicodeError) as error:
            self._socket.close()
            raise LinkError(f"{self.name}: no such host: {error}") from error

    def send(self, data: bytes) -> None:
        """Sends to the address; that nobody listens there is not an error.

        Raises:
            LinkError: the network is down.
        """
        try:
            self._socket.send(data)
        except ConnectionRefusedError:
            return  # the answer to an earlier datagram: nobody listened then
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error.strerror}") from error
