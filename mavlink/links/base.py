"""Base of every kind of link. All are silent: nothing is ever sent unless :meth:`Link.send` is called."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from mavlink.links.batch import Batch, Claim
from mavlink.links.counters import Counters
from mavlink.links.report import LinkCounts, LinkReport
from mavlink.links.url import LinkUrl


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkOptions:
    """Options that a link is opened with. Each kind looks at what concerns it."""

    sock: socket.socket | None = None
    """The socket that :meth:`Link.prepare` gave; None: the link opens one."""
    system_ids: Collection[int] = ()
    """System ids whose frames make a sender known; empty: all."""
    trusts_checksums: bool = True
    """True if a valid checksum makes a sender known; otherwise :meth:`Link.trust` does, after a check of signatures."""
    waits_for_device: bool = False
    """True if a device that is not there now is waited for, and no error."""
    is_output: bool = False
    """True if packets are forwarded over it: every client is sent all of them, few clients are accepted, and what a
    client cannot take at once is queued."""


class Link(ABC):
    """A way in and out for frames. One thread uses it; any may look at the counts. Nothing waits.

    A new kind is a subclass in a file of its own, and its line in :data:`mavlink.links.kinds.KINDS`.

    Raises:
        LinkError: it cannot be opened; one line with what to do.
    """

    example: ClassVar[str]
    """A URL of this kind, shown to who writes a wrong one."""
    has_kernel_stamps: ClassVar[bool] = False
    """True if the system notes when something arrived, so that it may lie a moment to be read with what follows."""

    waits_to_be_contacted: ClassVar[bool] = False
    """True if the other end may send only once it has received a frame: it is to be sent heartbeats, where allowed."""

    def __init__(self, url: LinkUrl, options: LinkOptions) -> None:
        del options
        self.name = url.name
        self._open = True
        self._counters = Counters()

    @classmethod
    @abstractmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Parse what follows ``scheme:`` in a URL of this kind.

        Raises:
            LinkError: it is none; the message need not name the URL.
        """

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Do what is to be done once, before a process that receives is started or replaced.

        Returns:
            The URL for that process, and a socket that outlives it; None where it opens the link itself.

        Raises:
            LinkError: the link cannot be opened.
        """
        return url, None

    @property
    @abstractmethod
    def fds(self) -> tuple[int, ...]:
        """File descriptors to wait for; they change as connections come and go."""

    @property
    def overdue(self) -> bool:
        """True if :meth:`read_batch` may have something though no descriptor is ready."""
        return False

    @abstractmethod
    def read_batch(self) -> Batch:
        """Batch of what is there, without waiting; empty when there is nothing and when closed."""

    def read_rest(self) -> Batch:
        """Batch of what an unfinished frame still hides, before the link is closed."""
        return Batch()

    @abstractmethod
    def send(self, frame: bytes, peer: int = 0) -> bool:
        """Send one frame to those on the other end who are known, or to the one of them with this number.

        Returns:
            Whether it was taken at the other end, as far as is known.

        Raises:
            LinkError: there is no other end, or it cannot be sent.
        """

    def maintain(self) -> None:  # noqa: B027 - most links need none
        """Connect again, adapt filters; to be called every tenth of a second or so."""

    def set_fleet(self, system_ids: Collection[int]) -> None:  # noqa: B027 - as trust
        """Limit the senders that become known from now on to those of these systems."""

    def trust(self, claims: set[Claim], t_us: int) -> None:  # noqa: B027 - a link to one other end trusts it anyway
        """Mark senders as known: their signatures are valid."""

    def address(self, peer: int) -> str:
        """Host and port of the sender with this number; empty where there is none or it is not known."""
        del peer
        return ""

    @property
    def connected(self) -> bool:
        """True if the other end is there, as far as is known."""
        return True

    @property
    def last_peer(self) -> int:
        """Highest number given to a sender; where there is only one it is 1."""
        return 1

    @property
    def counts(self) -> LinkCounts:
        """Counts of what came so far."""
        return self._counters.snapshot()

    @property
    def troubles(self) -> tuple[str, ...]:
        """Limits of this link on this system."""
        return ()

    def report(self) -> LinkReport:
        """State of the link."""
        connected = self.connected
        return LinkReport(
            name=self.name, counts=self.counts, last_peer=self.last_peer, connected=connected, peers=int(connected)
        )

    def resume(self, before: LinkReport) -> None:  # noqa: B027 - most links remember nothing
        """Go on where another process ended: senders keep their numbers, and those who were known stay known."""

    @abstractmethod
    def close(self) -> None:
        """Close the link; closing twice does nothing."""
