"""Limits how many packets with refused signatures are recorded of each sender; all of them are counted.

Keys keep forged packets from being accepted, not from arriving, even from the address of the vehicle that is imitated.
Packets with a valid signature are always recorded.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from infra.reporting import TokenBucket
from mavlink.links.batch import Batch, Claim
from mavlink.links.fair_shares import HOLD_S
from mavlink.links.flood_limiter import FloodLimit
from mavlink.links.report import LinkReport
from mavlink.protocol.packet import Auth

KEPT_PER_S, BURST_S = 500.0, 4.0
"""Refused packets recorded of one sender: all of a vehicle that has no key, and enough to see what a forger does."""
_MOST = 1024
"""Senders that are watched at a time; those who come later are one."""
_OTHERS: Claim = (0, 0)


@dataclass(slots=True)
class _RefusedSender:
    bucket: TokenBucket
    seen: int = 0
    shed: int = 0
    """Packets of this flood that were not recorded."""
    shed_s: float = 0.0
    """When the last of them came, monotonic."""
    reported: tuple[int, float] = (0, 0.0)
    """Packets seen at the last report, and when that was, monotonic."""


class RefusedPacketLimiter:
    """Drops refused packets beyond a rate for each sender.

    Args:
        clock_s: monotonic.
    """

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
        if len(self._senders) >= _MOST:
            rested = [who for who, sender in self._senders.items() if now_s - sender.bucket.last_s > BURST_S]
            for who in rested:
                del self._senders[who]
        if len(self._senders) >= _MOST:
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
