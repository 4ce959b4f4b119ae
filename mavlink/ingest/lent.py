"""Sockets that the station opens and the ingest process only borrows, so that they outlive it with what is in them."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence

__all__ = ["BUFFER_BYTES", "small_buffers"]

BUFFER_BYTES = 4 << 20
"""A smaller receive buffer is warned of."""


def small_buffers(names: Sequence[str], sockets: Sequence[socket.socket | None]) -> Iterator[str]:
    """A warning for each UDP socket that was granted less than 4 MB."""
    for name, sock in zip(names, sockets, strict=True):
        if sock is None or sock.type != socket.SOCK_DGRAM:
            continue
        granted = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        if granted < BUFFER_BYTES:
            text = f"{name}: the system grants only {granted >> 10} kB of receive buffer, too little when it is busy"
            yield f"{text}; raise net.core.rmem_max to {BUFFER_BYTES}"
