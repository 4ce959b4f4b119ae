"""Work of the ingest process on a batch: record, verify, hand on, forward. Nothing is decoded.

Of packets with refused signatures only so many are recorded of each sender; all of them are counted. Keys keep forged
packets from being accepted, not from arriving, even from the address of the vehicle that is imitated. Packets with a
valid signature are always recorded.
"""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from infra.reporting import TokenBucket
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.forwarding.forward import Forwarder
from mavlink.ingest.ingest_memory import IngestMemory, Slot
from mavlink.ingest.plan import Outputs, Signing
from mavlink.links.base import Link
from mavlink.links.batch import Batch, Claim
from mavlink.links.fair_shares import HOLD_S
from mavlink.links.flood_limiter import FloodLimit
from mavlink.links.report import LinkReport
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.store import StreamStore, open_verifier
from mavlink.signing.verifier import Verifier, without_secret
from mavlink.tlog.writer import TlogWriter

KEPT_PER_S, BURST_S = 500.0, 4.0
"""Refused packets recorded of one sender: all of a vehicle that has no key, and enough to see what a forger does."""
_MAX_SENDERS = 1024
"""Senders that are watched at a time; those who come later are one."""
_OTHERS: Claim = (0, 0)
_TIME = struct.Struct(">Q")
_SETUP_SIGNING = b"\x00\x01\x00"
"""Message id of SETUP_SIGNING as in a header."""


@dataclass(slots=True)
class _RefusedSender:
    bucket: TokenBucket
    seen: int = 0
    shed: int = 0
    """Packets of this flood that were not recorded."""
    shed_s: float = 0.0
    """Time of the last of them, s of the monotonic clock."""
    reported: tuple[int, float] = (0, 0.0)
    """Packets seen at the last report, and when that was, monotonic."""


class RefusedPacketLimiter:
    """Drops refused packets beyond a rate for each sender."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._senders: dict[tuple[int, Claim], _RefusedSender] = {}
        self._shed: Counter[int] = Counter()

    def limit(self, index: int, batch: Batch, auths: Sequence[Auth]) -> tuple[Batch, Sequence[Auth]]:
        """A batch and the results of its signature checks, without refused packets beyond their senders' rate."""
        if max(auths, default=Auth.OPEN) <= Auth.GOOD:
            return batch, auths
        claims, now_s = batch.claims(), self._clock_s()
        kept = [k for k, auth in enumerate(auths) if auth <= Auth.GOOD or self._keeps(index, claims[k], now_s)]
        if len(kept) == len(auths):
            return batch, auths
        self._shed[index] += len(auths) - len(kept)
        frames, times_us, peers = batch.frames, batch.times_us, batch.peers
        some = Batch([times_us[k] for k in kept], [frames[k] for k in kept], [peers[k] for k in kept])
        return some, [auths[k] for k in kept]

    def add_to_report(self, index: int, report: LinkReport, address: Callable[[int], str]) -> LinkReport:
        """A link's report, with what was not recorded of it and from which sender."""
        counts = replace(report.counts, turned_away=report.counts.turned_away + self._shed[index])
        now_s = self._clock_s()
        limits = [
            self._limit(claim, sender, address, now_s)
            for (link, claim), sender in self._senders.items()
            if link == index and sender.shed and now_s - sender.shed_s < HOLD_S
        ]
        return replace(report, counts=counts, limits=(*report.limits, *limits))

    def _keeps(self, index: int, claim: Claim, now_s: float) -> bool:
        """Tell whether one more refused packet of a sender is recorded."""
        sender = self._senders.get((index, claim))
        if sender is None:
            sender = self._new(index, claim, now_s)
        sender.seen += 1
        if sender.bucket.allows(now_s):
            return True
        if now_s - sender.shed_s >= HOLD_S:
            sender.shed = 0
        sender.shed += 1
        sender.shed_s = now_s
        return False

    def _new(self, index: int, claim: Claim, now_s: float) -> _RefusedSender:
        if len(self._senders) >= _MAX_SENDERS:
            rested = [who for who, sender in self._senders.items() if now_s - sender.bucket.last_s > BURST_S]
            for who in rested:
                del self._senders[who]
        if len(self._senders) >= _MAX_SENDERS:
            claim = _OTHERS
        return self._senders.setdefault(
            (index, claim), _RefusedSender(TokenBucket(KEPT_PER_S, KEPT_PER_S * BURST_S, now_s))
        )

    def _limit(self, claim: Claim, sender: _RefusedSender, address: Callable[[int], str], now_s: float) -> FloodLimit:
        seen, since_s = sender.reported
        sender.reported = sender.seen, now_s
        rate = (sender.seen - seen) / max(now_s - since_s, 1e-3) if since_s else 0.0
        where = address(claim[0]) or "many addresses"
        return FloodLimit(address=where, system_id=claim[1], wanted_per_s=rate, turned_away=sender.shed, refused=True)


class Signatures:
    """Verifies packets, where there are keys.

    Raises:
        SigningError: they cannot be used.
    """

    def __init__(self, signing: Signing) -> None:
        self._verifier: Verifier | None = None
        self._store: StreamStore | None = None
        self.trouble = ""
        """Fault that came last."""
        if signing.keys:
            options = {} if signing.unsigned is None else {"unsigned": signing.unsigned}
            self._verifier, self._store = open_verifier(
                Path(signing.keys), keyless=signing.keyless, accept_late=signing.accept_late, **options
            )

    @property
    def on(self) -> bool:
        """True if there are keys."""
        return self._verifier is not None

    @property
    def troubles(self) -> list[str]:
        """Faults that are on now."""
        store = self._store.trouble or self._store.warning if self._store else ""
        return [text for text in (self.trouble, store) if text]

    def check(self, packets: Sequence[Packet]) -> list[Auth]:
        """Verdicts on the signatures; a packet that cannot be checked is ``BAD``."""
        verifier = self._verifier
        assert verifier is not None
        auths = []
        for packet in packets:
            try:
                auths.append(verifier.check(packet))
            except Exception as error:  # noqa: BLE001 - no packet may stop the recording of all others
                self.trouble = f"a signature could not be checked: {error!r}"
                auths.append(Auth.BAD)
        return auths

    def accept_held(self, system_id: int) -> None:
        """An operator vouches for a system whose packets are held."""
        if self._verifier is not None and 0 <= system_id < 256:
            self._verifier.accept_held(system_id, now_us())

    def close(self) -> None:
        """Save what is remembered of the streams."""
        if self._store:
            self._store.close()


def open_outputs(outputs: Outputs, system_ids: tuple[int, ...]) -> Forwarder | None:
    """The outputs, None when there are none.

    Raises:
        LinkError: one cannot be opened.
    """
    if not outputs.urls:
        return None
    return Forwarder(
        outputs.urls,
        uav=outputs.uav,
        refused=outputs.refused,
        vehicles=system_ids,
        own=outputs.own,
    )


class LastSenders:
    """The sender of each system id so far, to notice when one is received from another than before."""

    def __init__(self) -> None:
        self._senders: list[tuple[int, int] | None] = [None] * 256
        self._claims: dict[int, set[Claim]] = {}
        """Claims of senders by link."""

    def changes(self, link: int, batch: Batch) -> Iterator[tuple[int, int]]:
        """Places in a batch, and system ids, of frames whose system id last came from another sender, or never."""
        if batch.claimed() <= self._claims.setdefault(link, set()):
            return  # nearly always
        senders, claims = self._senders, self._claims
        for k, (peer, system_id) in enumerate(batch.claims()):
            before = senders[system_id]
            if before != (link, peer):
                if before is not None:
                    claims[before[0]].discard((before[1], system_id))
                senders[system_id] = link, peer
                claims[link].add((peer, system_id))
                yield k, system_id


class Receiver:
    """Takes the batches of all links.

    Args:
        memory: where the station takes packets from.
        outputs: where packets go on to.
    """

    def __init__(
        self,
        links: Sequence[Link],
        log: TlogWriter,
        memory: IngestMemory,
        signatures: Signatures,
        outputs: Forwarder | None,
    ) -> None:
        self._links = links
        self._log = log
        self._memory = memory
        self._signatures = signatures
        self._outputs = outputs
        self._senders = LastSenders()
        self.limiter = RefusedPacketLimiter()
        self.output_trouble = ""

    def receive_batch(self, index: int, batch: Batch) -> None:
        """One batch of a link."""
        original = self._hide_secrets(index, batch)
        auths: Sequence[Auth] | None = None
        if self._signatures.on:  # looked at before they are recorded: those of a forger could fill the disk
            packets = batch.packets(index)
            auths = self._signatures.check([original.get(k, packet) for k, packet in enumerate(packets)])
            batch, auths = self.limiter.limit(index, batch, auths)
        number = self._record(batch) if batch.frames else None
        self._memory.slots[Slot.IN_HAND] = 0
        if number is not None:
            self._note_senders(index, batch, number)
        packets = batch.packets(index, auths) if self._signatures.on or self._outputs else []
        if self._signatures.on:
            self._note_verdicts(index, packets, number)
        self._memory.put_packets(index, number, batch.times_us, batch.frames, batch.peers, auths)
        self.forward(packets)

    def forward(self, packets: Sequence[Packet]) -> None:
        """Packets go out, and answers go back."""
        if self._outputs is None:
            return
        try:
            self._outputs.forward(packets, self.send)
        except Exception as error:  # noqa: BLE001 - outputs may never stop the recording
            self.output_trouble = f"forwarding: {error!r}"

    def send(self, link: int, data: bytes, peer: int = 0) -> None:
        """Send and records a frame of this station's own or of a program behind an output.

        Args:
            link: over which.
            peer: the one who is to get it; 0: all who are known there.

        Raises:
            LinkError: there is no such link, or it does not take it; then it is not recorded.
        """
        if not 0 <= link < len(self._links):
            raise LinkError(f"there is no link {link}")
        self._links[link].send(data, peer)
        if self._record(Batch(times_us=[now_us()], frames=[data], peers=[0])) is not None:
            self._memory.slots[Slot.SENT] += 1

    def _record(self, batch: Batch) -> int | None:
        """Put packets on the way to the log; return the first record's number, None when they are lost."""
        pack, pairs = _TIME.pack, zip(batch.times_us, batch.frames, strict=True)
        data = b"".join([piece for t_us, raw in pairs for piece in (pack(t_us), raw)])
        return self._log.write_records(data, len(batch))

    def _note_senders(self, index: int, batch: Batch, number: int) -> None:
        """Record who sent what beside the log, so that a replay distinguishes senders as the flight does."""
        link = self._links[index]
        for k, system_id in self._senders.changes(index, batch):
            peer = batch.peers[k]
            self._log.write_sender(number + k, batch.times_us[k], system_id, index, peer, link.address(peer), link.name)

    def _note_verdicts(self, index: int, packets: Sequence[Packet], number: int | None) -> None:
        """Note what is rejected, and which senders have been verified."""
        known = set()
        for k, packet in enumerate(packets):
            if packet.auth > Auth.GOOD:
                if number is not None:
                    self._log.refuse(number + k, packet)
                self._memory.slots[Slot.REFUSED] += 1
            elif packet.auth is Auth.GOOD:
                known.add((packet.peer, packet.system_id))
        if known:
            self._links[index].trust(known, now_us())

    def _hide_secrets(self, index: int, batch: Batch) -> dict[int, Packet]:
        """Take keys out of a batch, before it is recorded; return those packets as they came, by place."""
        original: dict[int, Packet] = {}
        if _SETUP_SIGNING not in [raw[7:10] for raw in batch.frames]:
            return original  # nearly always
        for k, raw in enumerate(batch.frames):
            if raw[7:10] == _SETUP_SIGNING and raw[0] == 0xFD:
                packet = Packet(batch.times_us[k], raw, index, batch.peers[k])
                clean = without_secret(packet)
                if clean is not None:
                    original[k] = packet
                    batch.frames[k] = clean.raw
        return original
