"""Where the fleet is: the origin of the local frame, and which vehicles are too far from the others to be right."""

from __future__ import annotations

import math

from mavlink.estimation.positions import altitude_known
from mavlink.geodesy import LocalFrame, separation_m
from mavlink.protocol.messages import GlobalPosition

__all__ = ["FLEET_SPAN_M", "LOCAL_REACH_M", "TOO_FAR", "Origin"]

LOCAL_REACH_M = 50_000.0
"""The origin follows a UAV that is farther from it. There the Earth is 200 m below the plane, and north turns by half a
degree at 45° of latitude, a fourteenth of what a compass is taken to be off by."""
FLEET_SPAN_M = 200_000.0
"""Vehicles that one station receives and one camera films are never farther apart."""
TOO_FAR = "farther from the others than a radio reaches"
_CURRENT_US = 5_000_000
"""Vehicles that reported this lately are compared; positions come once a second at least."""

_Place = tuple[float, float]


class Origin:
    """The origin of the local frame, where every vehicle reports to be, and the altitude of the ground.

    Args:
        frame: to begin with, None unknown.
    """

    def __init__(self, frame: LocalFrame | None) -> None:
        self.frame = frame
        self.home_alt_m = math.nan
        """Altitude of the home plane, NaN unknown."""
        self._places: dict[int, tuple[int, _Place]] = {}

    def add_report(self, sample: GlobalPosition) -> None:
        """Notes where a vehicle reports to be."""
        self._places[sample.system_id] = (sample.t_us, (sample.lat_deg, sample.lon_deg))

    def learn_home(self, sample: GlobalPosition) -> None:
        """Learns the altitude of the ground from the UAV's height above home."""
        if altitude_known(sample.relative_alt_m) and altitude_known(sample.alt_m):
            self.home_alt_m = sample.alt_m - sample.relative_alt_m

    def move_to(self, sample: GlobalPosition) -> None:
        """Puts the origin where this vehicle is."""
        self.frame = LocalFrame(sample.lat_deg, sample.lon_deg, sample.alt_m)

    def distance_m(self, sample: GlobalPosition) -> float:
        """From the origin, 0 while there is none."""
        frame = self.frame
        return separation_m(frame.lat_deg, frame.lon_deg, sample.lat_deg, sample.lon_deg) if frame else 0.0

    def near_majority(self, sample: GlobalPosition) -> bool | None:
        """Whether a vehicle is where most of those that reported lately are; None without a majority at one place."""
        self._places = {i: row for i, row in self._places.items() if abs(sample.t_us - row[0]) < _CURRENT_US}
        places = [place for _, place in self._places.values()]
        here = (sample.lat_deg, sample.lon_deg)
        for place in places[: len(places) // 2 + 1]:  # a majority has a member among these
            if 2 * sum(_near(place, other) for other in places) > max(len(places), 2):
                return _near(place, here)
        return None


def _near(a: _Place, b: _Place) -> bool:
    return separation_m(*a, *b) <= FLEET_SPAN_M
