"""Boxes that a detector draws around several vehicles at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.track.track_state import TrackState
from vision.track.tracks import TrackerParams

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]

LARGER = 1.2
"""A box this many times as large as each of the tracks inside it is a box around them all."""
PULL = 0.5
"""Tracks inside a common box move by this share of the distance from their mean to the box's centre."""
GAP_S = 0.2
"""They count as unseen for no longer than this, seconds."""


@dataclass(frozen=True, slots=True)
class MergedBoxes:
    """Boxes around several tracks, and where these tracks are while they are inside."""

    box: Flags
    """(m,) which boxes are around several tracks; they continue none of them."""
    rows: Ints
    """(h,) rows of the tracks inside."""
    place: Floats
    """(h, 2) their places after being pulled towards their box, px."""
    gap_s: Floats
    """(h,) for how long they count as unseen, seconds."""


def find_merged(state: TrackState, params: TrackerParams, boxes: Detections, apart: Floats) -> MergedBoxes | None:
    """Find the boxes that are larger than each of two or more tracks inside them which have no box of their own.

    Such a box continues none of its tracks, which stay in sight and follow it together: which of them it would be
    cannot be known, and the wrong one would give its name away when they part.

    Args:
        params: Which tracks count as followed, and within which distance a box is a track's own.
        apart: (k, m) squared distances of tracks and boxes, px².

    Returns:
        The boxes and their tracks, None where there are none.
    """
    settled = np.flatnonzero(state.confirmed & (state.gap_s <= params.short_s))
    size = np.sqrt(boxes.w * boxes.h)
    large = np.flatnonzero(size > LARGER * np.min(state.length[settled], initial=np.inf))
    place, length = state.x[settled, :2].copy(), state.length[settled]
    apart, half = apart[settled], 0.25 * (boxes.w[large] ** 2 + boxes.h[large] ** 2)
    large = large[np.count_nonzero(apart[:, large] < half, axis=0) > 1]
    if not len(large):
        return None
    moved, gap_s = state.x[:, :2].copy(), state.gap_s.copy()
    merged, inside_any = np.zeros(len(boxes), dtype=bool), np.zeros(len(state), dtype=bool)
    alone = ~np.any((size < LARGER * length[:, None]) & (apart < (params.near * length[:, None]) ** 2), axis=1)
    for j in large:
        c, s = np.cos(boxes.angle[j]), np.sin(boxes.angle[j])
        away = place - boxes.centre[j]
        inside = (np.abs(away @ (c, s)) < 0.5 * boxes.w[j]) & (np.abs(away @ (-s, c)) < 0.5 * boxes.h[j])
        held = np.flatnonzero(alone & inside)
        if len(held) > 1 and size[j] > LARGER * length[held].max():
            merged[j] = inside_any[settled[held]] = True
            moved[settled[held]] -= PULL * away[held].mean(axis=0)
            gap_s[settled[held]] = np.minimum(gap_s[settled[held]], GAP_S)
    rows = np.flatnonzero(inside_any)
    return MergedBoxes(merged, rows, moved[rows], gap_s[rows]) if len(rows) else None
