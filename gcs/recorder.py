"""Everything a flight leaves behind, written as it happens: each file is valid whenever the program dies."""

from __future__ import annotations

import shutil
import threading
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs.config import Mission
from gcs.identitylog import EventLog, IdentityLog, open_new
from gcs.session import create_folder, mission_table
from gcs.snapshot import Event, Snapshot
from mavlink.packet import Packet
from mavlink.tlog import TlogWriter
from vision.detections import Detections

__all__ = ["Recorder"]

DETECTION_COLUMNS = "frame,cx,cy,w,h,angle,score,heading"


class Recorder:
    """One session folder, open for writing.

    ``packet`` and ``frame_time`` come from the links' and the video's threads, the rest from the fold's.
    """

    def __init__(self, parent: Path, mission: Mission, *, video: bool) -> None:
        """Make the folder and all files in it.

        Raises:
            SessionError: the folder or a file cannot be made.
        """
        self.folder = create_folder(parent)
        self.video_path = self.folder / "video.mkv" if video else None
        self._mission = mission
        self._notes: dict[str, Any] = {
            "format": 1,
            "program": f"rollcall-gcs {version('rollcall-gcs')}",
            "started": datetime.now(UTC),
        }
        with open_new(self.folder / "session.toml") as file:
            file.write(mission_table(mission, self._notes))
        self._tlog = TlogWriter(self.folder / "telemetry.tlog")
        self._tlog_lock = threading.Lock()
        self._identity = IdentityLog(self.folder)
        self._events = EventLog(self.folder / "events.jsonl")
        self._frames = open_new(self.folder / "frames.csv") if video else None
        self._detections = open_new(self.folder / "detections.csv") if video else None
        if self._frames and self._detections:
            self._frames.write("frame,time_us\n")
            self._frames.flush()
            self._detections.write(DETECTION_COLUMNS + "\n")
        self._packets = 0

    def packet(self, packet: Packet) -> None:
        """Append a raw packet, before anybody decodes it."""
        with self._tlog_lock:
            self._tlog.write(packet)
            self._packets += 1

    def frame_time(self, index: int, t_us: int) -> None:
        """Note when a frame of the recorded video was taken."""
        if self._frames:
            self._frames.write(f"{index},{t_us}\n")
            self._frames.flush()

    def detections(self, frame: int, detections: Detections) -> None:
        """Append what the detector saw in a frame."""
        if not self._detections:
            return
        d = detections
        for k in range(len(d)):
            heading = "" if d.heading[k] != d.heading[k] else f"{d.heading[k]:.4f}"
            box = f"{d.cx[k]:.2f},{d.cy[k]:.2f},{d.w[k]:.2f},{d.h[k]:.2f},{d.angle[k]:.4f}"
            self._detections.write(f"{frame},{box},{d.score[k]:.3f},{heading}\n")
        self._detections.flush()

    def snapshot(self, snapshot: Snapshot) -> None:
        """Append a frame's identities and events."""
        self._identity.write(snapshot)
        self._events.write(snapshot.events)

    def events(self, events: tuple[Event, ...]) -> None:
        """Append events of a moment without a frame."""
        self._events.write(events)

    @property
    def free_bytes(self) -> int:
        """Space left on the disk."""
        return shutil.disk_usage(self.folder).free

    @property
    def bytes(self) -> int:
        """Written so far."""
        return sum(path.stat().st_size for path in self.folder.iterdir())

    def close(self) -> None:
        """Seal the session: its end goes into ``session.toml``, which is replaced in one step."""
        self._tlog.close()
        self._identity.close()
        self._events.close()
        for file in (self._frames, self._detections):
            if file:
                file.close()
        self._notes |= {"ended": datetime.now(UTC), "packets": self._packets}
        sealed = self.folder / "session.toml.new"
        sealed.write_text(mission_table(self._mission, self._notes), encoding="utf-8")
        sealed.replace(self.folder / "session.toml")
