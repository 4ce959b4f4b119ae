"""Boxes that a detector draws around several vehicles at once, and those of which only one is there for two tracks."""

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
"""Longest time for which they count as unseen, seconds."""
REACH = 1.0
"""Tracks may share a box that is no further away, sizes: what touches is detected as one."""
SIDE_STD = 0.1
"""1σ of the logarithm of a box's sides relative to those of its track."""
COMMON_SIDES = 0.8
"""Range of that logarithm for a box around two: from the side of one to somewhat more than that of both, ln 2.2."""
CLEAR = 0.8
"""A box is a track's own if that is at least as probable, both tracks and both at once being equally usual."""


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
    settled = np.flatnonzero(state.confirmed & (state.missed_s <= params.short_s))
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


def find_shared(
    state: TrackState, params: TrackerParams, boxes: Detections, free: Flags, apart: Floats, noise: Floats
) -> MergedBoxes | None:
    """Find the boxes that two or more tracks share, none of them having another in reach, and that fit none clearly.

    With a and b where the two likeliest tracks are expected, σ² the variance of that and of the box's centre z, and l
    the logarithms of its sides relative to those of a track, the box is of the first with the density

        N(z; a, σ²) N(l; 0, s²),     of the other with the same for b, and of both with     N(d; σ²) / (|a − b| L²)

    where d is its distance from the line between them (|a − b| at least √2π σ): it may lie anywhere along it, and have
    any size between that of one and of both, depending on how much of either is seen.

    Args:
        free: (m,) boxes that may be of any track.
        apart: (k, m) squared distances of tracks and boxes, px².
        noise: (k,) px, standard deviation of the centre of a track's box.

    Returns:
        The boxes, which continue no track, and their tracks, which move on by themselves and stay in sight; None where
        there are none.
    """
    recent = state.confirmed & (state.missed_s <= params.short_s) & (state.shared_s < params.coast_s)
    reach = REACH * state.length
    near = (apart < (reach * reach)[:, None]) & recent[:, None] & free
    bound = near & (np.count_nonzero(near, axis=1) == 1)[:, None]
    crowded = np.flatnonzero(np.count_nonzero(bound, axis=0) > 1)
    if not len(crowded):
        return None
    shared, held, place = np.zeros(len(boxes), dtype=bool), np.zeros(len(state), dtype=bool), state.x[:, :2].copy()
    for j in crowded:
        rows = np.flatnonzero(bound[:, j])
        alone, both = _shares(state.select(rows), noise[rows], boxes, int(j))
        if alone < CLEAR:
            shared[j] = held[rows] = True
            place[rows] += PULL * both * (boxes.centre[j] - place[rows].mean(axis=0))
    rows = np.flatnonzero(held)
    return MergedBoxes(shared, rows, place[rows], np.minimum(state.gap_s[rows], GAP_S)) if len(rows) else None


def _shares(tracks: TrackState, noise: Floats, boxes: Detections, j: int) -> tuple[float, float]:
    """Likelihood that box j is of the likeliest of the tracks (h,) alone, and of two at once."""
    place, P = tracks.x[:, :2], tracks.P
    variance = 0.5 * (P[:, 0, 0] + P[:, 1, 1]) + noise * noise
    # ln of the long and the short side relative to the track's
    larger = np.log(np.sort(boxes.table[2:4, j]) / np.sort(tracks.boxes[:, 2:4], axis=1))
    shape = np.exp(-0.5 * (larger * larger).sum(axis=1) / SIDE_STD**2) / (2.0 * np.pi * SIDE_STD**2)
    squared = ((boxes.centre[j] - place) ** 2).sum(axis=1)
    alone = np.exp(-0.5 * squared / variance) / (2.0 * np.pi * variance) * shape
    first, second = np.argsort(-alone, kind="stable")[:2]
    between, offset, v = place[second] - place[first], boxes.centre[j] - place[first], variance[[first, second]].mean()
    length2 = between @ between
    away = offset - np.clip(offset @ between / max(length2, 1e-9), 0.0, 1.0) * between
    spread = np.sqrt(2.0 * np.pi * v)
    both = np.exp(-0.5 * (away @ away) / v) / spread / max(np.sqrt(length2), spread) / COMMON_SIDES**2
    every = max(alone.sum() + both, 1e-300)
    return float(alone[first] / every), float(both / every)
