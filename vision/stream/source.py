"""Sources of live video as one line of text, and a UAV's offer of a stream in that form.

    udp://:5600   udp://0.0.0.0:5600    MPEG-TS or RTP (H.264, H.265, MPEG-TS), whichever comes
    rtp://:5600   rtp://:5600?codec=h265
    mpegts://:5600
    udp://239.1.1.1:5600                 a multicast group, joined
    udp://192.168.1.10:5600              an address that is not ours: only what that host sends
    rtsp://…                             RTSP over TCP, or UDP where the server offers nothing else
    tcp://…  http://…                    MPEG-TS or raw H.264, H.265; MJPEG or whatever FFmpeg reads over HTTP
    rtmp://0.0.0.0:1935/live             RTMP that a camera, an app or OBS pushes to this machine
    rtmp://192.168.1.10/live/main        RTMP fetched from a server
    /dev/video0   /dev/video0?size=1280x720&rate=30&format=mjpeg
    video.sdp                            a session that FFmpeg receives by itself
    flight.mp4                           a file, at its own pace

``udp265://`` and ``udp264://`` are ``rtp://`` with the codec named, as other stations write it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import parse_qsl, urlsplit

from infra.secrets import concealed
from vision.errors import VideoError
from vision.stream.srt_relay import relayed_address

Codec = Literal["", "h264", "hevc", "mpegts"]
"""Codec of datagrams; empty: to be found out."""

PORT = 5600
"""UDP port where the address names none."""
CODECS: Mapping[str, Codec] = {
    "": "",
    "auto": "",
    "h264": "h264",
    "avc": "h264",
    "h265": "hevc",
    "hevc": "hevc",
    "mpegts": "mpegts",
}
DATAGRAMS: Mapping[str, Codec] = {"udp": "", "rtp": "", "mpegts": "mpegts", "udp264": "h264", "udp265": "hevc"}
NETWORK = ("rtsp", "rtsps", "rtmp", "rtmps", "tcp", "http", "https")
NOT_BUILT = ("rist",)
"""Schemes that FFmpeg can receive, and the one that comes with PyAV cannot."""
ANY_HOST = ("", "0.0.0.0", "::")
CAMERA_KEYS = {"size": "video_size", "rate": "framerate", "format": "input_format"}

RTSP, RTP_UDP, TCP_MPEG, MPEG_TS = range(4)
"""VIDEO_STREAM_TYPE"""
H265 = 2
"""VIDEO_STREAM_ENCODING"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A place that video comes from."""

    text: str
    """Address as it was given, without passwords: what is shown, logged and recorded."""
    kind: Literal["datagrams", "network", "camera", "session", "file"]
    address: str = ""
    """Address for FFmpeg: a URL, device or path."""
    host: str = ""
    """Host of datagrams; empty: any address of this machine."""
    port: int = 0
    codec: Codec = ""
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def waits(self) -> bool:
        """True if others connect to it."""
        return self.options.get("listen") == "1"

    @property
    def paced(self) -> bool:
        """True if it has no pace of its own."""
        return self.kind == "file"


def parse_source(text: str) -> Source:
    """Parse the line of text that names a source.

    Raises:
        VideoError: a scheme, port or codec that there is none of.
    """
    if text.startswith("/dev/"):
        return _camera(text)
    shown = concealed(text)
    if "://" not in text:
        return Source(text=shown, kind="session" if text.lower().endswith(".sdp") else "file", address=text)
    scheme = text.partition("://")[0].lower()
    if scheme in DATAGRAMS:
        return _datagrams(text, DATAGRAMS[scheme])
    if scheme == "file":
        return Source(text=text, kind="file", address=urlsplit(text).path)
    if scheme in NETWORK:
        return _network(text, scheme)
    if scheme == "srt":
        address, listens = relayed_address(text, ANY_HOST)
        return Source(text=shown, kind="network", address=address, options={"listen": "1"} if listens else {})
    if scheme in NOT_BUILT:
        raise VideoError(
            f"video {shown}: {scheme}:// is not received: FFmpeg as it comes with PyAV is built without it; have the "
            "sender push RTMP to rtmp://0.0.0.0:1935/live, or send MPEG-TS over UDP"
        )
    raise VideoError(
        f"video {shown}: no source begins with {scheme}://; known are {', '.join((*DATAGRAMS, *NETWORK, 'srt'))}"
    )


def offered(stream_type: int, uri: str, encoding: int = 0) -> str:
    """The source that a VIDEO_STREAM_INFORMATION offers, empty when it is none that could be opened.

    The text comes from the air: it may name a stream on the network and nothing else, never a file or a device.

    Args:
        stream_type: VIDEO_STREAM_TYPE: 0 RTSP, 1 RTP over UDP, 2 MPEG over TCP, 3 MPEG-TS over UDP.
        uri: a URL, or the port alone.
        encoding: VIDEO_STREAM_ENCODING: 0 unknown, 1 H.264, 2 H.265.
    """
    uri = uri.strip()
    if stream_type in (RTP_UDP, MPEG_TS):
        return _offered_port(uri, "mpegts" if stream_type == MPEG_TS else "rtp", encoding)
    wanted = {RTSP: ("rtsp", "rtsps"), TCP_MPEG: ("tcp",)}.get(stream_type, ())
    scheme, found, rest = uri.partition("://")
    if not found:
        scheme, rest = next(iter(wanted), ""), uri
    if scheme.lower() not in wanted or not rest or any(c.isspace() or not c.isprintable() for c in uri):
        return ""
    try:
        parts = urlsplit(f"{scheme}://{rest}")
        usable = bool(parts.hostname) and parts.port != 0 and (stream_type == RTSP or parts.port is not None)
    except ValueError:
        return ""
    return parts.geturl() if usable else ""


def _offered_port(uri: str, scheme: str, encoding: int) -> str:
    """Datagrams come to us, whatever host the UAV names: only a multicast group is one to listen on."""
    try:
        parts = urlsplit(uri if "://" in uri else f"udp://{uri}" if ":" in uri else f"udp://:{uri}")
        port, host = parts.port, parts.hostname or ""
    except ValueError:
        return ""
    if not port:
        return ""
    known = "?codec=h265" if scheme == "rtp" and encoding == H265 else ""
    return f"{scheme}://{host if _is_group(host) else ''}:{port}{known}"


def _is_group(host: str) -> bool:
    first = host.partition(".")[0]
    return first.isdecimal() and 224 <= int(first) <= 239


def _datagrams(text: str, codec: Codec) -> Source:
    try:
        parts = urlsplit(text)
        # FFmpeg's way to write "any address" is udp://@:5600
        port, host = parts.port or PORT, parts.hostname or ""
    except ValueError:
        # not from the error, which repeats a part of the text
        raise VideoError(f"video {concealed(text)}: not an address; write for example udp://0.0.0.0:5600") from None
    named = dict(parse_qsl(parts.query)).get("codec", "").lower()
    if named not in CODECS:
        raise VideoError(f"video {concealed(text)}: codec {named!r} is not known here; use h264, h265 or mpegts")
    return Source(
        text=concealed(text),
        kind="datagrams",
        host="" if host == "0.0.0.0" else host,
        port=port,
        codec=CODECS[named] or codec,
    )


def _camera(text: str) -> Source:
    device, _, query = text.partition("?")
    options = {}
    for key, value in parse_qsl(query):
        if key not in CAMERA_KEYS:
            raise VideoError(f"video {text}: a camera has no {key!r}; use {', '.join(CAMERA_KEYS)}")
        options[CAMERA_KEYS[key]] = value
    return Source(text=text, kind="camera", address=device, options=options)


def _network(text: str, scheme: str) -> Source:
    """Return the source with options that keep delay low, and the stream from sending FFmpeg to files of ours or to
    other hosts.

    RTSP is not among the protocols that RTSP may open: a server that sends on is refused.
    """
    user, at, rest = text.partition("://")[2].rpartition("@")
    # FFmpeg ends the address at the first of them, also in a password
    address = f"{scheme}://{user.replace('#', '%23')}{at}{rest}"
    # a password may look like a port, and a path like a password
    if not any(map(_has_a_port, (f"//{rest}", text))):
        raise VideoError(f"video {concealed(text)}: not an address; write for example rtsp://10.0.0.2:8554/main")
    options = {"protocol_whitelist": "tcp,udp,rtp,tls,http,https,httpproxy,crypto", "fpsprobesize": "0"}
    if scheme.startswith("http"):
        options |= {"max_redirects": "0"}  # which host is asked is looked at in vision.stream.connection
    if scheme.startswith("rtsp"):
        options |= {"rtsp_transport": "udp+tcp", "rtsp_flags": "prefer_tcp"}
    if scheme.startswith("rtmp"):
        options |= {"protocol_whitelist": "rtmp,rtmps,tcp,tls", "rtmp_live": "live", "analyzeduration": "1000000"}
        if _host(rest) in ANY_HOST:
            options |= {"listen": "1"}
    return Source(text=concealed(text), kind="network", address=address, options=options)


def _has_a_port(address: str) -> bool:
    """Tell whether an address has a port that can be, or the usual one."""
    try:
        return urlsplit(address).port != 0
    except ValueError:
        return False


def _host(rest: str) -> str:
    """Host of an address without scheme and user."""
    try:
        return urlsplit(f"//{rest}").hostname or ""
    except ValueError:
        return rest
