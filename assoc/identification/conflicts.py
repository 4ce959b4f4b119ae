"""Reports that contradict the video or one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.labels import names
from assoc.hypotheses.search import Hypothesis, UpdateContext

__all__ = ["ConflictWatch"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LASTING_S = 2.0
_LAPSE_S = 1.0
_HOLD = 2.0
"""Of two vehicles one jumped to where the other was: they may then come so many times as far apart as before."""
_CLAIM = 12.0
_SURE = 0.9
_HEARD_S = 3.0
_NO_ONE = -1


@dataclass(slots=True)
class _Double:
    """Two vehicles that report one place."""

    row: int
    """The track there."""
    since: float
    last: float
    jumper: int = _NO_ONE
    """The one of them that jumped there, as no vehicle can."""

    @property
    def lapse_s(self) -> float:
        """For how long it may be unseen before it is over: without a jump, two neighbours are easily taken for it."""
        return 0.0 if self.jumper == _NO_ONE else _LAPSE_S


class ConflictWatch:
    """Remembers for how long contradictions have lasted.

    Two kinds: *double*, a vehicle reports the place of another, and has no track of its own there but fits the other's,
    or has jumped there as no vehicle can (a copy, or one of the two is spoofed); *gone*, a track that surely was a
    vehicle is surely none of ours now while the vehicle still reports.
    """

    def __init__(self) -> None:
        self._double: dict[tuple[int, int], _Double] = {}
        self._was: dict[int, int] = {}
        self._gone_since: dict[int, float] = {}

    def review(
        self, t: float, scene: UpdateContext, best: Hypothesis, p: FloatArray
    ) -> tuple[FloatArray, tuple[int, ...]]:
        """Marginals in which doubles share their tracks, and the vehicles in conflict.

        Where it is known who jumped to the other's place, the log is told to compare that one's reports no more.

        Args:
            t: Time, seconds.
            scene: The update's scene.
            best: Its best hypothesis.
            p: (m, n + 1) marginals.

        Returns:
            (m, n + 1) marginals; indices of vehicles.
        """
        choice = names(p)
        self._note_doubles(t, scene, best, choice)
        lasting = {pair: d for pair, d in self._double.items() if t - d.since >= _LASTING_S}
        scene.log.doubted_since[:] = np.inf
        p = p.copy()
        for pair, double in lasting.items():
            if double.jumper == _NO_ONE:
                p[double.row, pair] = 0.5 * np.sum(p[double.row, pair])
            else:
                scene.log.doubted_since[double.jumper] = double.since - _LAPSE_S
        gone = self._gone(t, scene, choice, p)
        return p, tuple(sorted({v for pair in lasting for v in pair} | gone))

    def _note_doubles(self, t: float, scene: UpdateContext, best: Hypothesis, choice: IntArray) -> None:
        """Keep the pairs of vehicles that report one place, the track there, and who came there by a jump."""
        place, heard = scene.log.extrapolated(t)[0], t - scene.log.last_t < _HEARD_S
        reach = 2.5 * scene.noise.bias_std + float(np.sqrt(scene.noise.white_var))
        # a shorter jump leads from one neighbour to the next
        jumped = heard & np.any(best.blocks.jump_var > reach**2, axis=0)
        away = np.hypot(best.final.mean[: scene.live, :, 0], best.final.mean[: scene.live, :, 1])
        free = heard.copy()
        free[choice[choice >= 0]] = False
        for row in np.flatnonzero(choice >= 0).tolist():
            own = int(choice[row])
            if not heard[own] or away[row, own] > reach:
                continue
            apart = np.hypot(*(place - place[own]).T)
            known = self._copies(own, len(place)) & heard & (apart < _HOLD * reach)
            claims = known | ((apart < reach) & (jumped | (free & (best.score[row] > _CLAIM))))
            claims[own] = False
            for other in np.flatnonzero(claims).tolist():
                double = self._double.setdefault((min(own, other), max(own, other)), _Double(row, t, t))
                double.row, double.last = row, t
                if double.jumper == _NO_ONE and jumped[own] != jumped[other]:
                    double.jumper = own if jumped[own] else other
        self._double = {pair: d for pair, d in self._double.items() if t - d.last <= d.lapse_s}

    def _copies(self, own: int, n: int) -> BoolArray:
        """(n,) vehicles of which one jumped to where the other was, ``own`` among the two."""
        found = np.zeros(n, np.bool_)
        for pair, double in self._double.items():
            if own in pair and double.jumper != _NO_ONE:
                found[list(pair)] = True
        return found

    def _gone(self, t: float, scene: UpdateContext, choice: IntArray, p: FloatArray) -> set[int]:
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
        # occluded or out of the image is no contradiction, and a moment of doubt none either
        self._gone_since = {v: self._gone_since.get(v, t) for v in found - set(choice.tolist())}
        return {v for v, since in self._gone_since.items() if t - since >= _LASTING_S}
