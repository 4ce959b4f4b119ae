"""The camera's pose and view at one frame, as snapshots tell it. World: ENU metres about the snapshot's origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraAim:
    """Pose and view of the camera at the UAV's position."""

    R_enu_cam: NDArray[np.float64]
    """(3, 3) camera vectors (x right, y down, z forward) into ENU, as corrected by what is seen."""
    R_enu_body: NDArray[np.float64]
    """(3, 3) the UAV's body (forward, right, down) into ENU, NaN unknown."""
    hfov: float
    """Field of view across the image, rad."""
    vfov: float
    """Down the image, rad."""
    ground_z: float
    """Height of the ground below, m."""
