"""Errors of ``vision``.

VisionError
├── VideoError    a file, stream or recording that cannot be opened, read or written
├── ModelError    a detector model that is missing or has inputs or outputs we cannot use
├── CameraError   intrinsics or a mount that describe no camera
├── LabelError    a folder of labelled images, or a line of its labels, that cannot be used
└── TrainingError a folder of a training run that cannot be begun or continued
"""

from __future__ import annotations


class VisionError(Exception):
    """Base of all errors of this package; the message names the fault, the place and the remedy."""


class VideoError(VisionError):
    """A video file, stream or recording cannot be opened, read or written."""


class ModelError(VisionError):
    """A detector model is missing, damaged or of a shape that is not supported."""


class CameraError(VisionError):
    """Intrinsics or a mount describe no camera."""


class LabelError(VisionError):
    """Labelled images cannot be used: the message names the file and the line."""


class TrainingError(VisionError):
    """A training run cannot be begun, or not continued as it began."""
