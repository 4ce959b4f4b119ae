"""The picture with boxes and names drawn in, as ground stations and players take it: H.264 in MPEG-TS or RTP by UDP.

For little lag a slow receiver misses pictures, and time stamps are those at which a picture leaves.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from abc import abstractmethod
from dataclasses import replace
from typing import Final

import av
import av.container
import numpy as np
from numpy.typing import NDArray

from gcs.live_out.encoder import CODEC, OPTIONS, LiveEncoder
from gcs.live_out.sink import Sink, SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.report.labels import Labelling
from gcs.report.overlay import draw, image_labels
from gcs.snapshot import Snapshot

MAX_WIDTH: Final = 1920
"""Wider pictures are made smaller, unless another width is asked for."""
TTL: Final = 1
DATAGRAM_BYTES: Final = 1316
"""Seven packets of MPEG-TS: fits an Ethernet frame."""
PAYLOAD_TYPE: Final = 96


class _Picture(Sink):
    """Base of video sinks: draws, encodes and sends; a picture of another size begins a new stream."""

    def __init__(self, url: SinkUrl, source: SinkSource) -> None:
        del source
        address = socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        self._target = f"{address[0]}:{url.port}"
        self._width = int(url.options.get("width", MAX_WIDTH))
        self._film: av.container.OutputContainer | None = None
        self._encoder: LiveEncoder | None = None
        self._labelling: Labelling | None = None

    @abstractmethod
    def _open(self) -> av.container.OutputContainer:
        """Begin a stream."""

    def write(self, snapshot: Snapshot) -> None:
        """Send one picture; where there is no image, boxes and names on a dark one.

        Raises:
            OSError: it was not taken.
        """
        if snapshot.provisional:  # names may change when the analysis gets there
            snapshot = replace(snapshot, boxes=())
        scale = min(1.0, self._width / snapshot.width) if snapshot.width else 1.0
        self._labelling = image_labels(snapshot, scale=scale, former=self._labelling)
        image = draw(snapshot, scale=scale, labelling=self._labelling)
        height, width = (side - side % 2 for side in image.shape[:2])
        try:
            self._encode(np.ascontiguousarray(image[:height, :width]))
        except av.FFmpegError as error:
            raise OSError(error.errno, error.strerror) from error

    def _encode(self, image: NDArray[np.uint8]) -> None:
        height, width = image.shape[:2]
        if self._film is None or self._encoder is None or self._encoder.size != (width, height):
            self.close()
            self._film = self._open()
            stream = self._film.add_stream(CODEC, rate=30, options=OPTIONS)
            self._encoder = LiveEncoder(stream.codec_context, stream.encode, width, height)
        self._film.mux(self._encoder.encode(image))
        self.sent += 1

    def close(self) -> None:
        """End the stream."""
        film, self._film = self._film, None
        if film is not None:
            with contextlib.suppress(av.FFmpegError):  # what is lost is the end of a picture
                film.close()


class MpegTsPicture(_Picture):
    """Sink for ``udp://``: MPEG-TS."""

    def _open(self) -> av.container.OutputContainer:
        # tables often, so that receivers begin soon, and nothing is held back
        options = {"flush_packets": "1", "pat_period": "0.5"}
        url = f"udp://{self._target}?pkt_size={DATAGRAM_BYTES}&ttl={TTL}"
        return av.open(url, "w", format="mpegts", options=options)


class RtpPicture(_Picture):
    """Sink for ``rtp://``; a receiver needs what :func:`sdp` says."""

    def _open(self) -> av.container.OutputContainer:
        return av.open(f"rtp://{self._target}?ttl={TTL}", "w", format="rtp")


def sdp(url: SinkUrl) -> str:
    """Description of an RTP stream for its receiver (RFC 8866, RFC 6184); parameter sets come with the stream.

    Raises:
        OSError: no such host.
    """
    host = str(socket.getaddrinfo(url.host, url.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4][0])
    lines = (
        "v=0",
        "o=- 0 0 IN IP4 127.0.0.1",
        "s=rollcall",
        f"c=IN IP4 {host}" + (f"/{TTL}" if ipaddress.ip_address(host).is_multicast else ""),
        "t=0 0",
        f"m=video {url.port} RTP/AVP {PAYLOAD_TYPE}",
        f"a=rtpmap:{PAYLOAD_TYPE} H264/90000",
        f"a=fmtp:{PAYLOAD_TYPE} packetization-mode=1",
    )
    return "".join(f"{line}\r\n" for line in lines)
