"""The newest frame, handed from who decodes to who shows."""

from __future__ import annotations

import threading

from av.video.frame import VideoFrame

__all__ = ["Newest"]


class Newest:
    """The newest decoded frame until somebody takes it."""

    def __init__(self) -> None:
        self.skipped = 0
        self.over = False
        self._fresh = threading.Condition()
        self._frame: tuple[int, int, VideoFrame] | None = None

    def put(self, index: int, t_us: int, frame: VideoFrame) -> None:
        """A frame was decoded; one that nobody took is counted."""
        with self._fresh:
            self.skipped += self._frame is not None
            self._frame = index, t_us, frame
            self._fresh.notify_all()

    def take(self, timeout_s: float) -> tuple[int, int, VideoFrame] | None:
        """The frame with index and time, None when none comes in time."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._frame is not None or self.over, timeout_s)
            frame, self._frame = self._frame, None
            return frame

    def end(self) -> None:
        """No more will come."""
        with self._fresh:
            self.over = True
            self._fresh.notify_all()
