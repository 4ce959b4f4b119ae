"""Reasons why two views have the same vehicles in other places: a clock, a position, a camera.

A vehicle that both name surely is at g'_j in the other view, where it drives with v_j, and d_j = g_j − g'_j away from
there in this one. With r_j = g'_j − their mean and J a quarter turn, one of

    clock      d = δ v              one of both dates its pictures δ later
    position   d = s                the place of one camera is off
    camera     d = s + κ r + φ J r  one is turned by φ, or is taken to see wider or narrower by κ

has to explain it, by the least squares and the Bayesian information criterion (Schwarz 1978,
doi:10.1214/aos/1176344136). Vehicles that all drive alike are as far off by a clock as by a position: then nothing is
said.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_EVERY_S, _KEPT_S = 0.5, 6.0
"""Time between two looks, and how long they count, seconds."""
_MIN_VEHICLES = 3
"""Vehicles that are needed; of more looks a parabola is made."""
_APART, _EXPLAINED = 3.0, 2.0
"""Root mean square of d in σ from which on the views are apart, and up to which it is explained."""
_SURELY = 10.0
"""Lead of the best explanation in the criterion."""
_MIN_SPAN_S = 2.0
"""Time over which a velocity is measured, at least, seconds."""
_FLOOR_M2 = 0.25
"""Variance of a place beside what a view tells of it: both find their poses again all the time."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Cause of a difference of two views."""

    kind: Literal["clock", "position", "camera"]
    value: float
    """Seconds; metres; radians."""
    scale: float = 1.0
    """Factor by which a camera's places are too wide, against another view's."""


class Reconciliation:
    """Follows by how much two views have the vehicles apart that both name."""

    def __init__(self) -> None:
        self._looks: deque[tuple[float, IntArray, FloatArray]] = deque()
        """Comparisons: time, seconds; vehicles (k,); and (k, 5) d, g' and the variance of d, metres."""

    def is_due(self, t: float) -> bool:
        """Tell whether a moment, seconds, is to be looked at."""
        return not self._looks or not 0.0 <= t - self._looks[-1][0] < _EVERY_S

    def look(self, t: float, vehicle: IntArray, rows: FloatArray) -> None:
        """Take in a moment.

        Args:
            t: seconds.
            vehicle: (k,) which both views name surely.
            rows: (k, 5) d and g', two numbers each, and the variance of d per axis.
        """
        self._looks = deque(each for each in self._looks if 0.0 <= t - each[0] < _KEPT_S)
        known = np.isfinite(rows).all(axis=1)
        self._looks.append((t, vehicle[known], rows[known]))

    def cause(self) -> Cause | None:
        """The best explanation; None: they are not apart, or the data do not tell."""
        if not self._looks:
            return None
        vehicles, rows = (np.concatenate([each[k] for each in self._looks]) for k in (1, 2))
        t = np.concatenate([np.full(len(each[1]), each[0]) for each in self._looks])
        v = _velocities(t, vehicles, rows[:, 2:4])
        rows, v, vehicles = (column[np.isfinite(v[:, 0])] for column in (rows, v, vehicles))
        if len(set(vehicles.tolist())) < _MIN_VEHICLES:
            return None
        d, place, var = rows[:, 0:2], rows[:, 2:4], rows[:, 4] + _FLOOR_M2
        # looks that follow each other share their errors: those of a second count as one
        n, weight = 2.0 * _EVERY_S * len(rows), _EVERY_S / var
        if np.sum(weight[:, None] * d * d) < _APART**2 * n:
            return None
        r, zero, one = place - np.average(place, axis=0, weights=weight), np.zeros(len(d)), np.ones(len(d))
        shift = [np.column_stack([one, zero]), np.column_stack([zero, one])]
        turn = [r, np.column_stack([-r[:, 1], r[:, 0]])]
        fits = {
            "clock": _fit(d, [v], weight),
            "position": _fit(d, shift, weight),
            "camera": _fit(d, [*shift, *turn], weight),
        }
        criterion = {kind: misfit + len(x) * math.log(n) for kind, (x, misfit) in fits.items()}
        best, *others = sorted(criterion, key=lambda kind: criterion[kind])
        # a camera's explanation has a position's in it
        rivals = [kind for kind in others if (best, kind) != ("position", "camera")]
        x, misfit = fits[best]
        if misfit > _EXPLAINED**2 * n or any(criterion[kind] < criterion[best] + _SURELY for kind in rivals):
            return None
        if best == "clock":
            return Cause("clock", abs(float(x[0])))
        if best == "position":
            return Cause("position", float(np.hypot(*x)))
        return Cause("camera", abs(math.atan2(float(x[3]), 1.0 + float(x[2]))), math.hypot(1.0 + x[2], x[3]))


def _velocities(t: FloatArray, vehicle: IntArray, place: FloatArray) -> FloatArray:
    """(k, 2) velocities of vehicles (k,) by parabolas through their places (k, 2); NaN of those seen for too short."""
    v = np.full(place.shape, np.nan)
    for one in set(vehicle.tolist()):
        rows = np.flatnonzero(vehicle == one)
        if len(rows) > _MIN_VEHICLES and np.ptp(t[rows]) >= _MIN_SPAN_S:
            at = t[rows] - t[rows[0]]
            _, slope, bend = np.polynomial.polynomial.polyfit(at, place[rows], 2)
            v[rows] = slope + 2.0 * at[:, None] * bend
    return v


def _fit(d: FloatArray, parts: list[FloatArray], weight: FloatArray) -> tuple[FloatArray, float]:
    """Least squares of d (k, 2) by fields (k, 2) each: how much of each, and the misfit."""
    root = np.sqrt(weight)[:, None]
    A = np.column_stack([(root * part).ravel() for part in parts])
    b = (root * d).ravel()
    x: FloatArray = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], np.float64)
    return x, float(np.sum((b - A @ x) ** 2))
