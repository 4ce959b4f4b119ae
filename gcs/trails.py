"""Trails of vehicles: their positions over the last minutes, for the lines behind them on the map."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Snapshot
from mavlink.geodesy import LocalFrame

EVERY_US: Final = 500_000
"""Interval between two samples: a vehicle of 10 m/s is 5 m further."""
MAX_SAMPLES: Final = 14_400
"""Most samples of a trail, two hours at first; then every other one is dropped, and from then on half as many are
taken."""
MAX_POINTS: Final = 240
"""Maximum points of one trail: more than a screen can tell apart."""
LONGEST_GAP_US: Final = 3_000_000
"""Positions farther apart in time are not joined: nobody knows what was between them."""
FASTEST_MPS: Final = 60.0
"""A faster step is a jump of the receiver, or of the origin, and is not joined."""
SLACK_M: Final = 5.0
"""A step of this length is none, however short the time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trail:
    """The line behind one vehicle."""

    system_id: int
    p_enu: NDArray[np.float64]
    """(n, 2) metres, the oldest first; a row of NaN where the line is interrupted."""
    age: NDArray[np.float64]
    """(n,) 0 now, 1 at the end of the time asked for."""


class Trails:
    """Trails of the vehicles by snapshots, in any order of time; only positions that are up to date count."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._samples: list[tuple[LocalFrame | None, dict[int, tuple[float, float]]]] = []
        self._every_us = EVERY_US

    def add(self, snapshot: Snapshot) -> None:
        """Take in where everybody is, unless a moment close to it is known already."""
        t_us = snapshot.t_us
        at = bisect_left(self._times, t_us)
        near = self._times[max(0, at - 1) : at + 1]
        if not snapshot.analysed or any(abs(t_us - other) < self._every_us for other in near):
            return
        places = {
            row.system_id: (float(row.p_enu[0]), float(row.p_enu[1]))
            for row in snapshot.vehicles
            if row.position_state == "ok" and np.isfinite(row.p_enu[:2]).all()
        }
        self._times.insert(at, t_us)
        self._samples.insert(at, (snapshot.origin, places))
        if len(self._times) > MAX_SAMPLES:
            self._times, self._samples = self._times[::2], self._samples[::2]
            self._every_us *= 2

    def before(self, t_us: int, span_s: float, origin: LocalFrame | None) -> tuple[Trail, ...]:
        """Every vehicle's trail.

        Args:
            t_us: Its end; nothing later counts.
            origin: Of the metres; places about another one are left out.
        """
        first = bisect_left(self._times, t_us - round(span_s * 1e6))
        last = bisect_right(self._times, t_us)
        every = max(1, -(-(last - first) // MAX_POINTS))
        # by their number, so that the same ones are taken from frame to frame
        chosen = [i for i in range(first, last) if i % every == 0 or i == last - 1]
        chosen = [i for i in chosen if self._samples[i][0] == origin]
        ids = sorted({system_id for i in chosen for system_id in self._samples[i][1]})
        times = np.array([self._times[i] for i in chosen], dtype=np.int64)
        longest_us = max(LONGEST_GAP_US, 2 * every * self._every_us)
        trails = []
        for system_id in ids:
            nowhere = (np.nan, np.nan)
            places = np.array([self._samples[i][1].get(system_id, nowhere) for i in chosen]).reshape(-1, 2)
            age = np.asarray((t_us - times) * 1e-6 / max(span_s, 1e-3), dtype=np.float64)
            trails.append(_interrupted(system_id, places, age, times, longest_us))
        return tuple(trails)


def _interrupted(
    system_id: int,
    places: NDArray[np.float64],
    age: NDArray[np.float64],
    times: NDArray[np.int64],
    longest_us: int,
) -> Trail:
    """Insert a row of NaN between places that must not be joined."""
    dt_us = np.diff(times)
    step_m = np.hypot(*np.diff(places, axis=0).T) if len(places) > 1 else np.zeros(0)
    cut = (dt_us > longest_us) | (step_m > SLACK_M + FASTEST_MPS * dt_us * 1e-6)
    at = np.flatnonzero(cut) + 1
    if not len(at):
        return Trail(system_id=system_id, p_enu=places, age=age)
    return Trail(system_id=system_id, p_enu=np.insert(places, at, np.nan, axis=0), age=np.insert(age, at, age[at]))
