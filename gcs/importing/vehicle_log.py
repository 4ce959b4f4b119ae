"""Log of one vehicle, whatever its format: arrays over time, NaN where it does not say.

Times are whole µs on the log's own clock: since the video's first frame ("video"), Unix time ("utc"), or since an
unknown moment ("own"); or they are the video's frames, from 0 ("frame"). Angles are radians: roll, pitch, yaw, yaw
clockwise from north.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
LogClock = Literal["video", "frame", "utc", "own"]
Where = Callable[[int], str]
"""Place in the file of a record, by its number among those that are read, in words."""

M_PER_HDOP = 1.5
"""1σ of a single-frequency receiver at a dilution of 1, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceTrack:
    """Positions of a vehicle. n samples in order of time."""

    t_us: Ints
    """(n,)"""
    lat_deg: Floats
    lon_deg: Floats
    alt_m: Floats
    """(n,) above sea level."""
    height_m: Floats
    """(n,) above the place of the take-off."""
    v_ned: Floats
    """(n, 3) m/s."""
    heading: Floats
    """(n,) of the nose."""
    std_m: float
    """1σ per axis of a position, level; NaN unknown."""

    def __post_init__(self) -> None:
        n = len(self.t_us)
        for name in ("lat_deg", "lon_deg", "alt_m", "height_m", "heading"):
            if getattr(self, name).shape != (n,):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, ({n},) is needed")
        if self.v_ned.shape != (n, 3):
            raise ValueError(f"v_ned has shape {self.v_ned.shape}, ({n}, 3) is needed")

    @classmethod
    def of(
        cls,
        t_us: Ints,
        lat_deg: Floats,
        lon_deg: Floats,
        *,
        alt_m: Floats | None = None,
        height_m: Floats | None = None,
        v_ned: Floats | None = None,
        heading: Floats | None = None,
        std_m: float = math.nan,
    ) -> PlaceTrack:
        """Positions of which some columns are not known."""
        unknown = np.full(len(t_us), np.nan)
        return cls(
            t_us=t_us,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=unknown if alt_m is None else alt_m,
            height_m=unknown if height_m is None else height_m,
            v_ned=np.full((len(t_us), 3), np.nan) if v_ned is None else v_ned,
            heading=unknown if heading is None else heading,
            std_m=std_m,
        )

    def __len__(self) -> int:
        return len(self.t_us)

    def select(self, rows: NDArray[np.bool_] | Ints) -> PlaceTrack:
        """Return some of the samples."""
        return PlaceTrack(
            t_us=self.t_us[rows],
            lat_deg=self.lat_deg[rows],
            lon_deg=self.lon_deg[rows],
            alt_m=self.alt_m[rows],
            height_m=self.height_m[rows],
            v_ned=self.v_ned[rows],
            heading=self.heading[rows],
            std_m=self.std_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleTrack:
    """Attitudes of a body or of a gimbal. n samples in order of time."""

    t_us: Ints
    """(n,)"""
    angles: Floats
    """(n, 3) roll, pitch, yaw; of a gimbal roll and pitch from the horizon."""
    yaw_from: Literal["north", "nose"] = "north"

    def __len__(self) -> int:
        return len(self.t_us)

    @classmethod
    def empty(cls) -> AngleTrack:
        """No attitude."""
        return cls(t_us=np.empty(0, np.int64), angles=np.empty((0, 3)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTrack:
    """Field of view of a camera to its sides. n samples in order of time."""

    t_us: Ints
    """(n,)"""
    hfov: Floats
    """(n,) horizontal field of view."""
    source: str = ""
    """Sentence on how it is known; of an empty track, what there is that does not tell it."""

    def __len__(self) -> int:
        return len(self.t_us)

    @classmethod
    def empty(cls) -> ViewTrack:
        """Return a track of which nothing is known."""
        return cls(t_us=np.empty(0, np.int64), hfov=np.empty(0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportNotes:
    """Findings in a file: what was found, assumed of it, and left out."""

    found: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Records that could not be used, by reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleLog:
    """One vehicle's log."""

    source: str
    """Name of the file, and what was read in it."""
    clock: LogClock
    places: PlaceTrack
    notes: ImportNotes
    dated: str = ""
    """Sentence on which clock that is, where the format does not tell."""
    zero_us: int = 0
    """Unix µs of time 0 by whatever the file says of it; 0 unknown. Of clock "utc" 0 is Unix time's own."""
    system_id: int = 0
    """System id in the log; 0 unknown."""
    flies: bool | None = None
    """True for an aircraft by its own heartbeats, False for a ground vehicle; None without any."""
    attitudes: AngleTrack = field(default_factory=AngleTrack.empty)
    gimbal: AngleTrack = field(default_factory=AngleTrack.empty)
    view: ViewTrack = field(default_factory=ViewTrack.empty)


def whole_places(lat_deg: Floats, lon_deg: Floats) -> NDArray[np.bool_]:
    """(n,) which coordinates are a place: on Earth, and not the 0/0 that is written before the first fix."""
    with np.errstate(invalid="ignore"):
        on_earth = (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 180.0)
        return np.asarray(on_earth & ((np.abs(lat_deg) > 1e-3) | (np.abs(lon_deg) > 1e-3)))


def thinned(t_us: Ints, step_us: int) -> Ints:
    """Rows of ordered times (n,) that are ``step_us`` apart or more, the first among them."""
    kept: list[int] = []
    next_us = int(t_us[0]) if len(t_us) else 0
    for row, t in enumerate(t_us.tolist()):
        if t >= next_us:
            kept.append(row)
            next_us = t + step_us
    return np.array(kept, np.int64)


def in_order(t_us: Ints) -> Ints:
    """Rows of times (n,) in ascending order, the first of those that are equal."""
    return np.asarray(np.unique(t_us, return_index=True)[1], np.int64)


def at_times(t_us: Ints, from_us: Ints, values: Floats, most_gap_us: int, *, turns: bool = False) -> Floats:
    """Values (k,) of times (k,), in ascending order, at other times (n,), linear in between.

    Args:
        t_us: (n,) wanted.
        from_us: (k,) known.
        values: (k,); NaN are left out.
        most_gap_us: NaN farther than this from anything known.
        turns: angles, radians.
    """
    known = np.isfinite(values)
    from_us, values = from_us[known], values[known]
    if not len(from_us):
        return np.full(len(t_us), np.nan)
    zero = from_us[0]
    found = np.interp(
        (t_us - zero).astype(float), (from_us - zero).astype(float), np.unwrap(values) if turns else values
    )
    after = np.clip(np.searchsorted(from_us, t_us), 0, len(from_us) - 1)
    before = np.maximum(after - 1, 0)
    away = np.minimum(np.abs(from_us[after] - t_us), np.abs(t_us - from_us[before]))
    return np.where(away <= most_gap_us, found, np.nan)
