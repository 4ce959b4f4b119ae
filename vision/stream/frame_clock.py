"""Capture times of live frames: the stream's even time stamps, mapped to Unix time by the arrivals of packets.

A network only ever delays. So Unix time of a frame = its time stamp + the least (arrival − time stamp) seen: the
fastest packet gives the offset, and the jitter of the others is gone. What remains is that least
delay itself (encoder, air, buffers), which ``offset_s`` of the stream takes out.

The least may only rise by ``CREEP`` (200 ppm), which lets it follow a camera whose clock is slower than ours. A camera
clock off by more, or a route that gets slower for good, shows as times that are early by what exceeds that.
"""

from __future__ import annotations

CREEP = 200e-6
"""s/s"""
JUMP_S = 5.0
"""A time stamp this far from where arrival puts it is a new time base, not a delay."""
BACK_S = 0.2
"""Step back in decoding order that counts likewise."""


class ArrivalClock:
    """Time stamps of one connection → Unix time."""

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._arrival_s = 0.0

    @property
    def known(self) -> bool:
        """True if a packet was seen."""
        return self._offset_s is not None

    def add(self, stamp_s: float, arrival_s: float) -> None:
        """A packet with time stamp ``stamp_s`` (s, any zero) arrived at Unix ``arrival_s``."""
        offset_s = arrival_s - stamp_s
        if self._offset_s is None or abs(offset_s - self._offset_s) > JUMP_S:
            self._offset_s = offset_s
        else:
            elapsed_s = max(arrival_s - self._arrival_s, 0.0)
            self._offset_s = min(offset_s, self._offset_s + CREEP * elapsed_s)
        self._arrival_s = arrival_s

    def unix_s(self, stamp_s: float) -> float:
        """Unix time of a time stamp; call ``add`` first."""
        return stamp_s + (self._offset_s or 0.0)
