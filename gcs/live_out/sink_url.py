"""Addresses at which a flight is published, taken apart and checked before anything starts.

json+udp://192.168.1.20:5005       one JSON object a datagram
json+tcp://127.0.0.1:5006          served to whoever connects: one JSON object a line
foxglove://127.0.0.1:8765          served to Foxglove's viewers
udp://192.168.1.20:5600            the picture with names, H.264 in MPEG-TS; ?width=1280
rtp://192.168.1.20:5600            the same by RTP
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import parse_qsl

from gcs.errors import GcsError
from mavlink.errors import LinkError
from mavlink.links.kinds import parse_url
from mavlink.links.url import network_url

OPEN = "open"
"""Option without a value: serve other addresses than the loopback too."""
WIDTHS = (160, 7680)
"""Widths of pictures, px."""
FILES = ("cert", "key", "ca")
"""Options that name files: PEM."""


@dataclass(frozen=True, slots=True)
class SinkScheme:
    """Scheme of addresses, and what may be behind it."""

    example: str
    sink: str
    """Module in this folder and class."""
    options: tuple[str, ...] = ()
    serves: bool = False
    """True if the sink listens at the address: others come and read."""
    images: bool = False
    library: str = ""
    """Package it is made with that is not always installed; the extra has the same name."""


PUBLISH_SCHEMES = {
    "json+udp": SinkScheme("json+udp://127.0.0.1:5005", "json_lines:JsonUdp"),
    "json+tcp": SinkScheme("json+tcp://127.0.0.1:5006", "json_lines:JsonTcp", (OPEN,), serves=True),
    "cot+udp": SinkScheme("cot+udp://239.2.3.1:6969", "cot_sinks:CotUdp", ("interface",)),
    "cot+tcp": SinkScheme("cot+tcp://192.168.1.20:8087", "cot_sinks:CotTcp"),
    "cot+tls": SinkScheme(
        "cot+tls://tak.example.org:8089?cert=me.pem&key=me.key&ca=ca.pem", "cot_sinks:CotTls", (*FILES, "name")
    ),
    "foxglove": SinkScheme(
        "foxglove://127.0.0.1:8765",
        "foxglove_live:FoxgloveLive",
        (OPEN,),
        serves=True,
        images=True,
        library="foxglove",
    ),
}
STREAM_SCHEMES = {
    "udp": SinkScheme("udp://192.168.1.20:5600", "picture:MpegTsPicture", ("width",), images=True),
    "rtp": SinkScheme("rtp://192.168.1.20:5600", "picture:RtpPicture", ("width",), images=True),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkUrl:
    """One address."""

    text: str
    """Address as it was given, without its options: what is shown and logged."""
    scheme: str
    host: str
    port: int
    options: dict[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> SinkScheme:
        """Kind that its scheme stands for."""
        return (PUBLISH_SCHEMES | STREAM_SCHEMES)[self.scheme]


def parse_publish_url(url: str) -> SinkUrl:
    """An address of ``--publish``.

    Raises:
        GcsError: it is none; the message shows how to write one.
    """
    return _parse("--publish", url, PUBLISH_SCHEMES)


def parse_stream_url(url: str) -> SinkUrl:
    """An address of ``--stream``.

    Raises:
        GcsError: it is none; the message shows how to write one.
    """
    return _parse("--stream", url, STREAM_SCHEMES)


def check_separate(sinks: Iterable[SinkUrl], links: Sequence[str]) -> None:
    """Check that nothing but MAVLink goes where a telemetry link or an output is: a vehicle might take it for a
    command's start.

    Args:
        links: URLs of the flight's links and outputs, as ``mavlink.links`` writes them.

    Raises:
        GcsError: a port is that of a link.
    """
    ports = {parsed.port: link for link in links if (parsed := parse_url(link.partition("?")[0])).port}
    for sink in sinks:
        if sink.port in ports:
            raise GcsError(f"{sink.text}: port {sink.port} is that of {ports[sink.port]}; take another for this")


def _parse(option: str, url: str, schemes: dict[str, SinkScheme]) -> SinkUrl:
    text, _, query = url.strip().partition("?")
    scheme, colon, rest = text.partition("://")
    scheme = scheme.lower()
    if not colon or scheme not in schemes:
        raise GcsError(f"{option} {url}: no such address; write {_examples(schemes)}")
    kind = schemes[scheme]
    try:
        place = network_url(scheme, rest, default_port=0)
    except LinkError as error:
        raise GcsError(f"{option} {url}: {error}; write {kind.example}") from error
    if not place.port:
        raise GcsError(f"{option} {url}: no port; write {kind.example}")
    options = dict(parse_qsl(query, keep_blank_values=True))
    for name in options:
        if name not in kind.options:
            known = f"there are {', '.join(kind.options)}" if kind.options else "there are none"
            raise GcsError(f"{option} {url}: no option {name} of {scheme}; {known}")
    _check_options(f"{option} {url}", options)
    if kind.library and find_spec(kind.library) is None:
        raise GcsError(f"{option} {url}: install it with: pip install 'rollcall-gcs[{kind.library}]'")
    if kind.serves and OPEN not in options and not _is_loopback(place.host):
        raise GcsError(
            f"{option} {url}: anybody who reaches {place.host} could read it; serve it at 127.0.0.1, or write ?{OPEN} "
            "behind it if that is meant"
        )
    return SinkUrl(text=text, scheme=scheme, host=place.host, port=place.port, options=options)


def _check_options(url: str, options: dict[str, str]) -> None:
    for name in FILES:
        if name in options and not Path(options[name]).is_file():
            raise GcsError(f"{url}: no file {options[name] or 'is named'} for {name}; give it as PEM")
    if "key" in options and "cert" not in options:
        raise GcsError(f"{url}: key is that of a certificate; add cert=…")
    if "width" in options:
        width = options["width"]
        if not (width.isascii() and width.isdigit() and len(width) < 6 and WIDTHS[0] <= int(width) <= WIDTHS[1]):
            raise GcsError(f"{url}: width is a number of pixels from {WIDTHS[0]} to {WIDTHS[1]}")
    if "interface" in options:
        try:
            ipaddress.IPv4Address(options["interface"])
        except ValueError:
            raise GcsError(f"{url}: interface is the IPv4 address of one of this computer's networks") from None


def _examples(schemes: dict[str, SinkScheme]) -> str:
    *examples, last = (kind.example for kind in schemes.values())
    return f"{', '.join(examples)} or {last}" if examples else last


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
