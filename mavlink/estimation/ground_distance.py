"""Height of the UAV above the ground, by its rangefinder and by its own map of the terrain."""

from __future__ import annotations

import math

from mavlink.protocol.messages import DistanceSensor, TerrainReport

_DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270."""
_INVALID_QUALITY = 1
"""``signal_quality`` of a range that is none; 0 is unknown."""
_LASTS_US = 1_500_000
"""Ranges are sent several times a second, reports on the terrain once: older ones are of other ground."""


class GroundDistance:
    """Newest distances to the ground by rangefinder and terrain map, dated by arrival: neither is used more closely
    than the ground is even."""

    def __init__(self) -> None:
        self._range: DistanceSensor | None = None
        self._terrain: TerrainReport | None = None

    def add(self, sample: DistanceSensor | TerrainReport) -> None:
        """Keep a sample that measures something."""
        if isinstance(sample, TerrainReport):
            # without a spacing the autopilot has no map of this place
            if sample.spacing_m > 0 and math.isfinite(sample.current_height_m):
                self._terrain = sample
        elif (
            sample.orientation == _DOWN
            and sample.quality != _INVALID_QUALITY
            and max(sample.min_m, 0.0) < sample.distance_m < sample.max_m
        ):
            self._range = sample

    def range_m(self, t_us: int) -> float:
        """Return the distance along the body's own vertical axis at a Unix time, m; NaN unknown."""
        sample = self._range
        return sample.distance_m if sample and abs(t_us - sample.t_us) <= _LASTS_US else math.nan

    def terrain_height_m(self, t_us: int) -> float:
        """Height above the terrain at a Unix time as the autopilot has it, NaN unknown."""
        sample = self._terrain
        return sample.current_height_m if sample and abs(t_us - sample.t_us) <= _LASTS_US else math.nan
