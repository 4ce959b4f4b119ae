"""The tables of a session folder: their file names and columns, spelled once for all who write or read them.

Here because the simulator and the telemetry log write some of them and know nothing of the ground station, which reads
all of them (``gcs.session``). What the columns mean: ``docs/architecture.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

METADATA = "session.toml"
PROGRAM_LOG = "program.log"
LOG = "telemetry.tlog"
IDENTITY_EVIDENCE = "identity.jsonl"
EVENTS = "events.jsonl"
MARKS = "marks.jsonl"
VIEW_FOLDER = "view-{}"
"""Folder in a session's of what its second camera saw, and so on; the first one's files are in the session's own."""


@dataclass(frozen=True, slots=True)
class TableFormat:
    """A table in CSV: its file name, its first line, and which cells may be empty."""

    name: str
    heading: str
    """Names of the columns, with commas between."""
    optional: frozenset[str] = frozenset()
    """Columns whose cells may be empty, or that may be missing."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns in order."""
        return tuple(self.heading.split(","))

    @property
    def header(self) -> str:
        """The first line with its end."""
        return self.heading + "\n"


SENDERS = TableFormat("senders.csv", "record,t_us,system_id,link,peer,address,name")
REFUSED = TableFormat("refused.csv", "record,t_us,link,peer,auth")
CLOCK = TableFormat("clock.csv", "record,t_us,offset_us,step_us")
FRAMES = TableFormat("frames.csv", "frame,time_us")
DETECTIONS = TableFormat("detections.csv", "frame,cx,cy,w,h,angle,score,heading", frozenset({"heading"}))
LOOKS = TableFormat("looks.csv", "frame,left,top,right,bottom")
MOTION = TableFormat("motion.csv", "frame,h11,h12,h13,h21,h22,h23,h31,h32,std_px,inliers,share")
FOLDS = TableFormat(
    "folds.csv",
    "time_us,records,record_us,heard_us,frame,boxes,width,height",
    frozenset({"frame", "boxes", "width", "height"}),
)
ELSEWHERE = TableFormat("elsewhere.csv", "frame,camera,of_frame")
UNFOLDED = TableFormat("unfolded.csv", "record,count")
TRUTH = TableFormat("truth.csv", "frame,cx,cy,w,h,angle,system_id")
IDENTITY = TableFormat(
    "identity.csv",
    "time_us,frame,track_id,system_id,confidence,cx,cy,w,h,angle,heading,lat,lon",
    frozenset({"track_id", "system_id", "confidence", "heading", "lat", "lon"}),
)
