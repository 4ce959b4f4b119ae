"""A camera that is on no aircraft: where it stands and which way it looks, as the mission has it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from assoc.params import IdentifierParams
from mavlink.fleet.stand import Stand

MAST_ID = 256
"""Id within the program of a camera on a mast, one more for each place in the mission: beyond those of MAVLink."""
_USUAL = IdentifierParams()


@dataclass(frozen=True, slots=True, kw_only=True)
class Mast:
    """Stand of a camera that sends no MAVLink: a mast, a roof, a bridge. How far it looks down is in its ``Camera``."""

    name: str = ""
    """Name that operators call it by; ``Mast`` when empty."""
    latitude_deg: Annotated[float, Meta(ge=-90.0, le=90.0)]
    longitude_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]
    height_m: Annotated[float, Meta(ge=3.0, le=1000.0)] | None = None
    """Height of the camera above the ground that it films, metres; None unknown."""
    altitude_m: Annotated[float, Meta(ge=-500.0, le=9000.0)] | None = None
    """Altitude of the camera above sea level, as the vehicles report theirs; None unknown."""
    heading_deg: Annotated[float, Meta(ge=-360.0, le=360.0)]
    """Direction of the camera with ``yaw_deg`` 0, clockwise from north."""
    heading_std_deg: Annotated[float, Meta(ge=0.1, le=60.0)] = _USUAL.yaw_std_deg
    """1σ of that."""
    pitch_std_deg: Annotated[float, Meta(ge=0.1, le=20.0)] = _USUAL.tilt_std_deg
    """1σ of the camera's pitch and roll."""

    def __post_init__(self) -> None:
        if self.height_m is None and self.altitude_m is None:
            raise ValueError("height_m is missing; give how high the camera is, or altitude_m")

    @property
    def stand(self) -> Stand:
        """Stand of the mast as the fleet takes it."""
        return Stand(
            lat_deg=self.latitude_deg,
            lon_deg=self.longitude_deg,
            alt_m=math.nan if self.altitude_m is None else self.altitude_m,
            height_m=math.nan if self.height_m is None else self.height_m,
            heading=math.radians(self.heading_deg),
        )


def check_mount(mast: Mast | None, mount: str) -> None:
    """Check that a camera on a mast is no gimbal's; one that is on none passes.

    Raises:
        ValueError: it is.
    """
    if mast is not None and mount == "gimbal":
        raise ValueError('mount is "gimbal", and nothing reports one on a mast; leave it out')
