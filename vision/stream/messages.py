"""Messages between a video stream and its process; the images of frames go through memory that both share.

Nothing that comes from the process is more than numbers and text, so a process that a hostile stream took over can
falsify video and nothing else. The memory holds one image at a time: it is written before its reply is sent and read
after the reply was received, and system calls order memory.
"""

from __future__ import annotations

import msgspec

IMAGE_BYTES = 7680 * 4320 * 3
"""The largest image that is handed over; memory is used only for what is written."""


class Sender(msgspec.Struct, frozen=True):
    """Sender of datagrams to a port."""

    host: str
    port: int
    stream: int = 0
    """SSRC in RTP, else 0."""

    def __str__(self) -> str:
        return f"{self.host}:{self.port}" + (f" (SSRC {self.stream:08x})" if self.stream else "")


class Settings(msgspec.Struct, kw_only=True, tag=True):
    """Message from parent to process, once: what to do."""

    source: str
    record: str = ""
    """First file of the recording, empty for none."""
    segment: int = -1
    """Number of the last file that exists."""
    received: int = 0
    """Frames listed so far."""
    last_us: int = 0
    """Time of the last of them."""
    offset_s: float = 0.0
    memory: int = -1
    """File descriptor of the memory for images."""
    port: int = -1
    """File descriptor of the port that is bound; −1: there is none."""
    proven: list[Sender] = []
    """Senders that have shown a picture on it before, the first with the best right."""


class FrameRequest(msgspec.Struct, kw_only=True, tag=True):
    """Message from parent to process: send the newest frame, or the next one within ``wait_s``."""

    number: int
    wait_s: float


class Preference(msgspec.Struct, kw_only=True, tag=True):
    """Message from parent to process: the sender to be listened to before all others."""

    sender: Sender


class FrameReply(msgspec.Struct, kw_only=True, tag=True):
    """Message from process to parent: the answer; ``index`` is -1 when there was none, else the image is in the
    memory."""

    number: int
    index: int = -1
    t_us: int = 0
    width: int = 0
    height: int = 0


class Progress(msgspec.Struct, kw_only=True, tag=True):
    """Message from process to parent: how far it is."""

    patience_s: float
    """Time until the next sign of life at the latest, s."""
    rows: list[tuple[int, int]]
    """Index and Unix µs of frames listed since the last."""
    connected: bool = False
    ended: bool = False
    connections: int = 0
    skipped: int = 0
    undecoded: int = 0
    damaged: int = 0
    strangers: int = 0
    sender: Sender | None = None
    """Sender that is listened to."""
    rival: Sender | None = None
    """Another sender of video to the same port."""
    proven: list[Sender] = []
    exposure_source: str = ""
    """Data of the stream that date its frames, in words; empty where none do."""
    exposure_delay_s: float = 0.0
    clock_error_s: float = 0.0
    segment: int = -1
    error: str = ""
    recording_error: str = ""

    def after(self, before: Progress) -> Progress:
        """This, counted on from what an earlier process did."""
        return msgspec.structs.replace(
            self,
            connections=before.connections + self.connections,
            skipped=before.skipped + self.skipped,
            undecoded=before.undecoded + self.undecoded,
            damaged=before.damaged + self.damaged,
            strangers=before.strangers + self.strangers,
        )


VideoRequest = Settings | FrameRequest | Preference
VideoReport = FrameReply | Progress
