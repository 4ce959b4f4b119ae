"""Reason why a port cannot be had, with who holds it where the system reports it."""

from __future__ import annotations

import errno
from typing import Literal

import psutil

from infra.plain_text import plain
from mavlink.errors import LinkError
from mavlink.links.url import LinkUrl

_Protocol = Literal["udp", "tcp"]


def cannot_listen(url: LinkUrl, protocol: _Protocol, error: Exception) -> LinkError:
    """The error to raise when binding failed."""
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        held = f"{protocol.upper()} port {url.port} is in use{owner_of(protocol, url.port)}"
        return LinkError(f"{url.name}: {held}; stop it or use another")
    return LinkError(f"{url.name}: cannot listen: {error}")


def owner_of(protocol: _Protocol, port: int) -> str:
    """`` by process <id> (<name>)`` that holds a port, empty when it is not known: another user's, for instance.

    Of several the eldest is named: a station that lends its sockets to processes of its own is what a user would stop.
    Looks at every process, some tens of milliseconds: for errors only.
    """
    holders = []
    for process in psutil.process_iter():
        try:
            if any(held.laddr and held.laddr.port == port for held in process.net_connections(f"{protocol}4")):
                holders.append((process.create_time(), process.pid, process.name()))
        except (psutil.Error, OSError):
            continue  # gone meanwhile, or another user's
    if not holders:
        return ""
    _, process_id, name = min(holders)
    return f" by process {process_id} ({plain(name)})"
