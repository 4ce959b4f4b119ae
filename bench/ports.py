"""A port for one run."""

from __future__ import annotations

import random
import socket

_PORTS = iter(random.sample(range(20_000, 32_000), 12_000))
"""Below those that systems hand out by themselves: what is found free stays free until it is bound a while later."""


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port of 127.0.0.1 that is free at the moment; never the same twice."""
    for port in _PORTS:
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError("no port is left")
