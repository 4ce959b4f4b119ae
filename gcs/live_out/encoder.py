"""H.264 with little lag: no B-frames and no look-ahead, and a key frame a second with its parameter sets, so that a
receiver can begin at any time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Final

import av
import numpy as np
from av.video.frame import PictureType
from numpy.typing import NDArray

CODEC: Final = "libx264"
OPTIONS: Final = {
    "preset": "ultrafast",
    "tune": "zerolatency",
    "crf": "24",
    # a burst would wait in the queues of radios
    "maxrate": "8M",
    "bufsize": "2M",
    "forced-idr": "1",
    "x264-params": "bframes=0:repeat-headers=1",
}
TIME_BASE: Final = Fraction(1, 90_000)
KEY_FRAMES_S: Final = 1.0
THREADS: Final = 2


class LiveEncoder:
    """Encodes pictures as they come, stamped when they come.

    Args:
        context: of ``CODEC`` with ``OPTIONS``, not open yet.
        encode: its own method, or that of its stream.
        width: of all pictures, px, even.
        height: of all pictures, px, even.
    """

    def __init__(
        self,
        context: av.VideoCodecContext,
        encode: Callable[[av.VideoFrame], Sequence[av.Packet[av.VideoStream]]],
        width: int,
        height: int,
    ) -> None:
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.time_base = TIME_BASE
        context.thread_count = THREADS
        context.gop_size = 1000  # key frames are by time, whatever the frame rate
        self._encode = encode
        self.size = width, height
        self._began_s = self._key_due_s = time.monotonic()
        self._last_pts = -1

    def encode(self, image: NDArray[np.uint8]) -> Sequence[av.Packet[av.VideoStream]]:
        """Encode one picture, (height, width, 3) BGR.

        Raises:
            FFmpegError: it cannot.
        """
        now_s = time.monotonic()
        frame = av.VideoFrame.from_ndarray(image, format="bgr24")
        frame.time_base = TIME_BASE
        frame.pts = self._last_pts = max(round((now_s - self._began_s) / TIME_BASE), self._last_pts + 1)
        if now_s >= self._key_due_s:
            frame.pict_type = PictureType.I
            self._key_due_s = now_s + KEY_FRAMES_S
        return self._encode(frame)
