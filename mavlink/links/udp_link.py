"""UDP links. No frame ever crosses a datagram, so no sender can spoil what another sent."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence, Set
from dataclasses import replace
from itertools import chain

from infra.stamped_udp import receive_stamped
from infra.wall_clock import now_us
from mavlink.links.base import Link, LinkOptions
from mavlink.links.batch import MIXED, Batch, Claim, Sender, is_one_frame, looks_like_one_frame, system_of
from mavlink.links.fair_shares import PassedTraffic
from mavlink.links.flood_limiter import FloodLimit, FloodLimiter
from mavlink.links.peers import Peers, address_of, key_of
from mavlink.links.recvmmsg import BATCH, STRIDE, Datagrams, available
from mavlink.links.report import LinkCounts, LinkReport
from mavlink.links.url import LinkUrl
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import FrameCounts, split
from mavlink.protocol.packet import Packet

_CLOCK_GAP_US = 10_000_000
"""A stamp that is older is of before the clock was set."""
SUDDEN = 1000
"""Unknown datagrams after which the shares are updated at once: a socket has room for some ten thousand."""
_WAITED_S = 10.0
"""Longest time that anything lies in the socket, as far as rates are concerned."""


class UdpLink(Link):
    """Base of listening and connected sockets."""

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
        self.limiter = FloodLimiter(sock)
        self._socket = sock
        self._system_ids = frozenset(options.system_ids)
        self._trusts_checksums = options.trusts_checksums
        self._datagrams = Datagrams(sock) if available() else None
        self._batches: list[Batch] = []
        """Batches received since the last update of the shares, as are the counts that follow."""
        self._bad_datagrams: Counter[Sender] = Counter()
        self._unknown_counts = [0, 0]
        """Datagrams of unknown senders that look like one frame, and others."""
        self._unknown_addresses: Counter[int] = Counter()
        self._unknown_words = ""
        self._clock_s = clock_s
        self._newest_us = 0
        self._was_full = False
        self._is_refused = False
        """True if an earlier frame of ours found no listener."""

    @property
    def counts(self) -> LinkCounts:
        """Counts of what came so far."""
        if self._open:
            self.limiter.count_drops()
        return self._counters.snapshot(dropped=self.limiter.dropped, turned_away=self.limiter.turned_away)

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
        """Descriptors to wait for."""
        return (self._socket.fileno(),) if self._open else ()

    def read_batch(self) -> Batch:
        """Read up to some hundred datagrams that are there, without waiting; empty when there are none or closed."""
        batch = Batch()
        if not self._open:
            return batch
        self.limiter.note_fill(self._was_full)
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
        self._note_senders(batch, now)
        if sum(self._unknown_counts) > SUDDEN:
            self.adapt(now)
        return batch

    def _note_senders(self, batch: Batch, t_us: int) -> None:
        """Note the senders of a batch, and trusts new ones whose checksums are right."""
        if not batch.frames:
            return
        self._batches.append(batch)
        if batch.mixed:
            self.peers.note_mixed({batch.peers[k] for k in batch.mixed})
        claimed = batch.claimed()
        new = claimed.difference(self.peers.trusted)
        if not new:
            if self._trusts_checksums:
                self.peers.note_good_frames(claimed)
            return
        claims = batch.claims()
        for k, claim in enumerate(claims):
            if claim in new:
                self._unknown_counts[k in batch.mixed] += 1
                self._unknown_addresses[self.peers.keys.get(claim[0], 0)] += 1
        if self._trusts_checksums:
            self.peers.trust(claimed - new | self._newly_trusted(batch, claims, new), t_us)

    def address(self, peer: int) -> str:
        """Host and port of a sender; empty where it is forgotten."""
        return self.peers.address(peer)

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """Trust senders that have proved who they are: they pass up to their limits, and may be sent to."""
        self.peers.trust(claims, t_us)

    def limits(self) -> tuple[FloodLimit, ...]:
        """Senders of which only a share passes at the moment."""
        return tuple(self.limiter.limits(self.peers, self._unknown_words))

    def maintain(self) -> None:
        """Update which shares pass; to be called every tenth of a second or so."""
        if self._open and self.limiter.due(self._clock_s()):
            self.adapt(now_us())

    def adapt(self, t_us: int) -> None:
        """Update the trust in senders, and which share of their datagrams passes."""
        self.peers.update_trust(t_us)
        if self._unknown_addresses:
            others = len(self._unknown_addresses) - 1
            self._unknown_words = address_of(self._unknown_addresses.most_common(1)[0][0])
            self._unknown_words += f" and {others} more address{'es' * (others > 1)}" if others else ""
        now_s = self._clock_s()
        dt_s = max(self.limiter.elapsed_s(now_s), self._span_s())
        frames, read = self._traffic_of_known(dt_s)
        likely, other = self._unknown_counts
        traffic = PassedTraffic(likely=likely, other=other, frames=frames if self._trusts_checksums else {}, read=read)
        self._batches, self._unknown_counts = [], [0, 0]
        self._bad_datagrams.clear()
        self._unknown_addresses.clear()
        self.limiter.adapt(now_s, dt_s, traffic, self.peers)

    def _span_s(self) -> float:
        """Time over which the frames since the last update arrived: they may have queued for a while."""
        newest_us = self._batches[-1].times_us[-1] if self._batches else self._newest_us
        before_us, self._newest_us = self._newest_us, newest_us
        return min((newest_us - before_us) * 1e-6, _WAITED_S) if before_us else 0.0

    def _traffic_of_known(self, dt_s: float) -> tuple[Counter[Sender], Counter[Sender]]:
        """Good frames of known senders, and datagrams read of them; empty where none can be over its limit."""
        frames: Counter[Sender] = Counter()
        if self.limiter.is_calm(sum(map(len, self._batches)) + self._bad_datagrams.total(), self._busiest, dt_s):
            return frames, frames
        for batch in self._batches:
            frames.update(batch.senders())
        for sender in [s for s in frames if not self.peers.trusts(s)]:
            del frames[sender]
        return frames, frames + self._bad_datagrams

    def _busiest(self) -> int:
        """Datagrams of the busiest address."""
        counts = Counter(chain.from_iterable(batch.peers for batch in self._batches))
        return max(counts.values(), default=0) + self._bad_datagrams.total()

    def report(self) -> LinkReport:
        """State of the link, with known senders and floods."""
        addresses = tuple((number, host, port) for number, (host, port) in self.peers.addresses().items())
        return replace(
            super().report(),
            buffer_bytes=self.buffer_bytes,
            system_drops=self.limiter.system_drops,
            peers=len(addresses),
            addresses=addresses,
            others=tuple(self.peers.untrusted().items()),
            claims=tuple(self.peers.trusted),
            mixed=tuple(self.peers.mixed),
            limits=self.limits(),
        )

    def set_fleet(self, system_ids: Collection[int]) -> None:
        """Limit the senders that become known from now on to those of these systems; who is known already stays so for
        a minute."""
        self._system_ids = frozenset(system_ids)

    def resume(self, before: LinkReport) -> None:
        """Count what the socket dropped in the meantime."""
        self.limiter.resume(before.system_drops, was_limited=before.narrow)

    def close(self) -> None:
        """Close the socket."""
        self._open = False
        self._socket.close()

    def _newly_trusted(self, batch: Batch, claims: list[Claim], new: Set[Claim]) -> set[Claim]:
        """New senders with a frame of a known message, of a system of the mission where those are given."""
        return {
            claim
            for k, claim in enumerate(claims)
            if claim in new and k not in batch.unchecked and (not self._system_ids or claim[1] in self._system_ids)
        }

    def _receive_many(self, batch: Batch) -> None:
        """Receive one system call's worth of datagrams."""
        datagrams = self._datagrams
        assert datagrams is not None
        count = datagrams.receive()
        self._was_full = count == BATCH
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
        self._was_full = len(data) == BATCH
        self._find_frames(batch, data, keys, times_us, now_us())

    def _find_frames(
        self, batch: Batch, datagrams: Sequence[bytes], keys: Sequence[int], times_us: Sequence[int], now: int
    ) -> None:
        """Add what is in datagrams, with their senders (:func:`mavlink.links.peers.key_of`) and stamps, to a batch.

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
                self._split_datagram(batch, data, key, t_us)
        self._counters.add(sum(map(len, datagrams)), FrameCounts(good=good))

    def _split_datagram(self, batch: Batch, data: bytes, key: int, t_us: int) -> None:
        """Add the frames in a datagram that is not exactly one good frame."""
        frames, counts = split(data)
        self._counters.add(0, counts)
        if not frames:
            self._note_bad_datagram(data, key)
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

    def _note_bad_datagram(self, data: bytes, key: int) -> None:
        """Count a datagram without a frame, for its sender where that is trusted: the address may be forged."""
        alone = looks_like_one_frame(data)
        sender = self.peers.numbers.get(key, 0), system_of(data) if alone else MIXED
        if self.peers.trusts(sender):
            self._bad_datagrams[sender] += 1
        else:
            self._unknown_counts[not alone] += 1
            self._unknown_addresses[key] += 1
