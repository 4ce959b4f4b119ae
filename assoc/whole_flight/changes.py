"""Changes of a segment to another object, by how well each vehicle's reports fit what was before and what follows.

A tracker may go on with a neighbour where two are side by side, or one of them was missed, and no name tells it if
neither was named then. So each segment is weighed as any two vehicles, before and after each of its blocks:

    gain(k) = max_i V_i(blocks < k) + max_j V_j(blocks ≥ k) − max_i [V_i(blocks < k) + V_i(blocks ≥ k)]

with V_i the score of a part as vehicle i (``assoc.whole_flight.chains``), 0 as none of ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import ground_tracks
from assoc.whole_flight.chains import CommonPose, scores_as_parts
from assoc.whole_flight.evidence import Segments
from assoc.whole_flight.residuals import Errors, Residuals

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_EXCHANGE_NATS, _STRANGER_NATS, _ALONE_NATS = 2.0, 6.0, 12.0
"""Least gain of a change from one vehicle to another, of one from or to none of ours, and of any with no other object
nearby, no gap and no leap.
"""
_MIN_BLOCKS = 3
"""Fewest blocks before and after a change from or to none of ours: where a track strays for less it is aside."""
_NEARBY_M, _GAP_S, _LEAP_M = 4.0, 0.45, 1.5
"""Distance to another object, metres, time out of sight, seconds, and leap, metres, with which tracks change their
object."""
_AROUND_S = 1.5
"""Farthest from the beginning of a block that a change is looked for, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A segment that goes on as another object."""

    segment: int
    at_s: float
    """Seconds from the first frame."""
    after: int
    """Vehicle that it is from then on, −1 none of ours."""
    before: int
    """Vehicle that it is until then, −1 none of ours."""


def changes(
    segments: Segments, residuals: Residuals, pose: CommonPose, errors: Errors, owner: IntArray, block_s: float
) -> list[Change]:
    """Find the most telling change of each segment that has one, the one that gains most first.

    Args:
        segments: The pieces of tracks.
        residuals: Of all pairs, with outliers.
        pose: The camera's, and what is common.
        errors: Of the vehicles' positions.
        owner: (S,) vehicle of each segment, −1 none.
        block_s: Length of a block, seconds.
    """
    r = residuals.at(pose.theta, pose.common)
    nearest, gap, leap = _surroundings(segments, pose.theta)
    t = segments.history.t[: segments.history.n]
    n, found = segments.log.n_vehicles, dict[int, tuple[float, Change]]()
    for segment in range(len(owner)):
        parts = scores_as_parts(segments, residuals, r, errors, owner, segment)
        if parts is None:
            continue
        rows, before, after = parts
        i, j = np.argmax(before, axis=1), np.argmax(after, axis=1)
        gain = np.max(before, axis=1) + np.max(after, axis=1) - np.max(before + after, axis=1)
        stranger = np.maximum(i, j) == n
        lasts = np.minimum(np.arange(len(rows)), len(rows) - np.arange(len(rows))) >= np.where(stranger, _MIN_BLOCKS, 1)
        gain -= np.where(stranger, _STRANGER_NATS, _EXCHANGE_NATS)
        for k in np.flatnonzero((gain > 0.0) & lasts).tolist():
            begins_s = (residuals.blocks.first + rows[k]) * block_s
            at_s, risky = _moment(t, nearest[:, segment], gap[:, segment], leap[:, segment], begins_s)
            worth = gain[k] - (0.0 if risky else _ALONE_NATS)
            if worth > found.get(segment, (0.0,))[0]:
                who = [int(each) if each < n else -1 for each in (i[k], j[k])]
                found[segment] = worth, Change(segment=segment, at_s=at_s, before=who[0], after=who[1])
    return [change for _, change in sorted(found.values(), key=lambda each: -each[0])]


def exchanges(found: Sequence[Change]) -> list[list[Change]]:
    """Group changes that share a vehicle, in their order: they are right together, or wrong."""
    groups = list[tuple[set[int], list[Change]]]()
    for change in found:
        vehicles, group = {change.before, change.after} - {-1}, [change]
        for each in [each for each in groups if each[0] & vehicles]:
            groups.remove(each)
            vehicles, group = vehicles | each[0], each[1] + group
        groups.append((vehicles, group))
    return [group for _, group in groups]


def _surroundings(segments: Segments, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance to the nearest other object, time out of sight and leap since then, of each segment in each frame.

    Returns:
        (F, S) metres, (F, S) seconds and (F, S) metres of each segment in each frame: 0 where it was not seen.
    """
    history = segments.history
    t = history.t[: history.n]
    places = ground_tracks(history, 0, theta, np.arange(segments.seen.shape[1])).p
    nearest, gap, leap = (
        np.full(segments.seen.shape, np.inf),
        np.zeros(segments.seen.shape),
        np.zeros(segments.seen.shape),
    )
    held = np.full(places.shape[1:], np.nan)
    held_s = np.full(places.shape[1], -np.inf)
    velocity = np.zeros_like(held)
    for row, place in enumerate(places):
        seen = np.flatnonzero(np.isfinite(place[:, 0]))
        again = seen[np.isfinite(held_s[seen])]
        gap[row, again] = t[row] - held_s[again]
        moved = place[again] - held[again]
        leap[row, again] = np.linalg.norm(moved - velocity[again] * gap[row, again, None], axis=1)
        velocity[again] = moved / gap[row, again, None]
        held[seen], held_s[seen] = place[seen], t[row]
        # where another object was within the last moment counts, too
        lately = np.flatnonzero(t[row] - held_s < _AROUND_S)
        away = np.linalg.norm(place[seen][:, None] - held[lately], axis=2)
        away[seen[:, None] == lately] = np.inf
        nearest[row, seen] = np.min(away, axis=1, initial=np.inf)
    return nearest, gap, leap


def _moment(
    t: FloatArray, nearest: FloatArray, gap: FloatArray, leap: FloatArray, about_s: float
) -> tuple[float, bool]:
    """Time near another one at which a track changed its object, seconds, and whether it is where tracks do."""
    around = np.flatnonzero(np.abs(t - about_s) <= _AROUND_S)
    if not len(around):
        return about_s, True
    for signs, least in ((leap, _LEAP_M), (gap, _GAP_S)):
        first = around[np.argmax(signs[around])]
        if signs[first] > least:
            return float(t[first]) - 1e-3, True
    closest = around[np.argmin(nearest[around])]
    if nearest[closest] < _NEARBY_M:
        return float(t[closest]), True
    return about_s, False
