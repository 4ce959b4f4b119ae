"""What a video stream and its process tell each other: small JSON texts, one frame at a time in shared memory.

Nothing that comes from the process is more than numbers and text, so a process that a hostile stream took over can tell
lies about video and nothing else.
"""

from __future__ import annotations

import json
import mmap
import os
import tempfile
from dataclasses import asdict, dataclass, replace
from typing import TypeVar

__all__ = [
    *("FrameReply", "Progress", "WorkerReport", "Request", "Settings", "decode", "encode"),
    *("SLOT_BYTES", "make_slot", "map_slot"),
]

SLOT_BYTES = 7680 * 4320 * 3
"""The largest frame that is handed over; memory is used only for what is written."""


class Message:
    """Base of all."""


class WorkerReport(Message):
    """From process to parent."""


@dataclass(slots=True, kw_only=True)
class Settings(Message):
    """Parent to process, once: what to do."""

    source: str
    record: str = ""
    """First file of the recording, empty for none."""
    segment: int = -1
    """Last file that exists."""
    received: int = 0
    """Frames listed so far."""
    last_us: int = 0
    """Time of the last of them."""
    offset_s: float = 0.0


@dataclass(slots=True, kw_only=True)
class Request(Message):
    """Parent to process: the newest frame, please, or what comes within ``wait_s``."""

    number: int
    wait_s: float


@dataclass(slots=True, kw_only=True)
class FrameReply(WorkerReport):
    """Process to parent: the answer; ``index`` is -1 when there was none, else the frame is in the slot."""

    number: int
    index: int = -1
    t_us: int = 0
    width: int = 0
    height: int = 0


@dataclass(slots=True, kw_only=True)
class Progress(WorkerReport):
    """Process to parent: how far it is."""

    patience_s: float
    """Until the next sign of life at the latest."""
    rows: list[list[int]]
    """Index and Unix µs of frames listed since the last."""
    connected: bool = False
    ended: bool = False
    connections: int = 0
    skipped: int = 0
    undecoded: int = 0
    damaged: int = 0
    strangers: int = 0
    told_by: str = ""
    """How the stream tells when its frames were taken, empty where it does not."""
    told_delay_s: float = 0.0
    told_error_s: float = 0.0
    segment: int = -1
    error: str = ""
    recording_error: str = ""

    def after(self, before: Progress) -> Progress:
        """This, counted on from what an earlier process did."""
        return replace(
            self,
            connections=before.connections + self.connections,
            skipped=before.skipped + self.skipped,
            undecoded=before.undecoded + self.undecoded,
            damaged=before.damaged + self.damaged,
            strangers=before.strangers + self.strangers,
        )


_KINDS: dict[str, type[Message]] = {kind.__name__: kind for kind in (Settings, Request, FrameReply, Progress)}
_Kind = TypeVar("_Kind", bound=Message)


def encode(message: Message) -> bytes:
    """A message as bytes."""
    return json.dumps([type(message).__name__, asdict(message)]).encode()  # type: ignore[call-overload]


def decode(data: bytes, kind: type[_Kind]) -> _Kind:
    """The message back.

    Raises:
        ValueError: not one of that kind.
    """
    try:
        name, fields = json.loads(data)
        message = _KINDS[name](**fields)
    except (TypeError, KeyError) as error:
        raise ValueError(f"not a message: {data[:80]!r}") from error
    if not isinstance(message, kind):
        raise ValueError(f"not a {kind.__name__}: {data[:80]!r}")
    return message


def make_slot() -> int:
    """A file descriptor of memory for one frame, with no name that could be left behind."""
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("frame")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, SLOT_BYTES)
    return fd


def map_slot(fd: int) -> mmap.mmap:
    """The memory itself."""
    return mmap.mmap(fd, SLOT_BYTES)
