"""When a system id is heard from another sender than before."""

from __future__ import annotations

from collections.abc import Iterator

from mavlink.links.batch import Batch, Claim

__all__ = ["LastSenders"]


class LastSenders:
    """The sender of each system id so far."""

    def __init__(self) -> None:
        self._senders: list[tuple[int, int] | None] = [None] * 256
        self._claims: dict[int, set[Claim]] = {}
        """The same by link: who is heard over it."""

    def take(self, link: int, batch: Batch) -> Iterator[tuple[int, int]]:
        """Places in a batch, and system ids, of frames whose system id was last heard from another sender, or never.

        Args:
            link: the batch came over.
            batch: whole frames.
        """
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
