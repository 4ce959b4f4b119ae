"""From video to tracks: frames, camera geometry, oriented detection, tracking.

Pixels (x right, y down, from the picture's edge), radians, ENU metres, Unix µs (``t_us``). Box angle: image +x to the
width axis, clockwise on screen; image heading: clockwise from image up. Camera frame: x right, y down, z forward.
"""

from vision.camera import (
    Intrinsics,
    Mount,
    Pose,
    camera_pose,
    footprint,
    ground,
    ground_sampling,
    image_warp,
    project,
)
from vision.detections import Detections
from vision.errors import CameraError, ModelError, VideoError, VisionError
from vision.stream import VideoStream
from vision.tracker import Stitch, Tracker, TrackerParams, Tracks
from vision.video import Frame, VideoFile

__all__ = [
    "CameraError",
    "Detections",
    "Frame",
    "Intrinsics",
    "ModelError",
    "Mount",
    "Pose",
    "Stitch",
    "Tracker",
    "TrackerParams",
    "Tracks",
    "VideoError",
    "VideoFile",
    "VideoStream",
    "VisionError",
    "camera_pose",
    "footprint",
    "ground",
    "ground_sampling",
    "image_warp",
    "project",
]
