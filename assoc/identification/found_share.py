"""Share of the time in which a detector finds a vehicle that is in view, learnt from the flight.

A detector finds nearly all vehicles, or seven in ten. Where it misses many, a box beside a vehicle's report is weak
evidence that it is that vehicle's own: strangers drive there too. What counts is the vehicle in the middle: one whose
reports are wrong, or that is hidden, says nothing of the detector.
"""

from __future__ import annotations

from statistics import median

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_USUAL, _USUAL_S = 0.985, 2.5
"""The share that is assumed, and for how many seconds of each vehicle that counts."""
_REMEMBERED_S = 40.0
"""Time constant with which what was seen is forgotten, seconds."""
_IN_VIEW = 0.97
"""Chance of being in view from which a vehicle should have a box: at the border some of it is cut."""
_MIN_SHARE = 0.5
"""Least share that is estimated: below it the camera sees something else."""
_COUNTED, _NO_TRUST = 1.4, 3.0
"""Factor on the nats that the share takes off the odds, more than 1 since misses come in runs; and the nats that leave
no trust."""
_LONGEST_STEP_S = 1.0
"""Time that counts between two updates, seconds."""
_OWN_STD = 3.0
"""Farthest that a vehicle's own box is from its report, 1σ of what receivers wander."""


def own_boxes(vehicle: IntArray, bias: FloatArray, bias_std: float, *, strangers: bool) -> BoolArray:
    """Tracks that may be the box of the vehicle that they are given to.

    Where strangers drive as well, one that is far from the report has the place of a vehicle without a box, and is no
    box of that vehicle's.

    Args:
        vehicle: (m,) of each track, −1 none.
        bias: (≥ m, n, 2) how far each track is from each report, metres.
        bias_std: 1σ per axis of what receivers wander, metres.
        strangers: Whether more is seen than vehicles of ours.

    Returns:
        (m,).
    """
    away = np.linalg.norm(bias[np.arange(len(vehicle)), vehicle], axis=1)
    return np.asarray((vehicle >= 0) & ((away < _OWN_STD * bias_std) | (not strangers)))


class FoundShare:
    """The share q of the time in which a vehicle that should be in view has a box.

    Args:
        n: Vehicles.
    """

    def __init__(self, n: int) -> None:
        self._expected_s, self._found_s = np.zeros(n), np.zeros(n)
        self._t = np.inf

    @property
    def share(self) -> float:
        """q."""
        each = (self._found_s + _USUAL * _USUAL_S) / (self._expected_s + _USUAL_S)
        known = each[self._expected_s > 0.0]
        return max(median(known.tolist()), _MIN_SHARE) if len(known) else _USUAL

    @property
    def log_odds_lost(self) -> float:
        """Amount by which the odds of a box beside a report to be that vehicle's are less than usual, nats, ≥ 0."""
        return _COUNTED * self._lost

    @property
    def trust(self) -> float:
        """1 where all are found, 0 where a box in the right place says little: whether names are kept against doubt."""
        return max(1.0 - self._lost / _NO_TRUST, 0.0)

    @property
    def _lost(self) -> float:
        """logit of the usual share less that of q, nats."""
        q = min(self.share, _USUAL)
        return float(np.log(_USUAL / (1.0 - _USUAL)) - np.log(q / (1.0 - q)))

    def update(self, t: float, view: FloatArray, seen: IntArray) -> None:
        """Take in an update in which film and telemetry fit.

        Args:
            t: Time, seconds.
            view: (n,) chance of each vehicle to be in view.
            seen: Vehicles that have a box, by the best hypothesis.
        """
        dt = min(max(t - self._t, 0.0), _LONGEST_STEP_S) if np.isfinite(self._t) else 0.0
        self._t = t
        expected = view > _IN_VIEW
        keep = float(np.exp(-dt / _REMEMBERED_S))
        self._expected_s = keep * self._expected_s + dt * expected
        self._found_s = keep * self._found_s + dt * (expected & np.isin(np.arange(len(view)), seen))
