"""Times at which a tracker could have exchanged two tracks: side by side, unseen, or after a leap that no vehicle
makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.evidence.blocks import LEAP_M, LEAP_MPS
from assoc.params import IdentifierParams

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LOG_CHANCE_AFTER_WINDOW = -50.0
"""ln chance of a change in the first comparison after the window: practically none."""


def _near(place: FloatArray, reach_m: float) -> BoolArray:
    """(m, m) which of others are within reach; NaN is not."""
    away = np.linalg.norm(place[:, None] - place[None], axis=2)
    np.fill_diagonal(away, np.inf)
    return np.asarray(away < reach_m)


class SwapRisk:
    """Remembers, block by block, which tracks were in danger of changing their vehicle."""

    def __init__(self, params: IdentifierParams) -> None:
        self._params = params
        self._rates: dict[int, dict[int, float]] = {}
        self._place: dict[int, tuple[float, FloatArray]] = {}

    def reset(self, column: int) -> None:
        """Drop what is known of a column: a new track begins in it."""
        self._place.pop(column, None)

    def update(
        self, t: float, columns: IntArray, ground: FloatArray, missed: BoolArray, first_block: int | None
    ) -> BoolArray:
        """Remember where tracks are now.

        Args:
            t: Time, seconds.
            columns: (m,) their columns.
            ground: (m, 2) east and north, NaN unseen.
            missed: (m,) whether they were out of sight in any frame since the last call.
            first_block: Blocks before are forgotten.

        Returns:
            (m,) which of them may have changed their vehicle.
        """
        q = self._params
        lost = ~np.isfinite(ground[:, 0])
        close = lost | np.any(_near(ground, q.close_m), axis=1)
        # two that were missed side by side were perhaps one box, and come out of it in either order
        _, before = self.places(columns)
        beside = _near(np.where(lost[:, None], before, ground), q.close_m) & missed
        leapt = np.array(
            [self._leapt(t, c, place) for c, place in zip(columns.tolist(), ground, strict=True)], np.bool_
        )
        risky = leapt | (missed & np.any(beside, axis=1))
        rates = self._rates.setdefault(int(np.floor(t / q.block_s)), {})
        for k, column in enumerate(columns.tolist()):
            if risky[k]:
                rates[column] = q.switch_rate_leap
            elif close[k]:
                rates.setdefault(column, q.switch_rate_close)
        self._rates = {b: s for b, s in self._rates.items() if first_block is None or b >= first_block}
        return np.asarray(risky)

    def places(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """(m,) when each track was last noted in its place, seconds, and (m, 2) where; NaN never."""
        never = np.nan, np.full(2, np.nan)
        noted = [self._place.get(column, never) for column in columns.tolist()]
        return np.array([t for t, _ in noted]), np.array([place for _, place in noted]).reshape(-1, 2)

    def log_chances(self, first: int, blocks: int, columns: IntArray) -> FloatArray:
        """(B + 1, T) ln chance of a change of vehicle in each block, and in the first comparison after them."""
        q = self._params
        result = np.full((blocks + 1, len(columns)), np.log(q.switch_rate * q.block_s))
        for b in range(blocks):
            rates = self._rates.get(first + b, {})
            for k, column in enumerate(columns.tolist()):
                if column in rates:
                    result[b, k] = np.log(rates[column] * q.block_s)
        result[-1] = _LOG_CHANCE_AFTER_WINDOW
        return result

    def _leapt(self, t: float, column: int, place: FloatArray) -> bool:
        """Tell whether the track moved as no vehicle does since it was last noted; remembers where it is."""
        if not np.isfinite(place[0]):
            return False
        then, before = self._place.get(column, (t, place))
        self._place[column] = (t, place)
        return float(np.hypot(*(place - before))) > LEAP_M + LEAP_MPS * (t - then)
