"""The video of a flight: opened by name or when the UAV offers it, and what there is to report of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gcs.session.recorder import ViewRecorder
from gcs.snapshot import Event
from infra.secrets import concealed
from infra.wall_clock import now_us
from mavlink.protocol.messages import VideoStreamInformation
from mavlink.state import Level
from vision.errors import VideoError
from vision.stream.messages import Sender
from vision.stream.source import offered, parse_source
from vision.stream.stream import VideoStream
from vision.video.video import Frame

AUTO = "auto"
"""Word in place of a video's URL for what the UAV offers."""
IF_OFFERED = "auto if offered"
"""Word for a video that nobody asked for: none is waited for before the UAV offers one."""
_BY_OFFER = (AUTO, IF_OFFERED)
MANY_REFUSED = 20
"""Number of datagrams from other senders that are dropped before it is reported: some are the rest of an earlier
flight."""


def check_source(wanted: str) -> None:
    """Refuse a source that could never be opened, before anything else is.

    Raises:
        VideoError: it is none, or a file that is not there.
    """
    if wanted in ("", *_BY_OFFER):
        return
    source = parse_source(wanted)
    if source.kind in ("file", "session") and not Path(source.address).is_file():
        raise VideoError(f"video {source.text}: no such file")


class FlightVideo:
    """One camera, or none.

    Args:
        wanted: source; empty: none; ``auto`` and ``IF_OFFERED``: what the UAV offers, once it does.
        recorder: keeps the stream and the times of its frames.
    """

    def __init__(self, wanted: str, recorder: ViewRecorder) -> None:
        self.stream: VideoStream | None = None
        self._wanted, self._recorder = wanted, recorder
        self._offered = ""
        self._state = "none"
        self._reported = ("", "", 0)
        self._sender: Sender | None = None
        self._has_reported_refusals = False
        self._dated_by = ""
        if wanted not in ("", *_BY_OFFER):
            self._open(wanted)

    def latest(self, timeout_s: float) -> Frame | None:
        """The newest frame, waited for; None without one, at once without a stream."""
        return self.stream.latest(timeout_s) if self.stream else None

    @property
    def state(self) -> str:
        """``none``, ``waiting`` for an offer or the first frame, ``ok``, ``stalled`` or ``ended``."""
        if self.stream is None:
            is_awaited = self._wanted == AUTO or (self._wanted == IF_OFFERED and self._offered)
            return "waiting" if is_awaited else "none"
        if self.stream.ended:
            return "ended"
        if not self.stream.received:
            return "waiting"
        return "stalled" if self.stream.stalled else "ok"

    def check(self, offer: VideoStreamInformation | None) -> Iterator[Event]:
        """Events for what has changed; opens the stream that the UAV offers if that was asked for.

        Args:
            offer: the UAV's, None while it offers none.
        """
        if offer is not None and self.stream is None and offer.uri != self._offered:
            yield self._handle_offer(offer)
        if (state := self.state) != self._state:
            self._state = state
            if state != "stalled":  # of that there is an alarm
                yield _event("info", f"video {state}")
        if self.stream is not None:
            yield from self._changes(self.stream)

    def take_rival(self) -> str:
        """Listen to the other sender where two contest the port: its address, empty where nobody does."""
        rival = self.stream.rival if self.stream else None
        if self.stream is None or rival is None:
            return ""
        self.stream.prefer(rival)
        return str(rival)

    def close(self) -> None:
        """End the stream and its recording."""
        if self.stream:
            self.stream.close()

    def _open(self, url: str) -> None:
        self.stream = VideoStream(url, self._recorder.video_path, on_frame=self._recorder.frame_time)

    def _handle_offer(self, offer: VideoStreamInformation) -> Event:
        self._offered = offer.uri
        url = offered(offer.type, offer.uri, offer.encoding)
        if not url:
            return _event("warning", f"the UAV offers a video that cannot be opened: {concealed(offer.uri)}")
        if self._wanted in _BY_OFFER:
            self._open(url)
        return _event(
            "info",
            f"the UAV offers video at {concealed(url)}{'' if self._wanted else ', --video auto shows it'}",
        )

    def _changes(self, stream: VideoStream) -> Iterator[Event]:
        """Events for new errors and their ends, each once."""
        now = (stream.error, stream.recording_error, stream.restarts)
        how = stream.exposure
        if how and (kind := how.partition(",")[0].partition(":")[0]) != self._dated_by:
            self._dated_by = kind
            yield _event("warning" if "not used" in how else "info", f"frames are dated {how}")
        yield from self._senders(stream)
        before, self._reported = self._reported, now
        if now[0] and now[0] != before[0]:
            yield _event("warning", f"video: {now[0]}")
        if now[1] and now[1] != before[1]:
            yield _event("alarm", f"video is not recorded: {now[1]}")
        if before[1] and not now[1]:
            yield _event("info", "video is recorded again")
        if now[2] > before[2]:
            yield _event("warning", "the video's process was started again")

    def _senders(self, stream: VideoStream) -> Iterator[Event]:
        """Events for who sends datagrams: another one, and once that others send what is not used."""
        if stream.sender is not None and stream.sender != self._sender:
            before, self._sender = self._sender, stream.sender
            came = f", and no longer from {before}" if before else ""
            yield _event("warning" if before else "info", f"video comes from {stream.sender}{came}")
        if stream.strangers > MANY_REFUSED and not self._has_reported_refusals:
            self._has_reported_refusals = True
            yield _event("warning", f"others send to the video's port too; {stream.strangers} datagrams dropped")


def _event(level: Level, text: str) -> Event:
    return Event(t_us=now_us(), level=level, kind="video", text=text)
