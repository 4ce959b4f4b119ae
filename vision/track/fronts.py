"""The end of a box that is its vehicle's front: what the detector says of each box, and where the vehicle drives.

Two numbers are kept for each track, both positive for a front along the box's axis and negative for one against it:
votes, one for each box whose front was reported, at most ``MAX_VOTES`` of them; and the way that the vehicle went along
its axis, in lengths of its own and at most ``MAX_LENGTHS``. A detector errs for as long as the view lasts, from the
side above all, while vehicles drive forwards: what they went counts as

    f = votes + VOTES_A_LENGTH · way,     the way only once it is a length

so that two lengths outvote every box. A manoeuvre backwards after a drive ahead changes nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_VOTES = 5.0
"""Most votes that are remembered: a turned front is accepted after about as many detections."""
VOTES_A_LENGTH = 4.0
"""Votes that one length of the way counts as: well before two lengths it has to outweigh all detections."""
MAX_LENGTHS = 3.0
"""Way that is remembered, lengths: a vehicle may back up this far, and its front still be where it was."""
MIN_LENGTHS = 1.0
"""A shorter way may be an error of the camera's motion."""
MIN_SPEED = 0.2
"""Least speed of a vehicle that drives, lengths/s: slower ones may be at rest in a picture that is not quite."""
SURE_STDS = 2.0
"""A speed counts that is larger than its own uncertainty by this factor."""
ALONG = 0.8
"""Cosine of the largest angle between axis and motion: a box whose axis is not the vehicle's tells no front."""


def front_of(votes: Floats, way: Floats) -> Floats:
    """(k,) votes and way, lengths, in one number: positive along the axis, negative against it, 0 unknown."""
    return np.asarray(votes + VOTES_A_LENGTH * way * (np.abs(way) >= MIN_LENGTHS))


def vote_of(heading: Floats, axis: Floats) -> Floats:
    """(k,) +1 for a front along the axis, -1 against it; means nothing where the heading is unknown."""
    # cos(heading − π/2 − axis) = sin(heading − axis)
    return np.copysign(1.0, np.sin(heading - axis))


def votes_after(votes: Floats, vote: Floats) -> Floats:
    """Votes (k,) for the front after one more each."""
    after = votes + vote
    if np.count_nonzero(after) < len(after):
        # a draw goes to the previous front
        after = np.where(after == 0, -0.5 * vote, after)
    return np.minimum(np.maximum(after, -MAX_VOTES), MAX_VOTES)


def way_after(way: Floats, vx: Floats, vy: Floats, variance: Floats, axis: Floats, length: Floats, dt: float) -> Floats:
    """The way along the axis after ``dt`` seconds more.

    Args:
        way: (k,) lengths.
        vx: (k,) px/s, velocity over the ground as it is seen.
        vy: (k,) px/s.
        variance: (k,) px²/s², of the velocity, per axis.
        axis: (k,) rad, clockwise from image right.
        length: (k,) px, side of the box along its axis.
        dt: s.
    """
    along, squared = vx * np.cos(axis) + vy * np.sin(axis), vx * vx + vy * vy
    slow = MIN_SPEED * length
    driving = squared > np.maximum(slow * slow, SURE_STDS**2 * variance)
    driving &= along * along > ALONG**2 * squared
    after = way + driving * along * dt / np.maximum(length, 1.0)
    return np.minimum(np.maximum(after, -MAX_LENGTHS), MAX_LENGTHS)
