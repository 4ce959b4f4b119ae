"""Link URLs taken apart, in pymavlink's dialect (``udpin:0.0.0.0:14550``) and MAVSDK's (``udpin://0.0.0.0:14550``).

What kinds there are :mod:`mavlink.links.kinds` knows; the functions here read what follows the scheme.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from mavlink.errors import LinkError

DEFAULT_BAUD = 57600
"""Rate of the usual telemetry radios (SiK)."""
BARE_DEVICE = re.compile(r"/dev/|com\d+", re.IGNORECASE)
"""Start of the names of devices that need no scheme."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkUrl:
    """A link URL taken apart."""

    scheme: str
    """Kind of link, in the one spelling that :attr:`name` has."""
    host: str = ""
    port: int = 0
    device: str = ""
    """Path of a device, empty for the network."""
    baud: int = DEFAULT_BAUD

    @property
    def name(self) -> str:
        """Link in one spelling."""
        if self.scheme == "serial":
            bare = f"{self.device},{self.baud}"
            return bare if BARE_DEVICE.match(bare) else f"serial:{self.device}:{self.baud}"
        return f"{self.scheme}:{self.device or f'{self.host}:{self.port}'}"


def network_url(scheme: str, rest: str, *, default_port: int, default_host: str = "") -> LinkUrl:
    """Host and port behind a scheme.

    Args:
        rest: ``host:port``, ``host``, ``port``, each also with ``//`` before it.
        default_port: where there is none.
        default_host: where there is none; empty: one is needed.

    Raises:
        LinkError: no such port or host can be meant; the message does not name the URL.
    """
    host, colon, port = rest.removeprefix("//").rstrip("/").rpartition(":")
    if not colon:
        host, port = ("", port) if port.isdigit() else (port, "")
    if ":" in host or "[" in host:
        raise LinkError("IPv6 is not spoken here; give an IPv4 address or a name")
    number = _port(port) if port else default_port
    if not host and not default_host:
        raise LinkError("no host to connect to")
    return LinkUrl(scheme=scheme, host=host or default_host, port=number)


def serial_url(rest: str) -> LinkUrl:
    """A device with its baud rate behind a comma or a colon, ``57600`` where there is none.

    Raises:
        LinkError: no device or no rate; the message does not name the URL.
    """
    device, *rates = re.split("[:,]", re.sub(r"^//(?=/|[A-Za-z])", "", rest), maxsplit=1)
    rate = rates[0] if rates and rates[0] else str(DEFAULT_BAUD)
    if not device or not rate.isdigit() or int(rate) == 0:
        raise LinkError("no serial port with a baud rate")
    return LinkUrl(scheme="serial", device=device, baud=int(rate))


def _port(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 0 < int(text) < 65536:
        raise LinkError(f"{text!r} is no port; ports are 1 to 65535")
    return int(text)
