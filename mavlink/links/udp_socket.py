"""UDP sockets with a large buffer, stamped by the kernel, on ports that are theirs alone."""

from __future__ import annotations

import contextlib
import errno
import socket
import sys

from mavlink.errors import LinkError
from mavlink.links.port_owner import owner_of
from mavlink.links.recvmmsg import SO_TIMESTAMPNS
from mavlink.links.url import LinkUrl

__all__ = ["bind_udp", "connect_udp"]

_BUFFER_BYTES = 8 << 20
_SO_RCVBUFFORCE = 33
_LINUX = sys.platform.startswith("linux")


def _udp_socket() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    if _LINUX:
        with contextlib.suppress(OSError):  # past the system's limit, where this program may
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
        try:
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        except OSError:
            return sock  # an older kernel: arrival is stamped after reading
    return sock


def bind_udp(url: LinkUrl) -> socket.socket:
    """A socket on a port that is its own: two programs on one port would take packets from each other.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """
    sock = _udp_socket()
    try:
        sock.bind((url.host, url.port))
    except (OSError, UnicodeError) as error:
        sock.close()
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            text = f"{url.name}: UDP port {url.port} is in use{owner_of('udp', url.port)}; stop it or use another"
            raise LinkError(text) from None
        raise LinkError(f"{url.name}: cannot listen: {error}") from error
    return sock


def connect_udp(url: LinkUrl) -> socket.socket:
    """A socket that hears one address only: the system drops what others send.

    Raises:
        LinkError: no such host.
    """
    sock = _udp_socket()
    try:
        sock.connect((url.host, url.port))
    except (OSError, UnicodeError) as error:
        sock.close()
        raise LinkError(f"{url.name}: no such host: {error}") from error
    return sock
