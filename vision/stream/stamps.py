"""The time stamps of one connection's packets: missing ones, those that start again from another zero, and those
that come out of FFmpeg late."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from typing import TypeAlias

from av.packet import Packet
from av.video.stream import VideoStream as CodedStream

from vision.stream.frame_clock import BACK_S, JUMP_S

Coded: TypeAlias = "Packet[CodedStream]"


_RECENT = 16


class HeldBack:
    """Arrivals of frames that FFmpeg hands out with the first bytes of the next one, as those of RTP.

    That is earlier by one frame: by the shortest of the recent steps, since to date a frame early is remembered long.
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._last: int | None = None
        self._steps: deque[int] = deque(maxlen=_RECENT)

    def __call__(self, packet: Coded) -> float:
        """Unix time, as the packet comes out."""
        now_s = time.time()
        stamp = packet.pts if packet.dts is None else packet.dts
        if stamp is not None:
            if self._last is not None and stamp != self._last:
                self._steps.append(abs(stamp - self._last))
            self._last = stamp
        return now_s - min(self._steps, default=0) * self._tick_s


class Stamps:
    """Time stamps in units of ``tick_s``."""

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._opened_s = time.time()
        self._bare = True
        self._seen: tuple[float, float] | None = None

    def fill(self, packets: Sequence[tuple[Coded, float]]) -> None:
        """Give a time to packets without: RTSP's first comes so, and raw streams never have any.

        Args:
            packets: each with its Unix time of arrival.
        """
        following: list[int] = []
        for packet, arrival_s in reversed(packets):
            if packet.pts is None and packet.dts is not None:
                packet.pts = packet.dts
            if packet.pts is not None:
                self._bare = False
            elif following:
                step = following[1] - following[0] if len(following) > 1 else round(1 / 30 / self._tick_s)
                packet.pts = packet.dts = following[0] - max(step, 1)
            elif self._bare:
                packet.pts = packet.dts = round((arrival_s - self._opened_s) / self._tick_s)
            if packet.pts is not None:
                following = [packet.pts, *following[:1]]

    def has_restarted(self, packet: Coded, arrival_s: float) -> bool:
        """Tell whether the sender's time stamps started again: they went back, or jumped and the wall clock did not."""
        stamp_s = ((packet.pts if packet.dts is None else packet.dts) or 0) * self._tick_s
        before, self._seen = self._seen, (stamp_s, arrival_s)
        if before is None:
            return False
        step_s, elapsed_s = stamp_s - before[0], arrival_s - before[1]
        return step_s < -BACK_S or abs(step_s - elapsed_s) > JUMP_S
