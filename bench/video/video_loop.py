"""A video file sent round and round as MPEG-TS, in real time, without being encoded again."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import av


class VideoLoop:
    """Sends until closed."""

    def __init__(self, path: Path, url: str) -> None:
        self._path, self._url = path, url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop sending."""
        self._stop.set()
        self._thread.join(timeout=5)

    def _send(self) -> None:
        with av.open(self._url, "w", format="mpegts") as sink:
            outlet: Any = None
            start, shift_s = time.monotonic(), 0.0
            while not self._stop.is_set():
                with av.open(str(self._path)) as source:
                    stream = source.streams.video[0]
                    outlet = outlet or sink.add_stream_from_template(stream)
                    shift_s = self._round(sink, outlet, source.demux(stream), start, shift_s)

    def _round(self, sink: Any, outlet: Any, packets: Any, start: float, shift_s: float) -> float:  # noqa: ANN401
        """Once through the file; where the next round begins, seconds. PyAV publishes no types."""
        end_s = shift_s
        for packet in packets:
            if packet.dts is None or packet.pts is None:
                continue
            at_s = shift_s + float(packet.dts * packet.time_base)
            if self._stop.wait(max(0.0, start + at_s - time.monotonic())):
                break
            end_s = max(end_s, at_s + float((packet.duration or 0) * packet.time_base))
            shift = round(shift_s / packet.time_base)
            packet.pts, packet.dts = packet.pts + shift, packet.dts + shift
            packet.stream = outlet
            sink.mux(packet)
        return max(end_s, shift_s + 1e-2)
