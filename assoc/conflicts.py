"""Reports that contradict the picture or one another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.labels import names
from assoc.search import Hypothesis, Scene

__all__ = ["ConflictWatch"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LASTING_S = 2.0
_CLAIM = 12.0
_SURE = 0.9
_HEARD_S = 3.0


class ConflictWatch:
    """Remembers for how long contradictions have lasted.

    Two kinds: *double*, a vehicle reports the place of another, and has no track of its own but fits the other's, or
    has jumped there as no vehicle can (a copy, or one of the two is spoofed); *gone*, a track that surely was a vehicle
    is surely none of ours now while the vehicle still reports.
    """

    def __init__(self) -> None:
        self._double_since: dict[tuple[int, int], float] = {}
        self._was: dict[int, int] = {}
        self._gone_since: dict[int, float] = {}

    def review(self, t: float, scene: Scene, best: Hypothesis, p: FloatArray) -> tuple[FloatArray, tuple[int, ...]]:
        """Marginals in which doubles share their track, and the vehicles in conflict.

        Args:
            t: Time, seconds.
            scene: The update's scene.
            best: Its best hypothesis.
            p: (m, n + 1) marginals.

        Returns:
            (m, n + 1) marginals; indices of vehicles.
        """
        choice = names(p)
        jumped = np.any(best.blocks.jump_var > 0.0, axis=0)
        doubles = self._doubles(t, scene, best, choice, jumped)
        p = p.copy()
        for row, first, second in doubles:
            # whoever has just jumped there has the weaker claim
            if jumped[first] != jumped[second]:
                continue
            p[row, [first, second]] = 0.5 * (p[row, first] + p[row, second])
        gone = self._gone(t, scene, choice, p)
        return p, tuple(sorted({v for _, *pair in doubles for v in pair} | gone))

    def _doubles(self, t: float, scene: Scene, best: Hypothesis, choice: IntArray,
                 jumped: BoolArray) -> list[tuple[int, int, int]]:  # fmt: skip
        """(track, vehicle, vehicle) that have lasted."""
        place, age = scene.log.extrapolated(t)
        heard = age < _HEARD_S
        free = np.setdiff1d(np.flatnonzero(heard), choice)
        reach = 2.5 * scene.noise.bias_std + float(np.sqrt(scene.noise.white_var))
        now: dict[tuple[int, int], int] = {}
        for row in np.flatnonzero(choice >= 0).tolist():
            own = int(choice[row])
            claims = set(free[best.score[row, free] > _CLAIM].tolist()) | set(np.flatnonzero(jumped & heard).tolist())
            for other in claims - {own}:
                if float(np.hypot(*(place[own] - place[other]))) < reach and heard[own]:
                    now[min(own, other), max(own, other)] = row
        self._double_since = {pair: self._double_since.get(pair, t) for pair in now}
        return [(now[pair], *pair) for pair, since in self._double_since.items() if t - since >= _LASTING_S]

    def _gone(self, t: float, scene: Scene, choice: IntArray, p: FloatArray) -> set[int]:
        """Vehicles whose track, still seen, has long been surely not theirs any more, and who have no other."""
        age = t - scene.log.last_t
        ids = scene.history.track_id[scene.columns[: scene.live]].tolist()
        found: set[int] = set()
        for row, key in enumerate(ids):
            if choice[row] >= 0 and p[row, choice[row]] > _SURE:
                self._was[key] = int(choice[row])
            elif key in self._was and p[row, -1] > _SURE and age[self._was[key]] < _HEARD_S and scene.gap_s[row] <= 0.0:
                found.add(self._was[key])
        self._was = {key: vehicle for key, vehicle in self._was.items() if key in ids}
        # occluded or out of the picture is no contradiction, and a moment of doubt none either
        self._gone_since = {v: self._gone_since.get(v, t) for v in found - set(choice.tolist())}
        return {v for v, since in self._gone_since.items() if t - since >= _LASTING_S}
