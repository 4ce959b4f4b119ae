"""When a system id is heard from another sender than before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mavlink.packet import MAGIC_V2

__all__ = ["LastSenders"]


class LastSenders:
    """The sender of each system id so far."""

    def __init__(self) -> None:
        self._senders = [-1] * 256

    def take(self, link: int, frames: Sequence[bytes], peers: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Places in a batch, and system ids, of frames whose system id was last heard from another sender, or never.

        Args:
            link: the batch came over.
            frames: whole frames of MAVLink 1 or 2.
            peers: number of each one's sender on that link.
        """
        senders, of_link = self._senders, link << 32
        for k, raw in enumerate(frames):
            system_id, sender = raw[5 if raw[0] == MAGIC_V2 else 3], of_link | peers[k]
            if senders[system_id] != sender:
                senders[system_id] = sender
                yield k, system_id
