"""RTP as FFmpeg sends it."""

from __future__ import annotations

import socket
from fractions import Fraction

import av
import numpy as np

from vision.stream.rtp import parse

COUNT, GOP = 40, 8
CODECS = {
    "h264": ("libx264", "x264-params", "repeat-headers=1"),
    "hevc": ("libx265", "x265-params", "repeat-headers=1"),
}


def pack(codec):
    """COUNT noisy frames: the encoder's access units, and the datagrams that FFmpeg sends them in."""
    encoder, key, value = CODECS[codec]
    rng = np.random.default_rng(1)
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(0.3)
    units, datagrams = [], []
    with receiver, av.open(f"rtp://127.0.0.1:{receiver.getsockname()[1]}", "w", format="rtp") as container:
        extra = ":log-level=none:bframes=0:pools=none" if codec == "hevc" else ":bframes=0"
        options = {"preset": "ultrafast", "tune": "zerolatency", key: value + extra}
        stream = container.add_stream(encoder, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        stream.codec_context.gop_size = GOP
        for number in range(COUNT):
            image = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8) if number % 5 == 0 else image  # noqa: F821
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            for packet in stream.encode(frame):
                units.append(bytes(packet))
                container.mux(packet)
        for packet in stream.encode(None):
            units.append(bytes(packet))
            container.mux(packet)
        while True:
            try:
                datagrams.append(receiver.recv(65536))
            except TimeoutError:
                break
    return units, [data for data in datagrams if parse(data) is not None]
