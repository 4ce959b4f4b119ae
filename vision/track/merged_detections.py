"""Boxes that a detector draws round several vehicles at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.track.track_state import TrackState
from vision.track.tracks import TrackerParams

__all__ = ["take_together"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LARGER = 1.2
"""So many times the size of each of the tracks that it holds, a box is round them all."""
SHARE, GAP_S = 0.5, 0.2
"""Tracks in a common box move by this share of what their middle is off by, and count as unseen for no longer."""


def take_together(state: TrackState, params: TrackerParams, boxes: Detections, apart: Floats) -> Flags:
    """Find the boxes larger than each of two tracks or more whose places they hold, and that have no box of their own.

    They continue none of these, which stay in sight and follow the box together: which of them it would be cannot be
    told, and the wrong one would give its name away when they part.

    Args:
        state: The tracks, moved on to this frame; those held together are moved.
        params: Which tracks count as followed, and within which distance a box is one's own.
        boxes: Of this frame.
        apart: (k, m) squared distances of tracks and boxes, px².

    Returns:
        (m,) which boxes.
    """
    settled = np.flatnonzero((state.hits >= params.confirm_hits) & (state.gap_s <= params.short_s))
    size, together = np.sqrt(boxes.w * boxes.h), np.zeros(len(boxes), dtype=bool)
    large = np.flatnonzero(size > LARGER * np.min(state.length[settled], initial=np.inf))
    place, length = state.x[settled, :2].copy(), state.length[settled]
    apart, half = apart[settled], 0.25 * (boxes.w[large] ** 2 + boxes.h[large] ** 2)
    large = large[np.count_nonzero(apart[:, large] < half, axis=0) > 1]
    if not len(large):
        return together
    alone = ~np.any((size < LARGER * length[:, None]) & (apart < (params.near * length[:, None]) ** 2), axis=1)
    for j in large:
        c, s = np.cos(boxes.angle[j]), np.sin(boxes.angle[j])
        away = place - boxes.centre[j]
        inside = (np.abs(away @ (c, s)) < 0.5 * boxes.w[j]) & (np.abs(away @ (-s, c)) < 0.5 * boxes.h[j])
        held = np.flatnonzero(alone & inside)
        if len(held) > 1 and size[j] > LARGER * length[held].max():
            together[j] = True
            state.x[settled[held], :2] -= SHARE * away[held].mean(axis=0)
            state.gap_s[settled[held]] = np.minimum(state.gap_s[settled[held]], GAP_S)
    return together
