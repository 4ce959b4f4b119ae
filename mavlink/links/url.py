"""Link URLs, in pymavlink's dialect (``udpin:0.0.0.0:14550``) and MAVSDK's (``udpin://0.0.0.0:14550``)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from mavlink.errors import LinkError

__all__ = ["LinkUrl", "parse_url"]

Kind = Literal["udpin", "udpout", "tcpin", "tcpout", "serial"]

_KINDS: dict[str, Kind] = {
    "udpin": "udpin",
    "udp": "udpin",
    "udpout": "udpout",
    "tcp": "tcpout",
    "tcpout": "tcpout",
    "tcpin": "tcpin",
}
_DEFAULT_PORT = {"udpin": 14550, "udpout": 14550, "tcpout": 5760, "tcpin": 5760}
_DEFAULT_BAUD = 57600
_HOW = "write udpin:0.0.0.0:14550, udpout:host:port, tcp:host:port, tcpin:0.0.0.0:5760 or /dev/ttyUSB0,57600"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkUrl:
    """A link URL taken apart."""

    kind: Kind
    host: str = ""
    port: int = 0
    device: str = ""
    """Serial port, empty for the network."""
    baud: int = _DEFAULT_BAUD

    @property
    def name(self) -> str:
        """The same link in one spelling."""
        if self.kind == "serial":
            return f"{self.device},{self.baud}"
        return f"{'tcp' if self.kind == 'tcpout' else self.kind}:{self.host}:{self.port}"


def parse_url(url: str) -> LinkUrl:
    """Takes a link URL apart.

    Args:
        url: ``udpin:``, ``udp:`` (listens, as in pymavlink), ``udpout:``, ``tcp:``, ``tcpin:``, each also with ``//``;
            a device with its baud rate after a comma, or ``serial://device:baud``; or a bare UDP port to listen on.

    Raises:
        LinkError: it is none of these; the message shows how to write one.
    """
    text = url.strip()
    if text.isdigit():
        return LinkUrl(kind="udpin", host="0.0.0.0", port=_port(text, url))
    scheme, colon, rest = text.partition(":")
    if colon and scheme.lower() == "serial":
        return _serial(re.sub(r"^//(?=/|[A-Za-z])", "", rest), url, r"[:,]")
    if colon and scheme.lower() in _KINDS:
        return _network(_KINDS[scheme.lower()], rest.removeprefix("//").rstrip("/"), url)
    if text.startswith("/dev/") or re.match(r"(?i)com\d+", text):
        return _serial(text, url, r",")
    raise LinkError(f"{url!r}: not a link; {_HOW}")


def _network(kind: Kind, rest: str, url: str) -> LinkUrl:
    host, colon, port = rest.rpartition(":")
    if not colon:
        host, port = ("", rest) if rest.isdigit() else (rest, "")
    if ":" in host or "[" in host:
        raise LinkError(f"{url!r}: IPv6 is not spoken here; give an IPv4 address or a name")
    number = _port(port, url) if port else _DEFAULT_PORT[kind]
    if not host:
        if kind.endswith("out"):
            raise LinkError(f"{url!r}: no host to connect to; {_HOW}")
        host = "0.0.0.0"
    return LinkUrl(kind=kind, host=host, port=number)


def _port(text: str, url: str) -> int:
    if not text.isascii() or not text.isdigit() or not 0 < int(text) < 65536:
        raise LinkError(f"{url!r}: {text!r} is no port; ports are 1 to 65535")
    return int(text)


def _serial(text: str, url: str, separator: str) -> LinkUrl:
    device, *rates = re.split(separator, text, maxsplit=1)
    rate = rates[0] if rates and rates[0] else str(_DEFAULT_BAUD)
    if not device or not rate.isdigit() or int(rate) == 0:
        raise LinkError(f"{url!r}: no serial port with a baud rate; write /dev/ttyUSB0,57600")
    return LinkUrl(kind="serial", device=device, baud=int(rate))
