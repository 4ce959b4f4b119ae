"""UDP sockets whose datagrams the kernel stamps when they arrive, however long they wait to be read."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys

from infra.wall_clock import now_us

LARGEST_DATAGRAM = 65536
_LINUX = sys.platform == "linux"
_SO_TIMESTAMPNS = 35
_SO_RCVBUFFORCE = 33
STAMP = (socket.SOL_SOCKET, _SO_TIMESTAMPNS)
"""Level and kind of the control message with the stamp, a ``struct timespec``; also of the socket's option."""
_TIMESPEC = struct.Struct("@qq")  # struct timespec on 64 bits
_ANCILLARY_BYTES = 64
"""Room for the control message that carries the stamp, 32 bytes on 64 bits."""


def open_stamped_udp(buffer_bytes: int) -> socket.socket:
    """A UDP socket that is not bound yet and does not block.

    Args:
        buffer_bytes: of the receive buffer; the system may grant less.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    if _LINUX:
        with contextlib.suppress(OSError):  # past the system's limit, where this program may
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, buffer_bytes)
        with contextlib.suppress(OSError):  # an older kernel: arrival is stamped after reading
            sock.setsockopt(*STAMP, 1)
    return sock


def receive_stamped(sock: socket.socket) -> tuple[bytes, tuple[str, int], int]:
    """The next datagram, its sender, and when it arrived, Unix µs: the kernel's stamp, else now.

    Raises:
        BlockingIOError: nothing is there.
        OSError: as of :meth:`socket.socket.recvmsg`.
    """
    data, ancillary, _, sender = sock.recvmsg(LARGEST_DATAGRAM, _ANCILLARY_BYTES)
    for level, kind, value in ancillary:
        if (level, kind) == STAMP and len(value) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(value)
            return data, sender, seconds * 1_000_000 + nanoseconds // 1000
    return data, sender, now_us()
