"""A message in a video, before anything of it is read."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TimedBytes:
    """Bytes that a video carries with one of its moments."""

    t_us: int
    """µs since the video's first frame."""
    data: bytes
