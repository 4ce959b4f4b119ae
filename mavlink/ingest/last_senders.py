"""When a system id is heard from another sender than before."""

from __future__ import annotations

from collections.abc import Iterator

from mavlink.link_batch import Batch

__all__ = ["LastSenders"]


class LastSenders:
    """The sender of each system id so far."""

    def __init__(self) -> None:
        self._senders: list[tuple[int, int] | None] = [None] * 256

    def take(self, link: int, batch: Batch) -> Iterator[tuple[int, int]]:
        """Places in a batch, and system ids, of frames whose system id was last heard from another sender, or never.

        Args:
            link: the batch came over.
            batch: whole frames.
        """
        senders, claimed = self._senders, batch.claimed()
        if all(senders[system_id] == (link, peer) for peer, system_id in claimed):
            return  # nearly always
        for k, (peer, system_id) in enumerate(batch.claims()):
            if senders[system_id] != (link, peer):
                senders[system_id] = link, peer
                yield k, system_id
