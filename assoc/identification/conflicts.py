"""Vehicles whose reports contradict the video or one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.labels import most_probable_names
from assoc.hypotheses.search import Hypothesis, UpdateContext

__all__ = ["ConflictMonitor", "ConflictReview"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LASTING_S = 2.0
"""A contradiction counts once it has lasted so long, seconds: neighbours are taken for doubles for a moment."""
_LAPSE_S = 1.0
"""For how long a double of which one jumped may be unseen before it is over, seconds."""
_REACH_STD, _HOLD = 2.5, 2.0
"""Two vehicles report one place within so many σ of the bias and one of the white noise; while one of them is known to
have jumped there, within so many times as much."""
_CLAIM = 12.0
"""Score, nats, with which a vehicle without a track fits another's track so well that it is a double."""
_CONFIDENT = 0.9
"""Probability from which a track was surely a vehicle, or is surely none of ours."""
_REPORTING_S = 3.0
"""Age of the newest report, seconds, up to which a vehicle counts as reporting."""
_UNKNOWN = -1


@dataclass(slots=True)
class _Double:
    """Two vehicles that report one place."""

    row: int
    """Row of the track there."""
    since: float
    last: float
    """When this was seen first and last, seconds."""
    jumper: int = _UNKNOWN
    """The one of them that jumped there, as no vehicle can."""

    @property
    def lapse_s(self) -> float:
        """For how long it may be unseen before it is over: without a jump, two neighbours are easily taken for it."""
        return 0.0 if self.jumper == _UNKNOWN else _LAPSE_S


@dataclass(frozen=True, slots=True)
class ConflictReview:
    """What contradictions mean for the answers of an update."""

    p: FloatArray
    """(m, n + 1) marginals in which doubles share their track."""
    vehicles: tuple[int, ...]
    """Indices of the vehicles in conflict."""
    rejected_since: FloatArray
    """(n,) reports of this time, seconds, and later ones are of another vehicle's place; inf none."""


class ConflictMonitor:
    """Remembers for how long contradictions have lasted.

    Two kinds: *double*, a vehicle reports the place of another, and has no track of its own there but fits the other's,
    or has jumped there as no vehicle can (a copy, or one of the two is spoofed); *gone*, a track that surely was a
    vehicle is surely none of ours now while the vehicle still reports.
    """

    def __init__(self) -> None:
        self._double: dict[tuple[int, int], _Double] = {}
        self._was: dict[int, int] = {}
        self._gone_since: dict[int, float] = {}

    def review(self, t: float, context: UpdateContext, best: Hypothesis, p: FloatArray) -> ConflictReview:
        """Look for contradictions in the answers of an update.

        Args:
            t: Time, seconds.
            context: What the update worked on.
            best: Its best hypothesis.
            p: (m, n + 1) marginals.
        """
        choice = most_probable_names(p)
        self._note_doubles(t, context, best, choice)
        lasting = {pair: d for pair, d in self._double.items() if t - d.since >= _LASTING_S}
        rejected_since, p = np.full(p.shape[1] - 1, np.inf), p.copy()
        for pair, double in lasting.items():
            if double.jumper == _UNKNOWN:
                p[double.row, pair] = 0.5 * np.sum(p[double.row, pair])
            else:
                rejected_since[double.jumper] = double.since - _LAPSE_S
        gone = self._gone(t, context, choice, p)
        vehicles = tuple(sorted({v for pair in lasting for v in pair} | gone))
        return ConflictReview(p, vehicles, rejected_since)

    def _note_doubles(self, t: float, context: UpdateContext, best: Hypothesis, choice: IntArray) -> None:
        """Keep the pairs of vehicles that report one place, the track there, and who came there by a jump."""
        place, reporting = context.log.extrapolated(t)[0], t - context.log.last_t < _REPORTING_S
        reach = _REACH_STD * context.noise.bias_std + float(np.sqrt(context.noise.white_var))
        # a shorter jump leads from one neighbour to the next
        jumped = reporting & np.any(best.blocks.jump_var > reach**2, axis=0)
        away = np.hypot(best.final.mean[: context.live, :, 0], best.final.mean[: context.live, :, 1])
        free = reporting.copy()
        free[choice[choice >= 0]] = False
        for row in np.flatnonzero(choice >= 0).tolist():
            own = int(choice[row])
            if not reporting[own] or away[row, own] > reach:
                continue
            apart = np.hypot(*(place - place[own]).T)
            known = self._copies(own, len(place)) & reporting & (apart < _HOLD * reach)
            claims = known | ((apart < reach) & (jumped | (free & (best.score[row] > _CLAIM))))
            claims[own] = False
            for other in np.flatnonzero(claims).tolist():
                double = self._double.setdefault((min(own, other), max(own, other)), _Double(row, t, t))
                double.row, double.last = row, t
                if double.jumper == _UNKNOWN and jumped[own] != jumped[other]:
                    double.jumper = own if jumped[own] else other
        self._double = {pair: d for pair, d in self._double.items() if t - d.last <= d.lapse_s}

    def _copies(self, own: int, n: int) -> BoolArray:
        """(n,) vehicles of which one jumped to where the other was, ``own`` among the two."""
        found = np.zeros(n, np.bool_)
        for pair, double in self._double.items():
            if own in pair and double.jumper != _UNKNOWN:
                found[list(pair)] = True
        return found

    def _gone(self, t: float, context: UpdateContext, choice: IntArray, p: FloatArray) -> set[int]:
        """Vehicles whose track, still seen, has long been surely not theirs any more, and who have no other."""
        age = t - context.log.last_t
        ids = context.history.track_id[context.columns[: context.live]].tolist()
        found: set[int] = set()
        for row, key in enumerate(ids):
            if choice[row] >= 0 and p[row, choice[row]] > _CONFIDENT:
                self._was[key] = int(choice[row])
            elif (
                key in self._was
                and p[row, -1] > _CONFIDENT
                and age[self._was[key]] < _REPORTING_S
                and context.gap_s[row] <= 0.0
            ):
                found.add(self._was[key])
        self._was = {key: vehicle for key, vehicle in self._was.items() if key in ids}
        # occluded or out of the image is no contradiction, and a moment of doubt none either
        self._gone_since = {v: self._gone_since.get(v, t) for v in found - set(choice.tolist())}
        return {v for v, since in self._gone_since.items() if t - since >= _LASTING_S}
