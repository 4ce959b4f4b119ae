"""UDP links: one that listens, one that is connected to one address."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import replace

from infra.stamped_udp import open_stamped_udp
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.links.base import LinkOptions
from mavlink.links.port_owner import cannot_listen
from mavlink.links.report import LinkReport
from mavlink.links.udp_link import UdpLink
from mavlink.links.url import LinkUrl, network_url

MIN_BUFFER_BYTES = 4 << 20
"""A smaller receive buffer is warned of: seconds of a large fleet do not fit."""
_BUFFER_BYTES = 8 << 20
"""Receive buffer asked for: about a second of 10,000 packets."""
DEFAULT_PORT = 14550
"""Port that ground stations listen on."""
_RECEIVERS = 8
"""Programs at a time that packets are forwarded to over one port."""


class UdpIn(UdpLink):
    """Listens on a port that is its own.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """

    example = "udpin:0.0.0.0:14550"

    def __init__(
        self, url: LinkUrl, options: LinkOptions | None = None, *, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        options = options or LinkOptions()
        super().__init__(url, options, options.sock or _bind(url), clock_s)
        self._most_receivers = _RECEIVERS if options.is_output else None

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Address and port to listen on."""
        return network_url("udpin", rest, default_port=DEFAULT_PORT, default_host="0.0.0.0")

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Take the port, which then outlives the process that receives, with what is in its buffer."""
        return url, _bind(url)

    @property
    def port(self) -> int:
        """Port listened on."""
        port: int = self._socket.getsockname()[1]
        return port

    @property
    def troubles(self) -> tuple[str, ...]:
        """Warning that floods cannot be limited, on a system without socket filters."""
        text = f"{self.name}: this system has no socket filters; a flood of strangers can push others out"
        return (text,) if self.limiter.is_unsupported else ()

    def resume(self, before: LinkReport) -> None:
        """Senders keep their numbers, those who were known stay known, and what was dropped meanwhile is counted."""
        super().resume(before)
        known = {number: (host, port) for number, host, port in before.addresses}
        self.peers.restore(known, before.claims, before.mixed, before.last_peer, now_us())

    def send(self, frame: bytes, peer: int = 0) -> bool:
        """Send to all that sent good frames in the last minute, or to one sender.

        Args:
            peer: number of the one sender that is to get it, known or not; 0: all that are known, but only the first
                few where packets are forwarded: addresses can be forged, and all traffic would go there.

        Raises:
            LinkError: no such sender is known, or the system cannot send.
        """
        wanted = (
            self.peers.socket_addresses(peer) if peer else list(self.peers.addresses().values())[: self._most_receivers]
        )
        if not wanted:
            problem = f"cannot send to sender {peer}" if peer else "no receiver"
            raise LinkError(f"{self.name}: {problem}, nothing was received in the last minute")
        failed: LinkError | None = None
        for host, port in wanted:
            try:
                self._socket.sendto(frame, (host, port))
            except OSError as error:
                failed = LinkError(f"{self.name}: cannot send to {host}:{port}: {error.strerror}")
        if failed is not None:
            raise failed
        return True


class UdpOut(UdpLink):
    """Connected to one address: the system drops what others send. Sends nothing of its own.

    Raises:
        LinkError: no such host.
    """

    example = "udpout:host:port"
    waits_to_be_contacted = True

    def __init__(self, url: LinkUrl, options: LinkOptions | None = None) -> None:
        options = options or LinkOptions()
        trusting = replace(options, system_ids=(), trusts_checksums=True)  # the address was chosen in the URL
        super().__init__(url, trusting, options.sock or _connect(url))

    @classmethod
    def parse(cls, rest: str) -> LinkUrl:
        """Host and port of the other end."""
        return network_url("udpout", rest, default_port=DEFAULT_PORT)

    @classmethod
    def prepare(cls, url: LinkUrl) -> tuple[LinkUrl, socket.socket | None]:
        """Connect a socket that outlives the process that receives: the other end goes on to send to its port."""
        return url, _connect(url)

    def send(self, frame: bytes, peer: int = 0) -> bool:
        """Send to the address, the only peer there is.

        Returns:
            False where an earlier frame found no listener there. That is no error: there may be one now.

        Raises:
            LinkError: the network is down.
        """
        is_refused, self._is_refused = self._is_refused, False
        try:
            self._socket.send(frame)
        except ConnectionRefusedError:
            return False  # the answer to an earlier datagram
        except OSError as error:
            raise LinkError(f"{self.name}: cannot send: {error.strerror}") from error
        return not is_refused


def _bind(url: LinkUrl) -> socket.socket:
    """A socket on a port that is its own: two programs on one port would take packets from each other.

    Raises:
        LinkError: the port is in use, or the address is not one of this machine.
    """
    sock = open_stamped_udp(_BUFFER_BYTES)
    try:
        sock.bind((url.host, url.port))
    except (OSError, UnicodeError) as error:
        sock.close()
        raise cannot_listen(url, "udp", error) from error
    return sock


def _connect(url: LinkUrl) -> socket.socket:
    """A socket that receives from one address only: the system drops what others send.

    Raises:
        LinkError: no such host.
    """
    sock = open_stamped_udp(_BUFFER_BYTES)
    try:
        sock.connect((url.host, url.port))
    except (OSError, UnicodeError) as error:
        sock.close()
        raise LinkError(f"{url.name}: no such host: {error}") from error
    return sock
