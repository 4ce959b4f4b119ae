"""Boxes that a detector draws round two bodies at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["merged_boxes"]

FloatArray = NDArray[np.float64]

SPREAD = 0.1
"""Share by which the distance of merging varies from frame to frame."""


def merged_boxes(
    values: FloatArray, seen: NDArray[np.bool_], lengths: float, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """One box for two neighbours that are too near to be separated.

    Args:
        values: (n, 7) cx, cy, w, h, angle, score, heading.
        seen: (n,) the rows that are detected at all.
        lengths: boxes merge below about this distance, in lengths (mean w) of the pair.
        rng: source of the spread.

    Returns:
        values and seen. The row that stays is the longer one of the pair, with its axis and heading, and now holds
        both; the other is unseen.
    """
    values, seen = values.copy(), seen.copy()
    limit = lengths * (1.0 + SPREAD * rng.normal())
    rows = np.flatnonzero(seen)
    away = np.linalg.norm(values[rows, None, :2] - values[None, rows, :2], axis=-1)
    reach = limit * 0.5 * (values[rows, None, 2] + values[None, rows, 2])
    pairs = np.argwhere(np.triu(away < reach, 1))
    for a, b in pairs[np.argsort(away[tuple(pairs.T)], kind="stable")]:
        i, j = sorted((int(rows[a]), int(rows[b])), key=lambda row: -float(values[row, 2]))
        if seen[i] and seen[j]:
            values[i, :4] = _round_both(values[i], values[j])
            seen[j] = False
    return values, seen


def _round_both(first: FloatArray, second: FloatArray) -> FloatArray:
    """Centre and sides of the box along the first one's axis that holds both."""
    along = np.array([np.cos(first[4]), np.sin(first[4])])
    axes = np.stack([along, [-along[1], along[0]]])
    places = np.concatenate([_corners(first), _corners(second)]) @ axes.T
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return np.concatenate([middle @ axes, np.ptp(places, axis=0)])


def _corners(box: FloatArray) -> FloatArray:
    """(4, 2) pixels."""
    c, s = np.cos(box[4]), np.sin(box[4])
    half = 0.5 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * box[2:4]
    return np.asarray(box[:2] + half @ np.array([[c, s], [-s, c]]))
