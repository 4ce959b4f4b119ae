"""UDP links. No frame ever crosses a datagram, so nothing a stranger sends can spoil what another sent."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import Counter
from collections.abc import Callable, Sequence, Set
from dataclasses import replace
from itertools import chain

from infra.stamped_udp import receive_stamped
from infra.wall_clock import now_us
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import MIXED, Batch, Claim, Sender, is_one_frame, looks_like_one_frame, system_of
from mavlink.links.fair_shares import Coming
from mavlink.links.flood_limiter import Gate, Limit
from mavlink.links.peers import Peers, address_of, key_of
from mavlink.links.recvmmsg import BATCH, STRIDE, Datagrams, available
from mavlink.links.report import LinkCounts, LinkReport
from mavlink.links.url import LinkUrl
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import FrameCounts, split
from mavlink.protocol.packet import Packet

__all__ = ["UdpLink"]

_CLOCK_GAP_US = 10_000_000
"""A stamp that is older is of before the clock was set."""
SUDDEN = 1000
"""Strangers' datagrams that cannot wait for the next tenth of a second: a socket has room for some ten thousand."""
_WAITED_S = 10.0
"""Nothing lies longer in the socket, as far as rates are concerned."""


class UdpLink(Link):
    """What listening and connected sockets have in common."""

    has_kernel_stamps = True

    def __init__(
        self,
        url: LinkUrl,
        options: LinkOptions,
        sock: socket.socket,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(url, options)
        self.peers = Peers()
        self.gate = Gate(sock)
        self._socket = sock
        self._system_ids = frozenset(options.system_ids)
        self._trusts_checksums = options.trusts_checksums
        self._datagrams = Datagrams(sock) if available() else None
        self._batches: list[Batch] = []
        self._spoiled: Counter[Sender] = Counter()
        self._strange = [0, 0]
        self._strangers: Counter[int] = Counter()
        self._crowd = ""
        self._clock_s = clock_s
        self._newest_us = 0
        self._hurry = False
        self._is_refused = False
        """Whether the system told that nobody listened where a frame was sent to."""

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""
        if self._open:
            self.gate.count_drops()
        return self._counters.snapshot(dropped=self.gate.dropped, turned_away=self.gate.turned_away)

    @property
    def buffer_bytes(self) -> int:
        """Receive buffer that the system granted."""
        return self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    @property
    def last_peer(self) -> int:
        """Highest number given to a sender."""
        return self.peers.last

    @property
    def fds(self) -> tuple[int, ...]:
        """What to wait for."""
        return (self._socket.fileno(),) if self._open else ()

    def read_batch(self) -> Batch:
        """Up to some hundred datagrams that are there, without waiting; empty when there are none or closed."""
        batch = Batch()
        if not self._open:
            return batch
        self.gate.look(self._hurry)
        try:
            if self._datagrams:
                self._receive_many(batch)
            else:
                self._receive_each(batch)
        except ConnectionRefusedError:
            self._is_refused = True  # the answer to an earlier datagram of ours
        except (OSError, ValueError):
            if self._open:
                raise
            return batch
        now = now_us()
        self._note(batch, now)
        if sum(self._strange) > SUDDEN:
            self.adapt(now)
        return batch

    def _note(self, batch: Batch, t_us: int) -> None:
        """Who a batch came from."""
        if not batch.frames:
            return
        self._batches.append(batch)
        if batch.mixed:
            self.peers.mix({batch.peers[k] for k in batch.mixed})
        claimed = batch.claimed()
        new = claimed.difference(self.peers.trusted)
        if not new:
            if self._trusts_checksums:
                self.peers.hear(claimed)
            return
        claims = batch.claims()
        for k, claim in enumerate(claims):
            if claim in new:
                self._strange[k in batch.mixed] += 1
                self._strangers[self.peers.keys.get(claim[0], 0)] += 1
        if self._trusts_checksums:
            self.peers.trust(claimed - new | self._vouched(batch, claims, new), t_us)

    def address(self, peer: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        return self.peers.address(peer)

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """These have proved who they are: they pass as far as can be borne, and may be sent to."""
        self.peers.trust(claims, t_us)

    def limits(self) -> tuple[Limit, ...]:
        """Who is not let in whole at the moment."""
        return tuple(self.gate.limits(self.peers, self._crowd))

    def maintain(self) -> None:
        """Adapts who is let in; to be called every tenth of a second or so."""
        if self._open and self.gate.due(self._clock_s()):
            self.adapt(now_us())

    def adapt(self, t_us: int) -> None:
        """Lets in as much of whom as can be borne."""
        self.peers.review(t_us)
        if self._strangers:
            others = len(self._strangers) - 1
            self._crowd = address_of(self._strangers.most_common(1)[0][0])
            self._crowd += f" and {others} more address{'es' * (others > 1)}" if others else ""
        now_s = self._clock_s()
        dt_s = max(self.gate.elapsed_s(now_s), self._arrived_s())
        frames, read = self._come(dt_s)
        likely, other = self._strange
        coming = Coming(likely=likely, other=other, frames=frames if self._trusts_checksums else {}, read=read)
        self._batches, self._strange = [], [0, 0]
        self._spoiled.clear()
        self._strangers.clear()
        self.gate.adapt(now_s, dt_s, coming, self.peers)

    def _arrived_s(self) -> float:
        """In which time all arrived that was read since the last time: it may have waited while nobody could read."""
        newest_us = self._batches[-1].times_us[-1] if self._batches else self._newest_us
        before_us, self._newest_us = self._newest_us, newest_us
        return min((newest_us - before_us) * 1e-6, _WAITED_S) if before_us else 0.0

    def _come(self, dt_s: float) -> tuple[Counter[Sender], Counter[Sender]]:
        """Good frames of those who are known, and datagrams read; none where no one of them can be too many."""
        frames: Counter[Sender] = Counter()
        if self.gate.relaxed(sum(map(len, self._batches)) + self._spoiled.total(), self._busiest, dt_s):
            return frames, frames
        for batch in self._batches:
            frames.update(batch.senders())
        for sender in [s for s in frames if not self.peers.knows(s)]:
            del frames[sender]
        return frames, frames + self._spoiled

    def _busiest(self) -> int:
        """Datagrams of one address at most, in whatever form."""
        counts = Counter(chain.from_iterable(batch.peers for batch in self._batches))
        return max(counts.values(), default=0) + self._spoiled.total()

    def report(self) -> LinkReport:
        """How it is doing, with who is known and who floods."""
        addresses = tuple((number, host, port) for number, (host, port) in self.peers.addresses().items())
        return replace(
            super().report(),
            buffer_bytes=self.buffer_bytes,
            peers=len(addresses),
            addresses=addresses,
            others=tuple(self.peers.strangers().items()),
            claims=tuple(self.peers.trusted),
            mixed=tuple(self.peers.mixed),
            limits=self.limits(),
        )

    def close(self) -> None:
        """Closes the socket."""
        self._open = False
        self._socket.close()

    def _vouched(self, batch: Batch, claims: list[Claim], new: Set[Claim]) -> set[Claim]:
        """Those of some new ones who sent a good frame of a system that is known."""
        return {
            claim
            for k, claim in enumerate(claims)
            if claim in new and k not in batch.unchecked and (not self._system_ids or claim[1] in self._system_ids)
        }

    def _receive_many(self, batch: Batch) -> None:
        """One system call's worth of datagrams."""
        datagrams = self._datagrams
        assert datagrams is not None
        count = datagrams.receive()
        self._hurry = count == BATCH
        if count:
            now = now_us()  # not before the call: what comes while this process is held up would be stamped too early
            lengths, view = datagrams.lengths(count), datagrams.view
            starts = range(0, count * STRIDE, STRIDE)
            data = [bytes(view[at : at + size]) for at, size in zip(starts, lengths, strict=True)]
            keys, times_us = datagrams.senders(count), datagrams.times_us(count)
            datagrams.reset(count)
            self._find_frames(batch, data, keys, times_us, now)

    def _receive_each(self, batch: Batch) -> None:
        """One datagram a system call, on systems without a better one."""
        data: list[bytes] = []
        keys: list[int] = []
        times_us: list[int] = []
        with contextlib.suppress(BlockingIOError, InterruptedError):
            for _ in range(BATCH):
                one, sender, t_us = receive_stamped(self._socket)
                data.append(one)
                keys.append(key_of(sender))
                times_us.append(t_us)
        self._hurry = len(data) == BATCH
        self._find_frames(batch, data, keys, times_us, now_us())

    def _find_frames(
        self, batch: Batch, datagrams: Sequence[bytes], keys: Sequence[int], times_us: Sequence[int], now: int
    ) -> None:
        """Adds what is in datagrams, with their senders (:func:`mavlink.links.peers.key_of`) and stamps, to a batch.

        A stamp that is not of the last seconds is replaced: the clock was set meanwhile.
        """
        numbers = self.peers.numbers
        add_time, add_frame, add_peer = batch.times_us.append, batch.frames.append, batch.peers.append
        oldest, good = now - _CLOCK_GAP_US, 0
        for data, key, t_us in zip(datagrams, keys, times_us, strict=True):
            if not oldest <= t_us <= now:
                t_us = now
            if is_one_frame(data):
                add_time(t_us)
                add_frame(data)
                add_peer(numbers.get(key) or self.peers.number(key))
                good += 1
            else:
                self._search(batch, data, key, t_us)
        self._counters.add(sum(map(len, datagrams)), FrameCounts(good=good))

    def _search(self, batch: Batch, data: bytes, key: int, t_us: int) -> None:
        """Finds the frames in a datagram, whatever else is in it."""
        frames, counts = split(data)
        self._counters.add(0, counts)
        if not frames:
            self._empty(data, key)
            return
        number, alone = self.peers.number(key), looks_like_one_frame(data)
        for frame in frames:
            if not alone:
                batch.mixed.add(len(batch))
            if counts.unknown and Packet(0, frame).message_id not in DEFINITIONS:
                batch.unchecked.add(len(batch))
            batch.times_us.append(t_us)
            batch.frames.append(frame)
            batch.peers.append(number)

    def _empty(self, data: bytes, key: int) -> None:
        """A datagram with nothing in it, whoever sent it: its address may be forged."""
        alone = looks_like_one_frame(data)
        sender = self.peers.numbers.get(key, 0), system_of(data) if alone else MIXED
        if self.peers.knows(sender):
            self._spoiled[sender] += 1
        else:
            self._strange[not alone] += 1
            self._strangers[key] += 1
