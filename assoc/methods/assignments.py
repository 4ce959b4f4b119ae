"""All injective assignments of the fewer to the more, in blocks that stay in a processor's cache.

Symbols: n_rl vehicles, n_im tracks, s = min(n_rl, n_im) pairs of an assignment. An assignment is a set of s vehicles,
whose members in ascending order are its places, and an order: the track that each place meets. Every order goes with
every set, so what depends on the orders alone is made once for all sets, and kept for the next call.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, islice
from math import comb, perm

import numpy as np
from numpy.typing import NDArray

__all__ = ["Orders", "block_shape", "orders", "vehicle_sets"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BLOCK = 20_160
"""Hypotheses times frames of one block: 8 factorial / 2, a few hundred kB."""
_SETS = 16
"""Least sets of vehicles in a block where there are many: fewer cost more calls than they save memory."""
_MEETINGS = 2**18
"""Largest size of ``meets``, numbers: 2 MB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orders:
    """Consecutive orders."""

    track: IntArray
    """(s, h) track of each place."""
    meets: FloatArray
    """(s · n_im, h) A: 1 in row k · n_im + j where place k meets track j, else 0."""


def block_shape(n_rl: int, n_im: int, frames: int) -> tuple[int, int]:
    """Vehicle sets and orders of one block: few enough for the cache, enough to hide the cost of a call."""
    s = min(n_rl, n_im)
    count = perm(n_im, s)
    sets = min(comb(n_rl, s), max(_SETS, _BLOCK // (count * frames)))
    return sets, max(1, min(count, _BLOCK // (sets * frames), _MEETINGS // (s * n_im)))


def vehicle_sets(n_rl: int, s: int, size: int) -> Iterator[IntArray]:
    """All sets of s vehicles in lexicographic order, as arrays (≤ size, s)."""
    sets = combinations(range(n_rl), s)
    while chunk := list(islice(sets, size)):
        yield np.array(chunk, np.int64)


@lru_cache(maxsize=8)
def orders(start: int, stop: int, n_im: int, s: int) -> Orders:
    """The orders start … stop − 1 of all perm(n_im, s) in lexicographic order.

    Args:
        start: First.
        stop: One beyond the last; beyond the end it is the end.
        n_im: Tracks.
        s: Places.

    Returns:
        Shared, read-only arrays.

    Example:
        >>> orders(0, 6, 3, 2).track.T.tolist()
        [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
    """
    rank = np.arange(start, min(stop, perm(n_im, s)))
    # place k takes the d_k-th of the n_im − k tracks that are left:  rank = Σ_k d_k · perm(n_im − k − 1, s − k − 1)
    track = np.array([rank // perm(n_im - k - 1, s - k - 1) % (n_im - k) for k in range(s)])
    for k in reversed(range(s - 1)):
        track[k + 1 :] += track[k + 1 :] >= track[k]
    meets = np.zeros((s * n_im, len(rank)))
    # A[k · n_im + j_k, h] = 1
    np.put_along_axis(meets, n_im * np.arange(s)[:, None] + track, 1.0, axis=0)
    track.setflags(write=False)
    meets.setflags(write=False)
    return Orders(track=track, meets=meets)
