"""Crops that look alike, brought to face one way, without a label.

Every crop is clustered together with its copy turned by 180°. Of features f of a crop and f' of its copy only
d = f − f' separates the two ends: what both share, the colour or the ground, falls out, and the copy has −d. So
k-means runs on all ±d with its centroids in pairs ±c: a crop belongs to the pair that is nearest and, by the sign, it
or its copy faces as the cluster does. Which way that is, right or left, clustering cannot find out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
DIMENSIONS = 24
"""Principal components that are kept of the features; a choice."""
ROUNDS = 100
"""Most rounds of k-means; bounds its time where it does not converge."""
STARTS = 8
"""Random starts of k-means, the best is kept: a start may end in a poor local minimum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Clusters:
    """Clusters of n crops."""

    number: NDArray[np.int64]
    """(n,) 0..k-1, the largest cluster first."""
    turned: NDArray[np.bool_]
    """(n,) whether it is the copy turned by 180° that faces as the cluster does."""
    sure: FloatArray
    """(n,) cosine between the crop and its cluster's centroid, 0..1; near 0 it could as well face the other way."""


def ends_apart(features: NDArray[np.floating], turned: NDArray[np.floating]) -> FloatArray:
    """The difference between a crop and its turned copy, in few dimensions.

    Args:
        features: (n, m) of the crops.
        turned: (n, m) of their copies turned by 180°.

    Returns:
        (n, DIMENSIONS or fewer) principal components of the differences, each row of length 1 or 0.
    """
    d = _unit(np.asarray(features, np.float64) - np.asarray(turned, np.float64))
    # the set of all ±d has mean 0: its principal axes are the right singular vectors of d
    _, _, axes = np.linalg.svd(d, full_matrices=False)
    return _unit(d @ axes[:DIMENSIONS].T)


def paired_kmeans(d: FloatArray, k: int, rng: np.random.Generator) -> Clusters:
    """k-means of all ±d with centroids in pairs ±c, the best of several starts.

    Args:
        d: (n, m).
        k: pairs, at most n.
    """
    k = min(k, len(d))
    centres = min((_converged(d, _start(d, k, rng)) for _ in range(STARTS)), key=lambda c: _spread(d, c))
    along = d @ centres.T
    nearest = np.argmin(_distance(along, centres), axis=1)
    order = np.argsort(-np.bincount(nearest, minlength=k), kind="stable")
    dot = along[np.arange(len(d)), nearest]
    size = np.linalg.norm(d, axis=1) * np.linalg.norm(centres, axis=1)[nearest]
    return Clusters(
        number=np.argsort(order)[nearest].astype(np.int64),
        turned=dot < 0.0,
        sure=np.abs(dot) / np.maximum(size, 1e-12),
    )


def _converged(d: FloatArray, centres: FloatArray) -> FloatArray:
    for _ in range(ROUNDS):
        along = d @ centres.T
        nearest = np.argmin(_distance(along, centres), axis=1)
        # c = mean of s d over its members, s = sign(d·c)
        facing = d * np.where(along[np.arange(len(d)), nearest] < 0.0, -1.0, 1.0)[:, None]
        member = nearest[:, None] == np.arange(len(centres))
        count = member.sum(axis=0)[:, None]
        moved = np.where(count > 0, member.T.astype(np.float64) @ facing / np.maximum(count, 1), centres)
        if np.allclose(moved, centres, atol=1e-9):
            break
        centres = moved
    return centres


def _distance(along: FloatArray, centres: FloatArray) -> FloatArray:
    """(n, k) min |d ∓ c|² less |d|², which is |c|² − 2 |d·c|."""
    return np.asarray((centres**2).sum(axis=1) - 2.0 * np.abs(along))


def _spread(d: FloatArray, centres: FloatArray) -> float:
    return float(_distance(d @ centres.T, centres).min(axis=1).sum())


def _start(d: FloatArray, k: int, rng: np.random.Generator) -> FloatArray:
    """k-means++: each further centroid is a crop that is far from those before (Arthur, Vassilvitskii 2007)."""
    chosen = [int(rng.integers(len(d)))]
    while len(chosen) < k:
        far = (d**2).sum(axis=1) + _distance(d @ d[chosen].T, d[chosen]).min(axis=1)
        far = np.maximum(far, 0.0) + 1e-12
        chosen.append(int(rng.choice(len(d), p=far / far.sum())))
    return d[chosen]


def _unit(rows: FloatArray) -> FloatArray:
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(size > 1e-12, size, 1.0))
