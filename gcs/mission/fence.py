"""Fences, inside or outside which vehicles stay: the mission file's ``[fence]``, or several of them as
``[[fence]]``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

Place = tuple[float, float]
"""Latitude and longitude, degrees."""
MIN_CORNERS = 3
MAX_CORNERS = 1000
"""Most corners: as many as anybody draws, and a tenth of a millisecond a frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fence:
    """A polygon or a circle that vehicles must not leave, or must not enter."""

    name: str = "fence"
    """Name that operators use."""
    keep: Literal["in", "out"] = "in"
    """Side of the fence on which vehicles stay."""
    polygon: Annotated[
        tuple[Place, ...], Meta(max_length=MAX_CORNERS, description="corners, each [latitude, longitude]")
    ] = ()
    """Corners of the fence in order; the last is joined to the first."""
    centre: Place | None = None
    """Centre of a circle, instead."""
    radius_m: Annotated[float, Meta(ge=0.0, le=100_000.0)] = 0.0
    vehicles: tuple[Annotated[int, Meta(ge=1, le=255)], ...] = ()
    """System ids for which it holds; empty: all ground vehicles."""

    def __post_init__(self) -> None:
        if bool(self.polygon) == (self.centre is not None):
            raise ValueError(
                "give polygon = [[latitude, longitude], …], or centre = [latitude, longitude] and radius_m"
            )
        if self.centre is not None and not self.radius_m:
            raise ValueError("centre needs radius_m, more than 0")
        if self.polygon and self.radius_m:
            raise ValueError("radius_m belongs to centre; leave it out")
        if self.polygon and len(set(self.polygon)) < MIN_CORNERS:
            raise ValueError(f"polygon has fewer than {MIN_CORNERS} corners")
        for lat_deg, lon_deg in (*self.polygon, *([self.centre] if self.centre else [])):
            if not (math.isfinite(lat_deg) and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
                raise ValueError(f"[{lat_deg}, {lon_deg}] is no place; latitude comes first")
