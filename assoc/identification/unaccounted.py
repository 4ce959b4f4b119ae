"""Boxes without a name that may be vehicles of ours of which nobody knows where they are.

A vehicle whose positions stopped, are refused, stand still or lie is somewhere: it may be any box that nobody else has,
within what it can have driven. "None of ours" is said as surely as all vehicles are accounted for: seen as another box,
out of view by a fresh report, or known not to be this box because both were seen side by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NAMED = 0.5
"""Probability from which a vehicle is accounted for by a box."""
_REPORTING_S = 3.0
"""Age of a report up to which it tells where its vehicle is, seconds."""
_OUT_OF_VIEW = 0.05
"""Chance below which a vehicle that reports is out of view."""
_BEGUN_S = 1.0
"""Time, seconds, for which a track must have been seen while a vehicle reported to have been compared with it."""
_CONTRADICTED = -5.0
"""ln ratio below which that comparison says that the two are not one."""
_START_M, _SPEED_MPS = 10.0, 12.0
"""Farthest that a silent vehicle is from its last reported place: metres at once, and metres per second since."""
_FOUND = 0.9
"""Chance that a missing vehicle is one of u boxes that it may be or an unseen one, divided equally among u + 1."""
_MIN_SHARE, _MAX_SHARE = 0.11, 0.45
"""Limits of a box's share in a missing vehicle: while one is missing nobody is a stranger with 0.9."""


@dataclass(frozen=True, slots=True)
class Whereabouts:
    """Last known places of n vehicles at a frame."""

    place: FloatArray
    """(n, 2) last reported place, east and north, metres, NaN never."""
    age_s: FloatArray
    """(n,) age of that report, seconds; inf where a vehicle's reports are not believed."""
    view: FloatArray
    """(n,) chance to be in view by that report."""
    last_t: FloatArray
    """(n,) time of the last report that was believed, seconds."""


def shared_with_missing(
    p: FloatArray,
    place: FloatArray,
    first_s: FloatArray,
    score: FloatArray,
    elsewhere: BoolArray,
    former: IntArray,
    fleet: Whereabouts,
) -> FloatArray:
    """Marginals in which "none of ours" leaves a share to vehicles that are not accounted for.

    With u boxes that vehicle j may be, each is it with s_j = 0.9/(u + 1), within 0.11 and 0.45, and none of ours with
    p₀ Π (1 − s_j).

    Args:
        p: (m, n + 1) marginals, the last column "none of ours".
        place: (m, 2) of the tracks on the ground, metres, NaN unknown.
        first_s: (m,) when each began, seconds.
        score: (m, n) ln ratios.
        elsewhere: (m, n) vehicles that were surely another track beside this one.
        former: (m,) vehicle that each track surely was before, −1 none.
        fleet: The vehicles.
    """
    n = p.shape[1] - 1
    reports = fleet.age_s < _REPORTING_S
    away = reports & (fleet.view < _OUT_OF_VIEW)
    unseen = np.max(p[:, :n], axis=0, initial=0.0) < _NAMED
    missing = unseen & ~away
    free = np.max(p[:, :n], axis=1, initial=0.0) < _NAMED
    if not unseen.any() or not free.any():
        return p
    far = np.linalg.norm(place[:, None] - fleet.place[None], axis=2)
    # what one told before it fell silent was right
    compared = (first_s[:, None] < fleet.last_t[None] - _BEGUN_S) & (score < _CONTRADICTED)
    elsewhere = elsewhere | ~reports[None] & (compared | (far > _START_M + _SPEED_MPS * fleet.age_s[None]))
    may = missing[None] & free[:, None] & ~elsewhere
    # one that reports to be elsewhere now may lie
    may |= free[:, None] & unseen[None] & (former[:, None] == np.arange(n))
    share = np.clip(_FOUND / (np.count_nonzero(may, axis=0) + 1.0), _MIN_SHARE, _MAX_SHARE)
    s = np.where(may, share[None], 0.0)
    none = p[:, n] * np.prod(1.0 - s, axis=1)
    gone = p[:, n] - none
    weight = s / np.maximum(np.sum(s, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.column_stack([p[:, :n] + gone[:, None] * weight, none])
