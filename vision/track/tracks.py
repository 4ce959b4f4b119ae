"""Parameters of a tracker, and its output for each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]

WEAK_SCORE = 0.1
"""Boxes from here on, and below those that count, still show where a vehicle is that is known to be about there."""

Stitch = Callable[[Ints, Floats], Indices]
"""(track ids (a,), centres (b, 2) px) → pairs (p, 2) of rows: lost tracks that left-over detections continue."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerParams:
    """Parameters of a tracker. A box's size is √(w h)."""

    high_score: float = 0.5
    """Boxes matched in the first round. Raise → boxes of low score give way to others; lower → fewer gaps."""
    low_score: float = WEAK_SCORE
    """Boxes below are ignored. Raise → fewer wrong continuations; lower → tracks live through blur and shade."""
    new_score: float = 0.3
    """Boxes that may begin a track; weaker ones only continue tracks that are confirmed. Raise → fewer false tracks;
    lower → weak vehicles are tracked at all."""
    gate: float = 16.0
    """Largest squared Mahalanobis distance (2 degrees of freedom; 16 keeps 99.97 %). Raise → jerks are followed;
    lower → fewer swaps between neighbours."""
    near: float = 0.6
    """Sizes within which a box matches whatever the filter predicts. Raise → sudden camera motion is survived."""
    overlap_weight: float = 16.0
    """Cost of not overlapping at all, in units of the squared distance. Raise → shape and angle count more."""
    limit: float = 40.0
    """Cost of leaving a track and a box apart. Raise → doubtful matches are made; lower → tracks break instead."""
    weak_limit: float = 24.0
    """Equivalent of ``limit`` for boxes that may not begin a track. Raise → tracks live on through worse boxes; lower →
    they are less often taken over by what is none."""
    centre_noise: float = 0.04
    """Standard deviation of a detected centre, sizes (and at least 1 px). Raise → smoother, slower boxes."""
    wander: float = 2.5
    """Change of a velocity in one second, sizes/s. Raise → hard turns are followed; lower → coasts straighter."""
    first_speed: float = 3.0
    """Standard deviation of the velocity of something just seen, sizes/s. Raise → faster vehicles are caught."""
    top_speed: float = 12.0
    """Greatest speed of a vehicle, sizes/s. Raise → lost tracks reach further; lower → fewer foreign boxes are
    taken."""
    tentative_s: float = 0.35
    """A track that is not confirmed ends after this long unseen."""
    short_s: float = 1.0
    """Shortest time for which a confirmed track coasts; else as long as it was seen."""
    coast_s: float = 2.5
    """Longest time for which a confirmed track coasts. Raise → longer occlusions are bridged; lower → fewer ghosts."""
    known_s: float = 0.45
    """A track of a known vehicle that was out of sight for longer is continued by that vehicle's report only."""
    frame_size: tuple[int, int] | None = None
    """Width and height, px, when known: a track that has coasted out of the frame ends after ``tentative_s``, so that
    the next vehicle to come in there does not inherit its id."""
    double: float = 0.5
    """Overlap with a matched box above which another box begins no track. Raise → dense parking; lower → no doubles."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks:
    """The k tracks at one frame, in order of their ids, those that coast unseen included; none for which too little
    speaks yet (``vision.track.evidence``). Arrays (k,) unless noted, read-only."""

    track_id: Ints
    """Track id, from 1."""
    detection: Indices
    """Index into this frame's detections, -1 while coasting."""
    cx: Floats
    """Filtered centre, px."""
    cy: Floats
    w: Floats
    """Smoothed sides, px."""
    h: Floats
    angle: Floats
    """Image +x to width axis, clockwise on screen, rad in [-π, π); points to the front where that is known."""
    heading: Floats
    """Clockwise from image up, rad in [0, 2π), NaN unknown; a single detection turned around does not flip it."""
    score: Floats
    """Score of the last detection."""
    hits: Ints
    """Frames in which it was seen."""
    age_s: Floats
    """Time since first seen, s."""
    gap_s: Floats
    """Time since last seen, s; 0 when seen now; in a box around several at most 0.2."""
    missed_s: Floats
    """Part of the time since it was last seen in which it was looked for."""
    vx: Floats
    """px/s, camera motion removed as far as the warps contain it."""
    vy: Floats
    expected: Floats
    """(k, 2) px: where the track was expected in this frame by its own motion and the given warp, before any motion
    common to all tracks was taken out; NaN for one that begins here or is found again elsewhere."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            array = getattr(self, name)
            if array.flags.writeable:
                array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.track_id)

    @property
    def boxes(self) -> Floats:
        """Rows cx cy w h angle, (k, 5)."""
        return np.stack([self.cx, self.cy, self.w, self.h, self.angle], axis=-1)
