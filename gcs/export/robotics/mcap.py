"""The recording as MCAP with Foxglove's schemas: film, boxes and names on it, vehicles in space and on a map, events.

    /camera/video              foxglove.CompressedVideo    H.264, frame "camera"
    /camera/annotations        foxglove.ImageAnnotations   oriented boxes and names, pixels
    /scene                     foxglove.SceneUpdate        vehicles seen, as cubes where they stand, frame "enu"
    /vehicles/SYSTEM_ID/fix    foxglove.LocationFix        where each vehicle and the UAV reports to be
    /log                       foxglove.Log                events
    /identity                  JSON                        rows as in identity.jsonl, a list for each frame

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas. Strangers are drawn without a name. Topics have
the vehicles' ids and not their names, which may hold anything.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Iterator

import foxglove
from foxglove import channels
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import CompressedVideo

from gcs.export.job import ExportJob
from gcs.export.robotics.annex_b import pictures_of
from gcs.export.robotics.foxglove_channels import FoxgloveChannels
from gcs.export.robotics.foxglove_views import stamp_of
from gcs.export.unfinished import Unfinished
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Snapshot
from infra.plain_text import plain


class McapExport:
    """One file; the film's pictures are written as their frames come, all of them also where frames are left out."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._context = foxglove.Context()
        options = MCAPWriteOptions(compression_threads=0)
        self._file = foxglove.open_mcap(self._unfinished.path, context=self._context, writer_options=options)
        self._file.write_metadata("rollcall", {"recording": plain(job.name)})
        self._video = channels.CompressedVideoChannel("/camera/video", context=self._context)
        self._channels = FoxgloveChannels(self._context)
        self._times_us = job.times_us
        self._pictures: Iterator[tuple[int, bytes]] = pictures_of(job.video, job.note) if job.video else iter(())
        self._next: deque[tuple[int, bytes]] = deque()

    def write(self, snapshot: Snapshot) -> None:
        """Append one frame."""
        self._show(snapshot.frame)
        self._channels.write(snapshot)
        for event in snapshot.events:
            text = text_with_sender(event, snapshot.name_of)
            self._channels.write_words(event.t_us, snapshot.t_us, event.level, event.kind, text)

    def close(self) -> None:
        """Append what is left of the film, and put the file into its place."""
        self._show(len(self._times_us))
        try:
            self._file.close()
        except RuntimeError as error:  # foxglove has no other, and tells here what it could not write before
            raise OSError(errno.EIO, plain(str(error))) from error
        self._unfinished.finish()

    def _show(self, frame: int) -> None:
        """The film's pictures up to a frame."""
        while self._next or self._take():
            index, data = self._next[0]
            if index > frame:
                return
            self._next.popleft()
            if index < len(self._times_us):
                t_us = int(self._times_us[index])
                picture = CompressedVideo(timestamp=stamp_of(t_us), frame_id="camera", data=data, format="h264")
                self._video.log(picture, log_time=1000 * t_us)

    def _take(self) -> bool:
        self._next.extend(picture for picture in [next(self._pictures, None)] if picture)
        return bool(self._next)
