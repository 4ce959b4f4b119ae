"""Vehicles whose reports contradict the video or one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.doubles import shared_tracks, shares_of_two
from assoc.hypotheses.labels import most_probable_names
from assoc.hypotheses.search import Hypothesis, UpdateContext

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LASTING_S = 2.0
"""A contradiction is reported once it has lasted this long, seconds: neighbours look like doubles for a moment."""
_TIMEOUT_S = 1.0
"""Time for which a double stays valid without being observed again, seconds."""
_REACH_STD, _HYSTERESIS = 2.5, 2.0
"""Two vehicles count as reporting one place if closer than the first times σ of the bias plus one σ of the white noise;
once one is known to have jumped there, the second times as far is allowed."""
_COPY = 6.0
"""ln N above which a vehicle without a track of its own surely moves like another's."""
_LIES = 0.5
"""Chance above which a vehicle that fits another's track without one of its own lies, rather than drives beside it."""
_IN_VIEW = 0.5
"""Chance from which a vehicle should be in view."""
_CONFIDENT = 0.9
"""Probability above which a track counts as certainly one vehicle, or as certainly none of ours."""
_REPORTING_S = 3.0
"""Age of the newest report, seconds, up to which a vehicle counts as reporting."""
_UNKNOWN = -1


@dataclass(slots=True)
class _Double:
    """Two vehicles that report one place."""

    row: int
    """Row of the track there."""
    since: float
    """Time at which this was observed first, seconds."""
    last: float
    """Time at which this was observed last, seconds."""
    jumper: int = _UNKNOWN
    """Index of the vehicle whose reports jumped there, further than a vehicle can move; −1 none."""


@dataclass(frozen=True, slots=True)
class ConflictReview:
    """Effect of the contradictions on the results of an update."""

    p: FloatArray
    """(m, n + 1) marginals in which vehicles that report one place share the track there."""
    vehicles: tuple[int, ...]
    """Indices of the vehicles in conflict."""
    rejected_since: FloatArray
    """(n,) time, seconds, from which a vehicle's reports are rejected because they give another's place; inf none."""


class ConflictMonitor:
    """Finds contradictions between reports and video, and measures how long they last.

    Two kinds: *double*, a vehicle reports the place of another, and either has no track of its own but fits the
    other's, or jumped there faster than a vehicle can move (a copy, or one of the two is spoofed); *gone*, a track that
    was certainly a vehicle is now certainly none of ours while the vehicle still reports.
    """

    def __init__(self) -> None:
        self._double: dict[tuple[int, int], _Double] = {}
        self._last_vehicle: dict[int, int] = {}
        self._gone_since: dict[int, float] = {}

    def review(
        self, t: float, context: UpdateContext, best: Hypothesis, p: FloatArray, elsewhere: BoolArray
    ) -> ConflictReview:
        """Look for contradictions in the results of an update.

        Args:
            t: Time, seconds.
            context: What the update worked on.
            best: Its best hypothesis.
            p: (m, n + 1) marginals.
            elsewhere: (m, n) vehicles that were another track while this one was seen: it is not theirs.
        """
        choice = most_probable_names(p)
        self._update_doubles(t, context, best, choice, elsewhere)
        lasting = {pair: d for pair, d in self._double.items() if t - d.since >= _LASTING_S}
        rejected_since, p = np.full(p.shape[1] - 1, np.inf), p.copy()
        for pair, double in lasting.items():
            if double.jumper != _UNKNOWN:
                rejected_since[double.jumper] = double.since - _TIMEOUT_S
            elif double.last == t and not np.any(elsewhere[double.row, pair]):
                evidence = best.score[double.row, pair] - context.in_view[[*pair]]
                shares = shares_of_two(evidence, best.final.mean[double.row, pair], context.noise.bias_std)
                p[double.row, pair] = np.sum(p[double.row, pair]) * shares
        gone = self._gone_vehicles(t, context, choice, p)
        vehicles = tuple(sorted({v for pair in lasting for v in pair} | gone))
        return ConflictReview(p, vehicles, rejected_since)

    def former(self, track_id: IntArray) -> IntArray:
        """(m,) vehicle that each track surely was last, −1 none."""
        return np.array([self._last_vehicle.get(key, -1) for key in track_id.tolist()], np.int64)

    def _update_doubles(
        self, t: float, context: UpdateContext, best: Hypothesis, choice: IntArray, elsewhere: BoolArray
    ) -> None:
        """Update the pairs of vehicles that report one place: the track there, and which of them jumped there."""
        place, reporting = context.log.extrapolated(t)[0], t - context.log.last_t < _REPORTING_S
        reach = _REACH_STD * context.noise.bias_std + float(np.sqrt(context.noise.white_var))
        # shorter jumps are not counted: they are within the distance between neighbours
        jumped = reporting & np.any(best.blocks.jump_var > reach**2, axis=0)
        away = np.hypot(best.final.mean[: context.live, :, 0], best.final.mean[: context.live, :, 1])
        # who is where it reports to be is nobody's copy, however its reports scatter
        rows = np.flatnonzero(choice >= 0)
        rows = rows[away[rows, choice[rows]] <= reach]
        home = set(choice[rows].tolist())
        # one that is out of view has no box of its own to miss
        self._note_copies(t, context, best, reporting & (context.view >= _IN_VIEW), elsewhere)
        for row in rows.tolist():
            own = int(choice[row])
            if not reporting[own]:
                continue
            apart = np.hypot(*(place - place[own]).T)
            known = self._copies(own, len(place)) & reporting & (apart < _HYSTERESIS * reach)
            claims = known | ((apart < reach) & jumped)
            claims[own] = False
            for other in np.flatnonzero(claims).tolist():
                # once the reports that jumped are left out it is at home by those before
                if other in home and not (known[other] and self._lasts(t, own, other)):
                    continue
                double = self._observed(t, row, own, other)
                if double.jumper == _UNKNOWN and jumped[own] != jumped[other]:
                    double.jumper = own if jumped[own] else other
        self._double = {pair: d for pair, d in self._double.items() if t - d.last <= _TIMEOUT_S}

    def _note_copies(
        self, t: float, context: UpdateContext, best: Hypothesis, visible: BoolArray, elsewhere: BoolArray
    ) -> None:
        """Note vehicles without a track of their own that report the place of another."""
        evidence, bias = best.score - context.in_view - context.log_odds, best.final.mean[: context.live]
        for track in shared_tracks(best.score, evidence, bias, context.noise.bias_std, elsewhere):
            own, *others = track.vehicles
            sure = (track.log_copy > _COPY) & (track.lies > _LIES)
            for other, copies in zip(others, sure[1:].tolist(), strict=True):
                # their biases, which are smoothed, tell how far apart the two report to be
                apart = np.hypot(*(bias[track.row, other] - bias[track.row, own]))
                limit = _REACH_STD * context.noise.bias_std * (_HYSTERESIS if self._lasts(t, own, other) else 1.0)
                if copies and visible[other] and apart < limit:
                    self._observed(t, track.row, own, other)

    def _observed(self, t: float, row: int, own: int, other: int) -> _Double:
        """The double of two vehicles, observed at the track of one of them."""
        double = self._double.setdefault((min(own, other), max(own, other)), _Double(row, t, t))
        double.row, double.last = row, t
        return double

    def _lasts(self, t: float, own: int, other: int) -> bool:
        """Tell whether the two have been a double for long enough to be told."""
        double = self._double.get((min(own, other), max(own, other)))
        return double is not None and t - double.since >= _LASTING_S

    def _copies(self, own: int, n: int) -> BoolArray:
        """(n,) vehicles of which one jumped to where the other was, ``own`` among the two."""
        found = np.zeros(n, np.bool_)
        for pair, double in self._double.items():
            if own in pair and double.jumper != _UNKNOWN:
                found[list(pair)] = True
        return found

    def _gone_vehicles(self, t: float, context: UpdateContext, choice: IntArray, p: FloatArray) -> set[int]:
        """Vehicles without a track whose former track is still seen but has for ``_LASTING_S`` been none of ours."""
        age = t - context.log.last_t
        ids = context.history.track_id[context.columns[: context.live]].tolist()
        found: set[int] = set()
        track_of: dict[int, int] = {}
        for row, key in enumerate(ids):
            if choice[row] >= 0 and p[row, choice[row]] > _CONFIDENT:
                self._last_vehicle[key] = int(choice[row])
                track_of[int(choice[row])] = key
            elif (
                key in self._last_vehicle
                and p[row, -1] > _CONFIDENT
                and age[self._last_vehicle[key]] < _REPORTING_S
                and context.gap_s[row] <= 0.0
            ):
                found.add(self._last_vehicle[key])
        # a vehicle that is surely another track since was never this one
        self._last_vehicle = {
            key: vehicle
            for key, vehicle in self._last_vehicle.items()
            if key in ids and track_of.get(vehicle, key) == key
        }
        # a vehicle that is occluded or out of the image does not contradict, nor does a moment of doubt
        self._gone_since = {v: self._gone_since.get(v, t) for v in found - set(choice.tolist())}
        return {v for v, since in self._gone_since.items() if t - since >= _LASTING_S}
