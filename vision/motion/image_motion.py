"""Motion of the camera between two images, by the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageMotion:
    """Motion of the ground in the image from one frame to a later one."""

    H: NDArray[np.float64]
    """(3, 3) homography from pixels of the earlier frame to pixels of the later one; its last entry is 1."""
    std_px: float
    """1σ per axis of the points that follow it about where it puts them, px: what a point's flow is wrong by."""
    inliers: int
    """Points that follow it."""
    share: float
    """Share of the points that could be followed, 0..1; the others are vehicles, tall things, text on the image."""
