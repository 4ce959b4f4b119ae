"""The vehicles' position reports: how well each is predicted by the earlier ones, and how noisy they are.

"The track is not this vehicle" means that the vehicle's reports are explained by its own past alone. That null model is
a constant-velocity Kalman filter per vehicle and per candidate noise σ; its one-step likelihoods are kept with each
sample, and their sums over all samples choose σ without any association.

Reports that come more often than every 0.15 s are averaged to one sample: their errors are nearly one and the same, and
a vehicle cannot turn or brake in between. So evidence counts by time and not by report.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, fields, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.plane import squared_magnitude, to_complex, to_east_north
from assoc.records import VehicleReports

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex128]

WHITE_STD_M = np.array([0.03, 0.06, 0.1, 0.18, 0.32, 0.51, 0.81, 1.2, 2.0, 3.0, 4.5, 7.0])
"""(G,) candidates of the noise of a sample about its vehicle's motion, metres: RTK to coarse coordinates."""

_SMOOTHED_INDEX = 4
"""Index in ``WHITE_STD_M`` of the least noise, 0.32 m, that is assumed of trackers that smooth."""
_ACCELERATION_PSD = 1.0
"""Power spectral density of the null model's white acceleration, m²/s³."""
_SPEED_STD_MPS = 5.0
"""Prior 1σ of a vehicle's speed per axis, m/s."""
_SAME_TIME_S = 1e-4
"""A report that is newer than the last one by no more than this, seconds, is the same or an older one."""
_STANDING_REPEAT_S = 1.0
"""A standing vehicle's repeated position counts again after this, seconds."""
_KEPT_WINDOWS = 1.2
"""Reports are kept for this many times the window."""
_LOG_NULL_MIN = -12.0
"""Floor of one sample's null likelihood, so that one jump does not decide everything."""
_JUMP_NIS = 36.0
"""Normalised innovation squared above which a report has jumped: 6 σ."""
_ASIDE_NIS = 16.0
"""A report beyond 4 σ is an outlier if the next one is back within 4 σ of where it would be without it."""
_STANDING_MPS = 0.3
"""Speed below which a vehicle may report the same position twice, m/s."""
_UNCERTAIN_M = 30.0
"""A report whose vehicle states a larger 1σ than this, metres, fits any box in view and is not compared."""
_FORGET_S = 60.0
"""Time constant of the exponential forgetting of the likelihoods that choose σ, seconds."""
_PARTS = 500
"""New samples are appended as separate parts; beyond this number the parts are concatenated."""
_STANDS_MPS = 0.5
"""Speed up to which a vehicle may as well stand, m/s."""
_PAST_S = 0.3
"""A place longer ago than this is interpolated, seconds: a vehicle that turned did not come as it drives now."""
_LONG_S = 1e6
"""No flight is as long, seconds."""
_STEP_S = 0.15
"""Reports of one vehicle within this time, seconds, are one sample."""
_WHITE_VAR = WHITE_STD_M**2
"""(G,) m²."""
_LOG_WHITE_VAR = np.log(_WHITE_VAR)
_FRESH_COV = np.stack([_WHITE_VAR, np.zeros_like(_WHITE_VAR), np.full_like(_WHITE_VAR, _SPEED_STD_MPS**2)], axis=1)
"""(G, 3) covariance pp, pv, vv after a vehicle's first report."""
_LOG_PRIOR_STD = -0.5 * (np.log(WHITE_STD_M / 0.4) / 1.0) ** 2
"""(G,) log prior of the candidates: log-normal about 0.4 m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Averaged reports, sorted by vehicle, then time."""

    t: FloatArray
    """(S,) mean time of the reports, seconds."""
    vehicle: IntArray
    """(S,) index."""
    p: FloatArray
    """(S, 2) their mean place, east and north, metres."""
    heading: FloatArray
    """(S,) of the newest, clockwise from north, NaN unknown."""
    log_null: FloatArray
    """(S, G) ln density of the sample under the vehicle's own past, for each candidate noise."""
    jump_var: FloatArray
    """(S,) or (S, G) squared innovation, m², of a sample that jumped further than motion and noise explain; else 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _NullState:
    """Null models of k vehicles under each of G candidates."""

    place: ComplexArray
    """(k, G) east + i north, metres."""
    speed: ComplexArray
    """(k, G) m/s."""
    cov: FloatArray
    """(k, G, 3) pp, pv, vv: the axes share one covariance."""
    t: FloatArray
    """(k, G) of when, seconds."""


@dataclass(frozen=True, slots=True)
class _Past:
    """Null models of n vehicles after all samples up to one of each vehicle's."""

    state: _NullState
    """State after the newest sample."""
    earlier: _NullState
    """State before that sample, where it is far aside; else the time is NaN."""
    score: FloatArray
    """(n, G) ln likelihood of the candidates."""
    t: FloatArray
    """(n,) time of that sample, seconds, NaN none."""


_OF_VEHICLES = (
    *("last_t", "last_p", "last_v", "last_heading", "first_t", "frozen", "too_uncertain", "rejected_since"),
    *("_open_count", "_open_since", "_unfiltered", "_speedless"),
)
"""Attributes of a log with a row for each vehicle."""


class _Report(NamedTuple):
    """One report of a vehicle."""

    t: float
    """Seconds."""
    p: list[float]
    """East and north, metres."""
    v: list[float]
    """Velocity to east and north, m/s; NaN unknown."""
    heading: float
    std_m: float


class ReportLog:
    """Accepted reports of n vehicles and the state of their null model."""

    def __init__(self, n: int, window_s: float) -> None:
        self.n_vehicles = n
        self._window_s = window_s
        self._closed = [_samples_of(0)]
        """Samples to which nothing is added any more, in the order of arrival."""
        self._open = _samples_of(n)
        """The newest sample of each vehicle; NaN times where there is none."""
        self._open_count = np.zeros(n)
        """(n,) reports in it."""
        self._open_since = np.full(n, -np.inf)
        """(n,) time of its first report, seconds."""
        self._unfiltered: BoolArray = np.zeros(n, np.bool_)
        """(n,) whether reports were added to it that the null model does not have yet."""
        self._speedless: BoolArray = np.zeros(n, np.bool_)
        """(n,) whether the newest report had no velocity."""
        self._whole: Samples | None = None
        """Both together, until a report comes."""
        self.last_t = np.full(n, -np.inf)
        """(n,) time of the newest accepted report, seconds."""
        self.last_p = np.full((n, 2), np.nan)
        """(n, 2) its east and north, metres."""
        self.last_v = np.full((n, 2), np.nan)
        """(n, 2) velocity, as reported or else as filtered."""
        self.last_heading = np.full(n, np.nan)
        """(n,) its heading, clockwise from north, NaN unknown."""
        self.first_t = np.full(n, np.inf)
        """(n,) time of the first accepted report, seconds."""
        self.frozen: BoolArray = np.zeros(n, np.bool_)
        """(n,) the newest position was an exact repeat of a moving vehicle's."""
        self.too_uncertain: BoolArray = np.zeros(n, np.bool_)
        """(n,) the newest report was too uncertain for a comparison, by the 1σ that the vehicle states."""
        self.rejected_since = np.full(n, np.inf)
        """(n,) time, seconds, from which a vehicle's reports are rejected because they give another vehicle's place."""
        self._before, self._now = _no_past(n), _no_past(n)
        """Samples without and with the newest one."""
        self._outliers: dict[tuple[int, float], BoolArray] = {}
        """(G,) for which candidates a sample, by vehicle and time, is an outlier."""
        self._smoothed = False
        """True if the reports are smoother than they are precise."""
        self.white_index: int
        """Index in ``WHITE_STD_M`` of the samples' noise."""
        self._learn_noise()

    def _learn_noise(self) -> None:
        """Choose the noise nearest to the mean variance of the samples' noise, given all of them: √E[σ²].

        Few reports determine σ poorly, and a value that is too small makes the first names too certain.
        """
        log_p = self._now.score.sum(axis=0) + _LOG_PRIOR_STD
        p = np.exp(log_p - log_p.max())
        nearest = int(np.abs(_LOG_WHITE_VAR - np.log(p @ _WHITE_VAR / p.sum())).argmin())
        self.white_index = max(nearest, _SMOOTHED_INDEX) if self._smoothed else nearest

    def take_for_smoothed(self) -> None:
        """Hold reports to be no more precise than 0.32 m from now on, however smooth they are.

        Trackers that smooth are behind in every turn: what their own past foresees so well no box confirms, and every
        right pair would lose by it.
        """
        self._smoothed = True
        self._learn_noise()

    @property
    def white_std_m(self) -> float:
        """1σ of the samples' noise that is used now, metres."""
        return float(WHITE_STD_M[self.white_index])

    def add(self, t: FloatArray, reports: VehicleReports) -> None:
        """Accept reports.

        Args:
            t: (k,) sample times in the identifier's seconds.
            reports: The reports; those not finite, older or repeated are left out.
        """
        order = np.argsort(t, kind="stable")
        columns = (t, reports.p_enu[:, :2], reports.v_enu[:, :2], reports.heading, reports.std_m)
        rows = zip(*(column[order].tolist() for column in columns), strict=True)
        by_vehicle: dict[int, list[_Report]] = {}
        for vehicle, row in zip(reports.vehicle[order].tolist(), rows, strict=True):
            by_vehicle.setdefault(vehicle, []).append(_Report(*row))
        # the filters of all vehicles run together: of each its next sample that ends
        accepting = [self._accept(vehicle, its) for vehicle, its in by_vehicle.items()]
        while ending := [vehicle for each in accepting for vehicle in islice(each, 1)]:
            self._close(np.array(ending))
        self._filter_newest(np.flatnonzero(self._unfiltered))
        if len(self._closed) > _PARTS:
            self._join_closed()

    def samples(self, start: float, stop: float) -> Samples:
        """Samples with start ≤ t < stop, seconds, by vehicle and time, without outliers and those that are rejected."""
        kept, white = self._all(), self.white_index
        wanted = (kept.t >= start) & (kept.t < np.minimum(stop, self.rejected_since[kept.vehicle]))
        for (vehicle, t), found in self._outliers.items():
            if found[white]:
                wanted &= (kept.vehicle != vehicle) | (kept.t != t)
        inside = np.flatnonzero(wanted)
        inside = inside[np.lexsort((kept.t[inside], kept.vehicle[inside]))]
        chosen = _taken(kept, inside)
        return replace(chosen, jump_var=chosen.jump_var[:, white])

    def extrapolated(self, t: float, longest_s: float = 3.0) -> tuple[FloatArray, FloatArray]:
        """Positions at a time: between reports if it has long been reported, else extrapolated from the newest one.

        Args:
            t: Wanted time, seconds.
            longest_s: Beyond this age the position is not moved further.

        Returns:
            (n, 2) positions, metres, NaN where no report was received; (n,) ages, seconds, inf likewise and where the
            reports are rejected or too uncertain.
        """
        age = t - self.last_t
        step = np.clip(age, -longest_s, longest_s)
        step[~np.isfinite(step)] = 0.0
        p = self.last_p + np.where(np.isfinite(self.last_v), self.last_v, 0.0) * step[:, None]
        if len(past := np.flatnonzero(age < -_PAST_S)):
            between, known = self._interpolated(t, past)
            p[past[known]] = between[known]
        return p, np.where(np.isfinite(self.rejected_since) | self.too_uncertain, np.inf, age)

    def _interpolated(self, t: float, vehicle: IntArray) -> tuple[FloatArray, BoolArray]:
        """Places (k, 2) of some vehicles at a time, metres, between two samples, and which have two."""
        kept = self._all()
        if not len(kept.t):
            return np.zeros((len(vehicle), 2)), np.zeros(len(vehicle), np.bool_)
        order = np.lexsort((kept.t, kept.vehicle))
        near = kept.vehicle[order] + (kept.t[order] - t) / _LONG_S
        after = np.minimum(np.searchsorted(near, vehicle), len(order) - 1)
        before = np.maximum(after - 1, 0)
        a, b = order[before], order[after]
        known = (kept.vehicle[a] == vehicle) & (kept.vehicle[b] == vehicle) & (kept.t[a] <= t) & (t <= kept.t[b])
        share = ((t - kept.t[a]) / np.maximum(kept.t[b] - kept.t[a], _SAME_TIME_S))[:, None]
        return (1.0 - share) * kept.p[a] + share * kept.p[b], np.asarray(known)

    @property
    def moves(self) -> BoolArray:
        """(n,) True for vehicles that drive, or of which nobody knows that they stand."""
        return np.asarray(~(np.hypot(*self.last_v.T) <= _STANDS_MPS))

    @property
    def believed_t(self) -> FloatArray:
        """(n,) time of each vehicle's last report that is believed, seconds: what was compared later tells nothing."""
        return np.asarray(np.minimum(self.last_t, self.rejected_since))

    def begun_anew(self) -> ReportLog:
        """A log without samples that knows where the vehicles reported to be last."""
        anew = ReportLog(self.n_vehicles, self._window_s)
        for name in ("last_t", "last_p", "last_v", "last_heading", "first_t", "frozen", "too_uncertain"):
            setattr(anew, name, getattr(self, name).copy())
        anew._smoothed = self._smoothed
        return anew

    def of_vehicles(self, rows: IntArray) -> ReportLog:
        """The log of another fleet.

        Args:
            rows: (m,) the index that each of its vehicles has here, −1 of one that nothing was reported of.
        """
        anew = ReportLog(len(rows), self._window_s)
        to = np.flatnonzero(rows >= 0)
        by = rows[to]
        for name in _OF_VEHICLES:
            getattr(anew, name)[to] = getattr(self, name)[by]
        for past, before in ((anew._before, self._before), (anew._now, self._now)):
            _set_rows(past.state, to, _rows(before.state, by))
            _set_rows(past.earlier, to, _rows(before.earlier, by))
            past.score[to], past.t[to] = before.score[by], before.t[by]
        anew._smoothed = self._smoothed
        anew._learn_noise()
        for each in fields(Samples):
            getattr(anew._open, each.name)[to] = getattr(self._open, each.name)[by]
        anew._open.vehicle[:] = np.arange(len(rows))
        self._join_closed()
        index = np.full(self.n_vehicles, -1)
        index[by] = to
        kept = _taken(self._closed[0], np.flatnonzero(index[self._closed[0].vehicle] >= 0))
        anew._closed = [replace(kept, vehicle=index[kept.vehicle])]
        outliers = ((int(index[vehicle]), t, found) for (vehicle, t), found in self._outliers.items())
        anew._outliers = {(vehicle, t): found for vehicle, t, found in outliers if vehicle >= 0}
        return anew

    def turned(self, centre: FloatArray, angle: FloatArray) -> ReportLog:
        """A copy in which each vehicle's reports are turned about one place by an angle of their own.

        Their densities under the vehicle's own past stay, as these do not depend on direction.

        Args:
            centre: (2,) east and north, metres.
            angle: (n,) clockwise, radians.
        """

        def around(p: FloatArray, vehicle: IntArray) -> FloatArray:
            # clockwise: multiplied by e^(−iφ)
            return to_east_north((to_complex(p) - to_complex(centre)) * np.exp(-1j * angle[vehicle])) + centre

        other, kept, every = copy(self), self._all(), np.arange(self.n_vehicles)
        other._whole = replace(kept, p=around(kept.p, kept.vehicle), heading=kept.heading + angle[kept.vehicle])
        other.last_p = around(self.last_p, every)
        other.last_v = around(self.last_v + centre, every) - centre
        return other

    def later(self, seconds: float) -> ReportLog:
        """A copy in which all was reported this many seconds later."""
        other, kept = copy(self), self._all()
        other._whole = replace(kept, t=kept.t + seconds)
        other._outliers = {(vehicle, t + seconds): found for (vehicle, t), found in self._outliers.items()}
        other.last_t, other.first_t = self.last_t + seconds, self.first_t + seconds
        return other

    def _accept(self, vehicle: int, reports: list[_Report]) -> Iterator[int]:
        """Accept reports of one vehicle in order of time; gives it before each that begins another sample."""
        for report in reports:
            if not self._is_news(vehicle, report):
                continue
            self._whole = None
            if not report.t < self._open_since[vehicle] + _STEP_S:
                yield vehicle
                self._open_since[vehicle], self._open_count[vehicle] = report.t, 0.0
            self._average(vehicle, report)
            known = math.isfinite(report.v[0]) and math.isfinite(report.v[1])
            if known:
                self.last_v[vehicle] = report.v
            self._speedless[vehicle] = not known
            self.last_t[vehicle], self.last_p[vehicle] = report.t, report.p
            self.last_heading[vehicle] = report.heading
            self.first_t[vehicle] = min(self.first_t[vehicle], report.t)

    def _is_news(self, vehicle: int, report: _Report) -> bool:
        """Tell whether a report is a place that is newer, certain enough and no repetition."""
        repeated = self._repeats(vehicle, report)
        east, north = report.p
        if not (math.isfinite(east) and math.isfinite(north) and report.t > self.last_t[vehicle] + _SAME_TIME_S):
            return False
        uncertain = self.too_uncertain[vehicle] = report.std_m > _UNCERTAIN_M
        return not (uncertain or repeated)

    def _average(self, vehicle: int, report: _Report) -> None:
        """Add a report to the newest sample of its vehicle."""
        sample, k = self._open, float(self._open_count[vehicle]) + 1.0
        t, p = report.t, report.p
        if k > 1.0:
            # m_k = m_{k−1} + (x_k − m_{k−1})/k
            before, at = float(sample.t[vehicle]), sample.p[vehicle].tolist()
            t, p = before + (t - before) / k, [m + (x - m) / k for m, x in zip(at, p, strict=True)]
        sample.t[vehicle], sample.p[vehicle], sample.heading[vehicle] = t, p, report.heading
        self._open_count[vehicle], self._unfiltered[vehicle] = k, True

    def _filter_newest(self, vehicle: IntArray) -> None:
        """Take the newest samples of some vehicles, to which reports were added, into the null model."""
        if len(vehicle):
            sample = self._open
            found = self._filter(vehicle, sample.t[vehicle], sample.p[vehicle])
            sample.log_null[vehicle], sample.jump_var[vehicle] = found
            self._unfiltered[vehicle] = False
            self._learn_noise()
            unknown = vehicle[self._speedless[vehicle]]
            if len(unknown):
                self.last_v[unknown] = to_east_north(self._now.state.speed[unknown, self.white_index])

    def _close(self, vehicle: IntArray) -> None:
        """Close the newest samples of some vehicles: nothing is added to them any more."""
        some = vehicle[np.isfinite(self._open.t[vehicle])]
        if not len(some):
            return
        self._filter_newest(some[self._unfiltered[some]])
        self._closed.append(_taken(self._open, some))
        for now, before in ((self._now.state, self._before.state), (self._now.earlier, self._before.earlier)):
            _set_rows(before, some, _rows(now, some))
        self._before.score[some], self._before.t[some] = self._now.score[some], self._now.t[some]

    def _repeats(self, vehicle: int, report: _Report) -> bool:
        """A repetition that tells nothing: of a moving vehicle (frozen), or within a second of a standing one."""
        if report.p != self.last_p[vehicle].tolist():
            self.frozen[vehicle] = False
            return False
        # no speed known: not moving
        moves = math.hypot(*report.v) > _STANDING_MPS or math.hypot(*self.last_v[vehicle].tolist()) > _STANDING_MPS
        self.frozen[vehicle] |= moves
        return bool(self.frozen[vehicle] or report.t - self.last_t[vehicle] < _STANDING_REPEAT_S)

    def _filter(self, vehicle: IntArray, t: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Step of the null model to the newest samples: (k, G) ln densities and squared jumps, 0 for a first one."""
        last_t, at = self._before.t[vehicle], to_complex(p)[:, None]
        fresh: BoolArray = np.asarray(~np.isfinite(last_t))
        before = _rows(self._before.state, vehicle)
        before = replace(before, t=np.where(fresh[:, None], t[:, None], before.t))
        back = self._find_outliers(vehicle, t, at)
        if back.any():
            before = _chosen(back, _rows(self._before.earlier, vehicle), before)
        expected = _moved(before, t)
        predicted, speed, cov = expected.place, expected.speed, expected.cov
        pp, pv, vv = cov[..., 0], cov[..., 1], cov[..., 2]
        e, s = at - predicted, pp + _WHITE_VAR
        e2 = squared_magnitude(e)
        # ln N(e; 0, s I₂) = −ln 2πs − |e|²/2s
        log_density = np.maximum(-np.log(2 * np.pi * s) - e2 / (2 * s), _LOG_NULL_MIN)
        gain_p, gain_v = pp / s, pv / s
        place, speed = predicted + gain_p * e, speed + gain_v * e
        cov = np.stack([pp - gain_p * pp, pv - gain_p * pv, vv - gain_v * pv], axis=2)
        if fresh.any():
            place[fresh], speed[fresh], cov[fresh], log_density[fresh] = at[fresh], 0.0, _FRESH_COV, 0.0
        _set_rows(self._now.state, vehicle, _NullState(place=place, speed=speed, cov=cov, t=expected.t))
        passed_s = np.where(fresh, 0.0, t - last_t)[:, None]
        self._now.score[vehicle] = self._before.score[vehicle] * np.exp(-passed_s / _FORGET_S) + log_density
        self._now.t[vehicle] = t
        jump = np.where((e2 > _JUMP_NIS * s) & ~fresh[:, None], e2, 0.0)
        aside = (e2 > _ASIDE_NIS * s) & ~fresh[:, None]
        _set_rows(self._now.earlier, vehicle, replace(before, t=np.where(aside, before.t, np.nan)))
        # a jump is as likely for the unrelated as for a pair: the same widening by e²
        log_density = np.where(jump > 0.0, -np.log(2 * np.pi * (s + e2)) - 0.5, log_density)
        return np.asarray(log_density), jump

    def _find_outliers(self, vehicle: IntArray, t: FloatArray, at: ComplexArray) -> BoolArray:
        """(k, G) whether the sample before this one was an outlier: it was aside, and this one is back."""
        earlier = _rows(self._before.earlier, vehicle)
        if not np.isfinite(earlier.t).any():
            return np.zeros(earlier.t.shape, np.bool_)
        expected = _moved(earlier, t)
        back = np.asarray(squared_magnitude(at - expected.place) < _ASIDE_NIS * (expected.cov[..., 0] + _WHITE_VAR))
        for row in np.flatnonzero(np.isfinite(earlier.t).any(axis=1)).tolist():
            self._outliers[int(vehicle[row]), float(self._before.t[vehicle[row]])] = back[row]
        return back

    def _all(self) -> Samples:
        """All samples of the window."""
        if self._whole is None:
            self._join_closed()
            newest = _taken(self._open, np.flatnonzero(np.isfinite(self._open.t)))
            self._whole = _concatenated([self._closed[0], newest])
        return self._whole

    def _join_closed(self) -> None:
        """Concatenate what nothing is added to any more; older samples are dropped."""
        if len(self._closed) > 1:
            whole = _concatenated(self._closed)
            start = np.max(whole.t) - _KEPT_WINDOWS * self._window_s
            self._outliers = {key: found for key, found in self._outliers.items() if key[1] >= start}
            self._closed = [_taken(whole, np.flatnonzero(whole.t >= start))]


def _samples_of(n: int) -> Samples:
    """Samples of n vehicles that nothing was reported of."""
    none = np.full((n, len(WHITE_STD_M)), np.nan)
    return Samples(
        t=np.full(n, np.nan),
        vehicle=np.arange(n),
        p=np.full((n, 2), np.nan),
        heading=np.full(n, np.nan),
        log_null=none,
        jump_var=none.copy(),
    )


def _concatenated(parts: list[Samples]) -> Samples:
    return Samples(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Samples)})


def _taken(samples: Samples, rows: IntArray) -> Samples:
    return Samples(**{f.name: getattr(samples, f.name)[rows] for f in fields(Samples)})


def _no_past(n: int) -> _Past:
    shape = n, len(WHITE_STD_M)
    return _Past(_unknown_state(shape), _unknown_state(shape), np.zeros(shape), np.full(n, np.nan))


def _unknown_state(shape: tuple[int, int]) -> _NullState:
    place = np.zeros(shape, np.complex128)
    return _NullState(place=place, speed=place.copy(), cov=np.zeros((*shape, 3)), t=np.full(shape, np.nan))


def _rows(state: _NullState, rows: IntArray) -> _NullState:
    return _NullState(place=state.place[rows], speed=state.speed[rows], cov=state.cov[rows], t=state.t[rows])


def _set_rows(state: _NullState, rows: IntArray, new: _NullState) -> None:
    state.place[rows], state.speed[rows], state.cov[rows], state.t[rows] = new.place, new.speed, new.cov, new.t


def _chosen(which: BoolArray, yes: _NullState, no: _NullState) -> _NullState:
    return _NullState(
        place=np.where(which, yes.place, no.place),
        speed=np.where(which, yes.speed, no.speed),
        cov=np.where(which[..., None], yes.cov, no.cov),
        t=np.where(which, yes.t, no.t),
    )


def _moved(state: _NullState, t: FloatArray) -> _NullState:
    """The state (k, G) moved on to times (k,), seconds.

    x⁻ = x + v dt;  P⁻ = F P Fᵀ + q [dt³/3, dt²/2; dt²/2, dt]
    """
    dt, cov = t[:, None] - state.t, state.cov
    pp = cov[..., 0] + 2 * dt * cov[..., 1] + dt**2 * cov[..., 2] + _ACCELERATION_PSD * dt**3 / 3
    pv = cov[..., 1] + dt * cov[..., 2] + _ACCELERATION_PSD * dt**2 / 2
    cov = np.stack([pp, pv, cov[..., 2] + _ACCELERATION_PSD * dt], axis=-1)
    return _NullState(place=state.place + state.speed * dt, speed=state.speed, cov=cov, t=state.t + dt)
