"""What each of several speakers of one system id says of place and attitude: do they tell of one vehicle?"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.gate import GateParams
from mavlink.geodesy import wrap_pi
from mavlink.positions import Fix
from mavlink.reception import Speaker
from mavlink.samples import Attitude

__all__ = ["AttitudeTracks", "Dissent", "PlaceTracks"]

_MOST = 8
_FRESH_US = 1_500_000
_PLACE_M, _NOISE_FACTOR, _NOISE_MEMORY = 3.0, 4.0, 0.2
_ATTITUDE, _ATTITUDE_RATE = math.radians(10.0), math.radians(60.0)
_ATTITUDE_US = 300_000


class Dissent(NamedTuple):
    """Another speaker who says something that this one's words rule out."""

    other: Speaker
    gap: float
    """Metres, or radians."""


class _Place:
    __slots__ = ("boot_us", "fix", "noise_m", "t_us")

    def __init__(self, boot_us: int, t_us: int, fix: Fix, noise_m: float) -> None:
        self.boot_us, self.t_us, self.fix, self.noise_m = boot_us, t_us, fix, noise_m


class PlaceTracks:
    """Places by speaker; two radios of one vehicle agree to what it can do between their reports and to its noise."""

    def __init__(self, params: GateParams) -> None:
        self._params = params
        self._tracks: dict[Speaker, _Place] = {}

    def take(self, speaker: Speaker, boot_us: int, t_us: int, fix: Fix) -> Dissent | None:
        """Keeps a place and compares it with those that others reported within the last seconds."""
        tracks = self._tracks
        own = tracks.pop(speaker, None)
        noise_m = own.noise_m if own else 0.0
        if own is not None and abs(t_us - own.t_us) < _FRESH_US:
            step_m, _ = self._gap(own, boot_us, fix)
            noise_m += _NOISE_MEMORY * (step_m - noise_m)
        dissent = None
        for other, track in tracks.items():
            if abs(t_us - track.t_us) < _FRESH_US:
                gap_m, may_m = self._gap(track, boot_us, fix)
                if gap_m > _PLACE_M + may_m + _NOISE_FACTOR * min(noise_m, track.noise_m):
                    dissent = Dissent(other, gap_m)
        if len(tracks) >= _MOST:
            del tracks[next(iter(tracks))]
        tracks[speaker] = _Place(boot_us, t_us, fix, noise_m)
        return dissent

    def clear(self) -> None:
        """Forgets every place."""
        self._tracks.clear()

    def _gap(self, track: _Place, boot_us: int, fix: Fix) -> tuple[float, float]:
        """Distance from where a track would be by now, and how far a vehicle may have left its straight line."""
        dt = (boot_us - track.boot_us) * 1e-6
        a = track.fix
        known = math.isfinite(a.v_east + a.v_north)
        east, north = (a.east + a.v_east * dt, a.north + a.v_north * dt) if known else (a.east, a.north)
        # d = ½ a t²
        may_m = 0.5 * self._params.max_acceleration * dt * dt
        if not known:
            may_m += self._params.max_speed * abs(dt)
        return math.hypot(fix.east - east, fix.north - north), may_m


class AttitudeTracks:
    """Attitudes by speaker."""

    def __init__(self) -> None:
        self._tracks: dict[Speaker, tuple[int, int, Attitude]] = {}

    def take(self, speaker: Speaker, boot_us: int, sample: Attitude) -> Dissent | None:
        """Keeps an attitude and compares it with those of others a moment ago."""
        tracks = self._tracks
        tracks.pop(speaker, None)
        dissent = None
        for other, (other_us, t_us, row) in tracks.items():
            if abs(sample.t_us - t_us) < _ATTITUDE_US and abs(boot_us - other_us) < _ATTITUDE_US:
                dt = abs(boot_us - other_us) * 1e-6
                gap = max(
                    abs(wrap_pi(sample.roll - row.roll)),
                    abs(wrap_pi(sample.pitch - row.pitch)),
                    abs(wrap_pi(sample.yaw - row.yaw)),
                )
                if gap > _ATTITUDE + _ATTITUDE_RATE * dt:
                    dissent = Dissent(other, gap)
        if len(tracks) >= _MOST:
            del tracks[next(iter(tracks))]
        tracks[speaker] = (boot_us, sample.t_us, sample)
        return dissent
