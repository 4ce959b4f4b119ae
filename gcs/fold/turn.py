"""Values that the stages of the fold hand on: a turn, and what the detector's last look has found."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.records import Identities
from gcs.fold.camera.frame_camera import FrameCamera
from mavlink.state import FleetState
from vision.detect.detections import Detections
from vision.track.parts import JoinedBoxes
from vision.track.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One turn of the fold: a frame, or a moment between two, with what telemetry tells of it."""

    index: int
    """Place of the frame in the video, or ``NO_FRAME``."""
    t_us: int
    """Time on the video's clock, Unix µs."""
    state: FleetState
    """The fleet at that time, by telemetry's clock."""
    view: FrameCamera | None
    """The camera, by reports at first, after the first stage by the boxes, too; None without a position or a lens."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """Findings of a look of the detector: boxes and tracks of the first stage, their names of the second."""

    t_us: int
    """Time of the frame on the video's clock, Unix µs."""
    detections: Detections
    """Boxes of the frame as the detector drew them: a vehicle in two parts has two."""
    joined: JoinedBoxes
    """Boxes with one for each vehicle."""
    tracks: Tracks
    living: Collection[int]
    """All tracks, with those that have too little evidence to be shown just now."""
    size: tuple[int, int] | None
    """Width and height of the frame, px; None unknown."""
    view: FrameCamera | None
    """The camera as the boxes correct it; None unknown, and once names have begun anew."""
    uv: Mapping[int, NDArray[np.float64]]
    """Pixel (2,) of each vehicle's reported place then, by system id."""
    unlooked_s: Mapping[int, float]
    """Seconds for which nobody looked where vehicles report to be, by system id."""
    begins_anew: bool = False
    """True if names begin anew: another camera is used from the next frame on."""
    found: Identities | None = None
    """Names of the tracks; None without a camera pose, and once names have begun anew."""
