"""Inputs of the search for an unknown camera: boxes' places in the picture, the UAV's path, the fleet's places.

All are sampled at the same B times. A box's place in the picture is that of its centre, from the middle of the picture,
in widths of the picture: x right, y down. So the focal length, φ, is in widths too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from assoc.errors import ShapeError

FloatArray = NDArray[np.float64]
MountKind = Literal["stabilized", "fixed", "gimbal"]
"""Support of a camera: a gimbal that holds the horizon and turns with the nose, the body, or a gimbal that reports
which way it looks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownMount:
    """A direction that was stated, give or take some degrees; of a gimbal that reports, both angles are 0."""

    kind: MountKind
    pitch: float
    """Radians, negative down."""
    yaw: float
    """Radians clockwise from the nose."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmedFleet:
    """A film's tracks beside the fleet's reports. B times, T tracks, V vehicles."""

    t: FloatArray
    """(B,) seconds, increasing."""
    picture: FloatArray
    """(B, T, 2) place of each track in the picture, widths; NaN unseen."""
    vehicle_enu: FloatArray
    """(B, V, 2) reported east and north, metres; NaN unknown."""
    R_enu_base: FloatArray
    """(B, 3, 3) attitude of the UAV (FRD), or of a gimbal that reports; of a level UAV whose nose points north where it
    is unknown."""
    p_enu: FloatArray
    """(B, 3) place of the UAV, metres."""
    ground_z: float
    """Height of the ground plane, metres."""
    heading_known: bool
    """False: the UAV's heading is not known, but is taken not to have changed."""
    focal: float = np.nan
    """φ where it is known, widths of the picture; else NaN."""
    mount: KnownMount | None = None
    """None: nothing is known of the direction."""

    @property
    def step_s(self) -> float:
        """Usual time from one sample to the next, seconds."""
        return float(np.median(np.diff(self.t)))

    def __post_init__(self) -> None:
        count, tracks, vehicles = len(self.t), self.picture.shape[1], self.vehicle_enu.shape[1]
        shapes = {
            "picture": (count, tracks, 2),
            "vehicle_enu": (count, vehicles, 2),
            "R_enu_base": (count, 3, 3),
            "p_enu": (count, 3),
        }
        for name, shape in shapes.items():
            if (found := getattr(self, name).shape) != shape:
                raise ShapeError(f"{name}: expected shape {shape}, got {found}")
