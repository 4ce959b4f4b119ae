"""Evidence for the attitude fusion at a frame: telemetry's rotation, the turn that the pixels show, and boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.motion.rotation import CameraTurn

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedRotation:
    """The camera's rotation by telemetry, at a frame and at the samples of attitude since the one before."""

    R_enu_cam: FloatArray
    """(3, 3) at the frame's time and the filter's lag; without an attitude that of a level body."""
    known: bool
    """True if there is an attitude."""
    sample_us: tuple[int, ...] = ()
    """Times of the samples since the last frame, less the filter's lag, Unix µs."""
    samples_enu_cam: tuple[FloatArray, ...] = ()
    """(3, 3) the rotation by each."""
    seen_turn: CameraTurn | None = None
    """Turn of the camera since the last frame by the pixels; None: not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenTracks:
    """Tracks that have a box in a frame."""

    track_id: IntArray
    """(k,)."""
    ray: FloatArray
    """(k, 3) through each box, camera frame, third coordinate 1."""
    noise: FloatArray
    """(k,) 1σ of the first two coordinates."""
