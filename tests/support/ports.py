"""A port for one test."""

import os
import random
import socket
import sys

import pytest

needs_socket_filters = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's socket filters")

_SLOTS = 8
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:]) % _SLOTS
_PORTS = iter(random.sample(range(20_000 + _WORKER, 32_000, _SLOTS), 12_000 // _SLOTS))
"""Below those that systems hand out by themselves, each test process with its own share: what is found free stays free
until it is bound a while later."""


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port of 127.0.0.1 that nobody has at the moment; never the same twice."""
    for port in _PORTS:
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError("no port is left")


def udp_socket():
    """One that is bound to a port of its own and never waits."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.setblocking(False)
    return sock
