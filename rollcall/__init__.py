"""Rollcall from Python: recordings, names, scores, and the identifier alone.

Metres east, north and up, radians, Unix microseconds and pixels; NaN is an unknown number, 0 an unknown system id.

Example:
    >>> import rollcall
    >>> flight = rollcall.open("session")
    >>> boxes = flight.identify()
    >>> bool(rollcall.score(boxes, flight.truth).precision > 0.95)
    True
"""

from rollcall import _packages as _packages  # first: whose packages are found from here on

# isort: split
from assoc.identification.identifier import Identifier
from assoc.params import IdentifierParams
from assoc.records import CameraState, Identities, Observation, VehicleReports
from gcs.errors import GcsError
from gcs.export.tables.named_boxes import NamedBoxes
from gcs.mission.mission import Mission
from gcs.playback.flight_recording import FlightRecording
from gcs.playback.flight_recording import open_flight as open
from gcs.playback.flight_recording import score_boxes as score
from gcs.report.score import Score
from gcs.snapshot import Alarm, Box, Candidate, Event, Snapshot, VehicleRow
from mavlink.errors import MavlinkError
from mavlink.tlog.log import Tlog
from vision.camera.intrinsics import Intrinsics
from vision.detect.detections import Detections
from vision.errors import VisionError

__all__ = [
    "Alarm",
    "Box",
    "CameraState",
    "Candidate",
    "Detections",
    "Event",
    "FlightRecording",
    "GcsError",
    "Identifier",
    "IdentifierParams",
    "Identities",
    "Intrinsics",
    "MavlinkError",
    "Mission",
    "NamedBoxes",
    "Observation",
    "Score",
    "Snapshot",
    "Tlog",
    "VehicleReports",
    "VehicleRow",
    "VisionError",
    "open",
    "read_tlog",
    "score",
]

read_tlog = Tlog.open
"""Opens a telemetry log; its ``columns`` gives all messages of one kind as numpy columns."""
