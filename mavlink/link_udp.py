"""UDP links. No frame ever crosses a datagram, so nothing a stranger sends can spoil what another sent."""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections.abc import Collection, Set

from mavlink.dialect import DEFINITIONS
from mavlink.errors import LinkError
from mavlink.frame import FrameCounts, split
from mavlink.link_batch import Batch, is_one_frame, looks_like_one_frame
from mavlink.link_gate import Gate
from mavlink.link_mmsg import BATCH, SO_TIMESTAMPNS, STRIDE, Datagrams, available
from mavlink.link_peers import Peers, key_of
from mavlink.link_reader import Reader
from mavlink.link_tally import LinkCounts, Tally, now_us
from mavlink.link_udp_socket import bind_udp, connect_udp
from mavlink.link_url import LinkUrl
from mavlink.packet import MAGIC_V2, Packet

__all__ = ["UdpIn", "UdpOut"]

_LINUX = sys.platform.startswith("linux")
_TIMESPEC = struct.Struct("=qq")
_ANCILLARY = 128
_CLOCK_GAP_US = 10_000_000


class _Udp(Reader):
    """What listening and connected sockets have in common."""

    def __init__(self, url: LinkUrl, index: int, sock: socket.socket, system_ids: Collection[int], vouch: bool) -> None:
        super().__init__(url.name, index)
        self.peers = Peers()
        self.gate = Gate(sock)
        self._socket = sock
        self._system_ids = frozenset(system_ids)
        self._vouch = vouch
        self._tally = Tally()
        self._datagrams = Datagrams(sock) if available() else None
        self._strange = [0, 0]

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        if self._open:
            self.gate.count_drops()
        return self._tally.told(dropped=self.gate.dropped, turned_away=self.gate.turned_away)

    @property
    def buffer_bytes(self) -> int:
        """Receive buffer that the system granted."""
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    @property
    def files(self) -> tuple[int, ...]:
        """What to wait for."""
        return (self._socket.fileno(),) if self._open else ()

    def take(self) -> Batch:
        """Up to some hundred datagrams that are there, without waiting; empty when there are none or closed."""
        batch = Batch()
        if not self._open:
            return batch
        self.gate.look()
        self._strange = [0, 0]
        try:
            if self._datagrams:
                self._take_many(batch)
            else:
                self._take_each(batch)
        except (OSError, ValueError):
            if self._open:
                raise
            return batch
        now = now_us()
        likely, other = self._strange
        present = set(batch.peers)
        new = present - self.peers.trusted.keys()
        if new:
            likely += sum(peer in new for peer in batch.peers)
        if self._vouch and present:
            self.trust((present - new) | (self._vouched(batch, new) if new else new), now)
        if self.gate.strangers(likely, other, time.monotonic()):
            self.adapt(now)
        return batch

    def address(self, peer: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        return self.peers.address(peer)

    def trust(self, peers: Set[int], t_us: int) -> None:
        """These senders have proved who they are: they always pass, and may be sent to."""
        self.peers.trust(peers, t_us)

    def tend(self) -> None:
        """Adapts who is let in; to be called every tenth of a second or so."""
        if self._open and self.gate.due(time.monotonic()):
            self.adapt(now_us())

    def adapt(self, t_us: int) -> None:
        """Lets in as many strangers as can be borne."""
        self.peers.review(t_us)
        self.gate.adapt(time.monotonic(), self.peers.senders, self.peers.changes)

    def close(self) -> None:
        """Closes the socket; a read in another thread comes back empty."""
        self._open = False
        self._socket.close()

    def _vouched(self, batch: Batch, new: Set[int]) -> set[int]:
        """Those of some new senders who sent a good frame of a system that is known."""
        good = batch.vouched() & new
        if not self._system_ids:
            return good
        rows = enumerate(zip(batch.peers, batch.frames, strict=True))
        heard = {peer for k, (peer, raw) in rows if k not in batch.unchecked and self._is_known(raw)}
        return good & heard

    def _is_known(self, raw: bytes) -> bool:
        return raw[5 if raw[0] == MAGIC_V2 else 3] in self._system_ids

    def _take_many(self, batch: Batch) -> None:
        """One system call's worth of datagrams."""
        datagrams = self._datagrams
        assert datagrams is not None
        count = datagrams.receive()
        if not count:
            return
        now = now_us()  # not before the call: what comes while this process is held up would be stamped too early
        lengths, senders, times_us = datagrams.lengths(count), datagrams.senders(count), datagrams.times_us(count)
        view, numbers = datagrams.view, self.peers.numbers
        add_time, add_frame, add_peer = batch.times_us.append, batch.frames.append, batch.peers.append
        oldest, at, good = now - _CLOCK_GAP_US, 0, 0
        for size, key, t_us in zip(lengths, senders, times_us, strict=True):
            data = bytes(view[at : at + size])
            at += STRIDE
            if not oldest <= t_us <= now:
                t_us = now
            if is_one_frame(data):
                add_time(t_us)
                add_frame(data)
                add_peer(numbers.get(key) or self.peers.number(key))
                good += 1
            else:
                self._search(batch, data, key, t_us)
        datagrams.reset(count)
        self._tally.take(sum(lengths), FrameCounts(good=good))

    def _take_each(self, batch: Batch) -> None:
        """One datagram a system call, on systems without a better one."""
        for _ in range(BATCH):
            try:
                received = self._receive()
            except (BlockingIOError, InterruptedError, ConnectionError):
                return  # nothing there, or an earlier datagram of ours found nobody
            self._tally.take(len(received[0]), FrameCounts())
            self._search(batch, *received)

    def _receive(self) -> tuple[bytes, int, int]:
        """One datagram, its sender and its arrival in Unix µs."""
        if not _LINUX:
            data, sender = self._socket.recvfrom(STRIDE)
            return data, key_of(sender), now_us()
        data, ancillary, _, sender = self._socket.recvmsg(STRIDE, _ANCILLARY)
        t_us = now_us()
        for level, kind, value in ancillary:
            if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(value) >= _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack_from(value)
                arrived_us = seconds * 1_000_000 + nanoseconds // 1000
                t_us = arrived_us if 0 <= t_us - arrived_us < _CLOCK_GAP_US else t_us
        return data, key_of(sender), t_us

    def _search(self, batch: Batch, data: bytes, key: int, t_us: int) -> None:
        """Finds the frames in a datagram, whatever else is in it."""
        frames, counts = split(data)
        self._tally.take(0, counts)
        if not frames:
            self._empty(data, key)
            return
        number = self.peers.number(key)
        for frame in frames:
            if counts.unknown and Packet(0, frame).message_id not in DEFINITIONS:
                batch.unchecked.add(len(batch))
            batch.times_us.append(t_us)
            batch.frames.append(frame)
            batch.peers.append(number)

    def _empty(self, data: bytes, key: int) -> None:
        """A datagram with nothing in it: from a stranger, or from somebody who should know better."""
        number = self.peers.numbers.get(key, 0)
        if number in self.peers.trusted:
            self.peers.misbehaved(number)
        else:
            self._strange[0 if looks_like_one_frame(data) else 1] += 1


class UdpIn(_Udp):
    """Listens on a port that is its own.

    Args:
        url: the link.
        index: of the link.
        sock: from :func:`bind_udp`; None: one is made.
        system_ids: whose frames make a sender known; empty: anybody's.
        vouch: whether a right checksum is enough for that; otherwise whoever checks signatures calls :meth:`trust`.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    def __init__(
        self,
        url: LinkUrl,
        index: int,
        sock: socket.socket | None = None,
        *,
        system_ids: Collection[int] = (),
        vouch: bool = True,
    ) -> None:
        super().__init__(url, index, sock or bind_udp(url), system_ids, vouch)

    @property
    def port(self) -> int:
        """Port listened on."""
        port: int = self._socket.getsockname()[1]
        return port

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to everybody who sent good frames in the last minute, and to nobody else.

        Args:
            data: one frame.
            peer: number of the one of them who is to get it; 0: all.

        Raises:
            LinkError: nobody was heard yet, or not this one.
        """
        self.peers.review(now_us())
        addresses = self.peers.addresses()
        wanted = [address for number, address in addresses.items() if peer in (0, number)]
        if not wanted:
            whom = f"cannot send to sender {peer}" if peer else "nobody to send to"
            raise LinkError(f"{self.name}: {whom}, nothing was heard in the last minute")
        for host, port in wanted:
            try:
                self._socket.sendto(data, (host, port))
            except OSError as error:
                raise LinkError(f"{self.name}: cannot send to {host}:{port}: {error.strerror}") from error


class UdpOut(_Udp):
    """Connected to one address: the system drops what others send. Sends nothing of its own.

    Args:
        url: the link.
        index: of the link.
        sock: from :func:`connect_udp`; None: one is made.

    Raises:
        LinkError: no such host.
    """

    def __init__(self, url: LinkUrl, index: int, sock: socket.socket | None = None) -> None:
        super().__init__(url, index, sock or connect_udp(url), (), True)

    def adapt(self, t_us: int) -> None:
        """Strangers do not reach a connected socket."""
        self.gate.count_drops()

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends to the address, the only peer there is; that nobody listens there is not an error.

        Raises:
            LinkError: the network is down.
        """
        try:
            self._socket.send(data)
        except ConnectionRefusedError:
            return  # the answer to an earlier datagram: nobody listened then
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error.strerror}") from error
