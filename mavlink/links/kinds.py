"""All kinds of links, and the one way to open a link: for receiving, for forwarding, for checks."""

from __future__ import annotations

import re

from mavlink.errors import LinkError
from mavlink.links.base import Link, LinkOptions
from mavlink.links.stream_link import SerialLink, TcpOut
from mavlink.links.tcp_server import TcpIn
from mavlink.links.udp import UdpIn, UdpOut
from mavlink.links.url import BARE_DEVICE, LinkUrl

KINDS: dict[str, type[Link]] = {
    "udpin": UdpIn,
    "udp": UdpIn,
    "udpout": UdpOut,
    "tcp": TcpOut,
    "tcpout": TcpOut,
    "tcpin": TcpIn,
    "serial": SerialLink,
}
"""Scheme of a link's URL → what opens it."""
_BARE_PORT = re.compile(r"\d+")


def parse_url(url: str) -> LinkUrl:
    """Take a link URL apart.

    Args:
        url: ``udpin:``, ``udp:`` (listens, as in pymavlink), ``udpout:``, ``tcp:``, ``tcpin:``, each also with ``//``;
            a device with its baud rate after a comma, or ``serial://device:baud``; or a bare UDP port to listen on.

    Raises:
        LinkError: it is none of these; the message shows how to write one.
    """
    text = url.strip()
    if _BARE_PORT.fullmatch(text):
        text = f"udpin:{text}"
    elif BARE_DEVICE.match(text):
        text = f"serial:{text}"
    scheme, colon, rest = text.partition(":")
    kind = KINDS.get(scheme.lower()) if colon else None
    if kind is None:
        raise LinkError(f"{url!r}: not a link; {_how_to_write()}")
    try:
        return kind.parse(rest)
    except LinkError as error:
        raise LinkError(f"{url!r}: {error}; {_how_to_write()}") from error


def kind_of(url: str | LinkUrl) -> type[Link]:
    """Kind of link that opens a URL.

    Raises:
        LinkError: bad URL.
    """
    return KINDS[(parse_url(url) if isinstance(url, str) else url).scheme]


def open_link(url: str | LinkUrl, options: LinkOptions | None = None) -> Link:
    """Open a link.

    Args:
        url: as :func:`parse_url` has it, for instance ``udpin:0.0.0.0:14550``.
        options: what it is for; None: to receive from any sender.

    Raises:
        LinkError: bad URL, port in use, no such device or host; one line with what to do.
    """
    parsed = parse_url(url) if isinstance(url, str) else url
    return kind_of(parsed)(parsed, options or LinkOptions())


def _how_to_write() -> str:
    *examples, last = dict.fromkeys(kind.example for kind in KINDS.values())
    return f"write {', '.join(examples)} or {last}"
