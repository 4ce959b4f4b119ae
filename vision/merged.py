"""Boxes that a detector draws round several vehicles at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detections import Detections
from vision.track_state import TrackState

__all__ = ["take_together"]

Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

LARGER = 1.2
"""So many times the size of each of the tracks that it holds, a box is round them all."""
NEAR = 0.6
"""Sizes within which a box that is not larger is a track's own."""
SHARE, GAP_S = 0.5, 0.2
"""Tracks in a common box move by this share of what their middle is off by, and count as unseen for no longer."""


def take_together(state: TrackState, settled: Indices, boxes: Detections) -> Flags:
    """Find the boxes larger than each of two tracks or more whose places they hold, and that have no box of their own.

    They continue none of these, which stay in sight and follow the box together: which of them it would be cannot be
    told, and the wrong one would give its name away when they part.

    Args:
        state: The tracks, moved on to this picture; those held together are moved.
        settled: Rows of those that count.
        boxes: Of this picture.

    Returns:
        (m,) which boxes.
    """
    size, together = np.sqrt(boxes.w * boxes.h), np.zeros(len(boxes), dtype=bool)
    large = np.flatnonzero(size > LARGER * np.min(state.length[settled], initial=np.inf))
    if not len(large):
        return together
    place, length = state.x[settled, :2].copy(), state.length[settled]
    away = place[:, None] - boxes.centre
    own = (size < LARGER * length[:, None]) & (np.hypot(away[..., 0], away[..., 1]) < NEAR * length[:, None])
    alone = ~own.any(axis=1)
    for j in large:
        c, s = np.cos(boxes.angle[j]), np.sin(boxes.angle[j])
        along, across = np.abs(away[:, j] @ (c, s)), np.abs(away[:, j] @ (-s, c))
        held = np.flatnonzero(alone & (along < 0.5 * boxes.w[j]) & (across < 0.5 * boxes.h[j]))
        if len(held) > 1 and size[j] > LARGER * length[held].max():
            together[j] = True
            state.x[settled[held], :2] -= SHARE * away[held, j].mean(axis=0)
            state.gap_s[settled[held]] = np.minimum(state.gap_s[settled[held]], GAP_S)
    return together
