"""Links: where packets come from. All are silent: nothing is ever sent unless :meth:`Link.send` is called."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mavlink.links.batch import Batch, Claim
from mavlink.links.counters import LinkCounts
from mavlink.links.serial_port import SerialLink
from mavlink.links.tcp_client import TcpOut
from mavlink.links.tcp_server import TcpIn
from mavlink.links.udp import UdpIn, UdpOut
from mavlink.links.url import LinkUrl, parse_url
from mavlink.protocol.packet import Packet

__all__ = ["Link", "LinkCounts", "LinkUrl", "open_link", "parse_url"]


class Link(Protocol):
    """One way in for packets. One thread reads; any thread may send, look at the counts and close."""

    name: str

    @property
    def counts(self) -> LinkCounts:
        """What came so far."""

    def read(self, timeout_s: float) -> list[Packet]:
        """Packets in order of arrival, each stamped when it came; empty after the timeout and when closed."""

    def send(self, data: bytes, peer: int = 0) -> None:
        """Sends one frame to those on the other end who are known, or to the one of them with this number.

        Raises:
            LinkError: nobody is there, or it cannot be sent.
        """

    @property
    def files(self) -> tuple[int, ...]:
        """File descriptors to wait for; they change as connections come and go."""

    @property
    def overdue(self) -> bool:
        """Whether :meth:`take` may have something though no file is ready: what an unfinished frame has hidden."""

    def take(self) -> Batch:
        """What is there, without waiting."""

    def rest(self) -> Batch:
        """What an unfinished frame still hides, before the link is closed."""

    def tend(self) -> None:
        """Connects again, adapts filters; to be called every tenth of a second or so by who does not use ``read``."""

    def address(self, peer: int) -> str:
        """Host and port of the sender with this number; empty where there is none or it is not known."""

    def trust(self, claims: set[Claim], t_us: int) -> None:
        """These senders have proved who they are."""

    def close(self) -> None:
        """Closes the link; closing twice does nothing."""


_OPENERS: dict[str, Callable[[LinkUrl, int], Link]] = {
    "udpin": UdpIn,
    "udpout": UdpOut,
    "tcpin": TcpIn,
    "tcpout": TcpOut,
    "serial": SerialLink,
}


def open_link(url: str, index: int = 0) -> Link:
    """Opens a link.

    Args:
        url: as :func:`mavlink.links.url.parse_url` has it, for instance ``udpin:0.0.0.0:14550``.
        index: put into every packet as its ``link``.

    Raises:
        LinkError: bad URL, port in use, no such device or host; one line that says what to do.
    """
    parsed = parse_url(url)
    return _OPENERS[parsed.kind](parsed, index)
