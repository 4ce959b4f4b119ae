"""The fleet's place: the origin of the local frame, and which vehicles are too far from the others to be right."""

from __future__ import annotations

import math

from mavlink.estimation.positions import altitude_known
from mavlink.geodesy import LocalFrame, separation_m
from mavlink.protocol.messages import GlobalPosition

LOCAL_REACH_M = 50_000.0
"""The origin is moved to a UAV that is farther from it than this. There the Earth is 200 m below the plane, and north
turns by half a degree at 45° of latitude, a fourteenth of what a compass is taken to be off by."""
FLEET_SPAN_M = 200_000.0
"""Largest plausible distance between vehicles that one station receives and one camera films."""
_SURELY_NEAR_DEG = 1.0
"""Places that differ by less in latitude and in longitude are no more than 158 km apart."""
TOO_FAR = "farther from the others than a radio reaches"
_CURRENT_US = 5_000_000
"""Age of the positions that are compared, µs; positions are sent at least once a second."""

_Place = tuple[float, float]


class Origin:
    """The origin of the local frame, the last reported position of every vehicle, and the altitude of the ground.

    Args:
        frame: the first local frame, None unknown.
    """

    def __init__(self, frame: LocalFrame | None) -> None:
        self.frame = frame
        self.home_alt_m = math.nan
        """Altitude of the home plane, NaN unknown."""
        self._places: dict[int, tuple[int, _Place]] = {}

    def add_report(self, sample: GlobalPosition) -> None:
        """Store the reported position of a vehicle."""
        self._places[sample.system_id] = (sample.t_us, (sample.lat_deg, sample.lon_deg))

    def set_home_altitude(self, sample: GlobalPosition) -> None:
        """Set the altitude of the home plane from the UAV's altitude and height above home, where both are known."""
        if altitude_known(sample.relative_alt_m) and altitude_known(sample.alt_m):
            self.home_alt_m = sample.alt_m - sample.relative_alt_m

    def move_to(self, sample: GlobalPosition) -> None:
        """Move the origin to the position of a vehicle."""
        self.frame = LocalFrame(sample.lat_deg, sample.lon_deg, sample.alt_m)

    def distance_m(self, sample: GlobalPosition) -> float:
        """Distance of a position from the origin, 0 while there is none."""
        frame = self.frame
        return separation_m(frame.lat_deg, frame.lon_deg, sample.lat_deg, sample.lon_deg) if frame else 0.0

    def is_far(self, sample: GlobalPosition) -> bool:
        """Tell whether a position is farther from the origin than vehicles of one fleet are from each other."""
        frame = self.frame
        if frame and max(abs(sample.lat_deg - frame.lat_deg), abs(sample.lon_deg - frame.lon_deg)) < _SURELY_NEAR_DEG:
            return False
        return self.distance_m(sample) > FLEET_SPAN_M

    def near_majority(self, sample: GlobalPosition) -> bool | None:
        """Tell whether a vehicle is near the majority of those that reported recently; None without such a majority."""
        self._places = {i: row for i, row in self._places.items() if abs(sample.t_us - row[0]) < _CURRENT_US}
        places = [place for _, place in self._places.values()]
        here = (sample.lat_deg, sample.lon_deg)
        for place in places[: len(places) // 2 + 1]:  # a majority has a member among these
            if 2 * sum(_near(place, other) for other in places) > max(len(places), 2):
                return _near(place, here)
        return None


def _near(a: _Place, b: _Place) -> bool:
    return separation_m(*a, *b) <= FLEET_SPAN_M
