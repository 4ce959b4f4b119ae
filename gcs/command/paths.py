"""Where a stream of commands goes: one function of the newest place for each kind of following."""

from __future__ import annotations

import math
from collections.abc import Callable

from gcs.command import mav_cmd
from gcs.command.mav_cmd import Command, GeoPoint
from mavlink.geodesy import LocalFrame

__all__ = ["Path", "above", "circles", "points"]

Path = Callable[[GeoPoint, bool], Command | None]
"""Given the newest place and whether this is the first command: the command, None when there is nothing to send."""


def above(alt_m: float) -> Path:
    """Over the vehicle, at a height above sea level."""
    return lambda place, first: mav_cmd.reposition(place, alt_m, change_mode=first)


def circles(around: GeoPoint, alt_m: float, *, radius_m: float, speed_mps: float, moved_m: float) -> Path:
    """The orbit anew whenever its middle has moved on; the first was ordered already."""
    middle = around

    def circle(place: GeoPoint, first: bool) -> Command | None:
        nonlocal middle
        if _distance_m(middle, place) < moved_m:
            return None
        middle = place
        return mav_cmd.orbit(place, alt_m, radius_m, speed_mps)

    return circle


def points(alt_m: float, *, radius_m: float, speed_mps: float, period_s: float) -> Path:
    """Points on a circle around the vehicle, clockwise, for autopilots without orbits."""
    angle = 0.0

    def point(place: GeoPoint, first: bool) -> Command | None:
        nonlocal angle
        # φ ← φ + v Δt / r
        angle += speed_mps * period_s / radius_m
        return mav_cmd.reposition(_beside(place, radius_m, angle), alt_m, change_mode=first)

    return point


def _beside(place: GeoPoint, distance_m: float, bearing: float) -> GeoPoint:
    """A place at a distance and a bearing from north."""
    frame = LocalFrame(place.lat_deg, place.lon_deg)
    lat, lon, _ = frame.to_geodetic([distance_m * math.sin(bearing), distance_m * math.cos(bearing), 0.0])
    return GeoPoint(float(lat), float(lon))


def _distance_m(a: GeoPoint, b: GeoPoint) -> float:
    east, north, _ = LocalFrame(a.lat_deg, a.lon_deg).to_enu_point(b.lat_deg, b.lon_deg, 0.0)
    return math.hypot(east, north)
