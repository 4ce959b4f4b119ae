"""The recording with boxes and names drawn in, as an H.264 mp4 that any player shows, at its own frame times."""

from __future__ import annotations

from fractions import Fraction

import av

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.report.labels import Labelling
from gcs.report.overlay import draw, image_labels
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot

TIME_BASE = Fraction(1, 90_000)


class Mp4Export:
    """Export to MP4; frames keep their time stamps, so that the film runs in step with the log."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._file = open_new(self._unfinished.path)
        # FFmpeg by itself would write over what is there, and through a link
        self._film = av.open(f"/dev/fd/{self._file.fileno()}", "w", format="mp4", options={"movflags": "+faststart"})
        self._stream: av.VideoStream | None = None
        self._start_us = 0
        self._last = -1
        self._labelling: Labelling | None = None

    def write(self, snapshot: Snapshot) -> None:
        """Append one drawn frame; two frames of the same moment keep the first."""
        self._labelling = image_labels(snapshot, former=self._labelling)
        image = draw(snapshot, labelling=self._labelling)
        height, width = (side - side % 2 for side in image.shape[:2])
        if self._stream is None:
            self._stream = self._film.add_stream("libx264", rate=30, options={"crf": "23", "preset": "veryfast"})
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
            self._stream.codec_context.time_base = TIME_BASE
            self._start_us = snapshot.t_us
        frame = av.VideoFrame.from_ndarray(image[:height, :width], format="bgr24")
        frame.pts = round((snapshot.t_us - self._start_us) * 1e-6 / TIME_BASE)
        frame.time_base = TIME_BASE
        if frame.pts <= self._last:
            return
        self._last = frame.pts
        self._film.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Flush the encoder and finish the file."""
        if self._stream is not None:
            self._film.mux(self._stream.encode(None))
        self._film.close()
        self._file.close()
        self._unfinished.finish()
