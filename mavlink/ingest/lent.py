"""Sockets that the station opens and the ingest process only borrows, so that they outlive it with what is in them."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence

from mavlink.links.tcp_client import resolve_tcp
from mavlink.links.tcp_server import listen_tcp
from mavlink.links.udp_socket import bind_udp, connect_udp
from mavlink.links.url import LinkUrl

__all__ = ["BUFFER_BYTES", "lend", "small_buffers"]

BUFFER_BYTES = 4 << 20
"""A smaller receive buffer is warned of."""


def lend(link: LinkUrl) -> tuple[socket.socket | None, str]:
    """Opens what outlives the process.

    Returns:
        The socket, None where the process opens the link itself; and the URL that it gets instead, empty: the same.

    Raises:
        LinkError: it cannot be opened.
    """
    if link.kind == "udpin":
        return bind_udp(link), ""
    if link.kind == "udpout":
        return connect_udp(link), ""
    if link.kind == "tcpin":
        return listen_tcp(link), ""
    if link.kind == "tcpout":
        host, port = resolve_tcp(link)
        return None, f"tcp:{host}:{port}"
    return None, ""


def small_buffers(names: Sequence[str], sockets: Sequence[socket.socket | None]) -> Iterator[str]:
    """A warning for each UDP socket that was granted less than 4 MB."""
    for name, sock in zip(names, sockets, strict=True):
        if sock is None or sock.type != socket.SOCK_DGRAM:
            continue
        granted = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        if granted < BUFFER_BYTES:
            text = f"{name}: the system grants only {granted >> 10} kB of receive buffer, too little when it is busy"
            yield f"{text}; raise net.core.rmem_max to {BUFFER_BYTES}"
