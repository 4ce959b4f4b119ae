"""The newest picture, handed from who decodes to who shows."""

from __future__ import annotations

import threading

from av.video.frame import VideoFrame

__all__ = ["Newest"]


class Newest:
    """The newest decoded picture until somebody takes it."""

    def __init__(self) -> None:
        self.skipped = 0
        self.over = False
        self._fresh = threading.Condition()
        self._picture: tuple[int, int, VideoFrame] | None = None

    def put(self, index: int, t_us: int, picture: VideoFrame) -> None:
        """A picture was decoded; one that nobody took is counted."""
        with self._fresh:
            self.skipped += self._picture is not None
            self._picture = index, t_us, picture
            self._fresh.notify_all()

    def take(self, timeout_s: float) -> tuple[int, int, VideoFrame] | None:
        """The picture with index and time, None when none comes in time."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._picture is not None or self.over, timeout_s)
            picture, self._picture = self._picture, None
            return picture

    def end(self) -> None:
        """No more will come."""
        with self._fresh:
            self.over = True
            self._fresh.notify_all()
