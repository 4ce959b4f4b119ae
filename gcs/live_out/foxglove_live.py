"""A server for Foxglove's viewers: the channels of the MCAP export (``gcs.export.robotics.mcap``), as it happens.

``/log`` has alarms as they come: what else happened may have come with a snapshot that was missed.
"""

from __future__ import annotations

import av
import foxglove
import numpy as np
from foxglove import channels
from foxglove.messages import CompressedVideo
from numpy.typing import NDArray

from gcs.export.robotics.foxglove_channels import FoxgloveChannels
from gcs.export.robotics.foxglove_views import stamp_of
from gcs.live_out.encoder import CODEC, OPTIONS, LiveEncoder
from gcs.live_out.sink import Sink, SinkSource
from gcs.live_out.sink_url import SinkUrl
from gcs.snapshot import Snapshot
from infra.plain_text import plain

BACKLOG = 64
"""Messages that wait for a slow viewer, for which the oldest are dropped."""


class FoxgloveLive(Sink):
    """Sink that serves Foxglove; video is encoded only while somebody looks at it."""

    def __init__(self, url: SinkUrl, source: SinkSource) -> None:
        context = foxglove.Context()
        self._channels = FoxgloveChannels(context)
        self._video = channels.CompressedVideoChannel("/camera/video", context=context)
        self._encoder: LiveEncoder | None = None
        self._frame = -1
        self._logged: frozenset[str] = frozenset()
        """Keys of the alarms that are in the log."""
        try:
            self._server = foxglove.start_server(
                name=f"rollcall {plain(source.name)}",
                host=url.host,
                port=url.port,
                context=context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise OSError(str(error).partition(": ")[2] or str(error)) from error

    def write(self, snapshot: Snapshot) -> None:
        """Send a frame; in a replay without names where those may change when the analysis gets there."""
        if snapshot.image is not None and snapshot.frame != self._frame and self._video.has_sinks():
            self._show(snapshot, snapshot.image)
        self._frame = snapshot.frame
        if not snapshot.provisional and snapshot.analysed:
            self._channels.write(snapshot)
            for alarm in snapshot.alarms:
                if alarm.key not in self._logged:
                    self._channels.write_words(alarm.since_us, snapshot.t_us, alarm.level, alarm.kind, alarm.text)
            self._logged = frozenset(alarm.key for alarm in snapshot.alarms)
        self.sent += 1

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def _show(self, snapshot: Snapshot, image: NDArray[np.uint8]) -> None:
        height, width = (side - side % 2 for side in image.shape[:2])
        if self._encoder is None or self._encoder.size != (width, height):
            context = av.CodecContext.create(CODEC, "w")
            context.options = OPTIONS
            self._encoder = LiveEncoder(context, context.encode, width, height)
        for packet in self._encoder.encode(np.ascontiguousarray(image[:height, :width])):
            picture = CompressedVideo(
                timestamp=stamp_of(snapshot.t_us), frame_id="camera", data=bytes(packet), format="h264"
            )
            self._video.log(picture, log_time=1000 * snapshot.t_us)
