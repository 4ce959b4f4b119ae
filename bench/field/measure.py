"""Counts of one session, and sessions added up: shares of all boxes of a family, not means of sessions.

The words are those of :mod:`gcs.report.score`; beyond them: an appearance of a vehicle begins when it is first seen and
after every two seconds unseen; its time to identity is how long it is seen before a right name that then holds for a
second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from gcs.report.score import Matched, right_answers, score

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

AWAY_S, HOLD_S, MIN_S = 2.0, 1.0, 2.0
SURE = 0.9
EDGES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999])
"""Lower edges of the confidence bins; all from 0.9 on are one bin of the ECE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxCounts:
    """Counts of boxes unless stated otherwise."""

    frames: int
    ours: int
    false: int
    """Boxes of false targets, clutter included."""
    named: int
    right: int
    ours_named: int
    false_named: int
    strangers: int
    """Boxes said to be none of ours at confidence ≥ 0.9."""
    false_strangers: int
    """Boxes of ours among the strangers, those of vehicles that nothing can name included."""
    switches: int
    """Changes of a vehicle's name from one id to another."""
    swaps: int
    """Times a track went over from one target to another."""
    wrong_sure_s: float
    """Vehicle-seconds with a wrong name at confidence ≥ 0.9."""
    track_idf1: float
    bins: FloatArray = field(default_factory=lambda: np.zeros((len(EDGES), 3)))
    """(bins, 3) named boxes, sum of their confidence, how many are right."""
    all_bins: FloatArray = field(default_factory=lambda: np.zeros((len(EDGES), 3)))
    """The same of all boxes with an answer, "none of ours" among them, also of vehicles that nothing can name."""
    first_s: tuple[float, ...] = ()
    """Time to identity of first appearances, inf never."""
    again_s: tuple[float, ...] = ()
    """The same of later ones."""


def tally(m: Matched, fps: float, nameless: frozenset[int] = frozenset()) -> BoxCounts:
    """Count matched boxes; those that the log lacks, named −1, are none of false targets.

    Args:
        m: The boxes.
        fps: Frames per second.
        nameless: Vehicles that nothing can name: they count as none of ours, but a stranger is somebody else.
    """
    strangers = (m.named == 0) & (m.track > 0) & (m.confidence >= SURE)
    false_strangers = int((strangers & (m.truth > 0)).sum())
    answered = (m.named >= 0) & (m.track > 0)
    all_bins = _bins(m.confidence[answered], right_answers(m)[answered])
    m = _without_nameless(m, nameless)
    whole = score(m)
    ours, named = m.truth > 0, m.named > 0
    false = ~ours & (m.named >= 0)
    right = ours & (m.named == m.truth)
    first, again = _appearances(m, right, fps)
    return BoxCounts(
        frames=whole.frames,
        ours=int(ours.sum()),
        false=int(false.sum()),
        named=int(named.sum()),
        right=int(right.sum()),
        ours_named=int((ours & named).sum()),
        false_named=int((false & named).sum()),
        strangers=int(strangers.sum()),
        false_strangers=false_strangers,
        switches=whole.switches,
        swaps=_swaps(m),
        wrong_sure_s=float((named & ~right & (m.confidence >= SURE)).sum()) / fps,
        track_idf1=whole.track_idf1,
        bins=_bins(m.confidence[named], right[named]),
        all_bins=all_bins,
        first_s=first,
        again_s=again,
    )


def _without_nameless(m: Matched, nameless: frozenset[int]) -> Matched:
    """Matched boxes where vehicles that nothing can name count as none of ours.

    Boxes of theirs that are named rightly all the same are left out, any other name is one given to a false target.
    """
    unknowable = np.isin(m.truth, list(nameless))
    kept = ~(unknowable & (m.named == m.truth))
    parts = {field.name: getattr(m, field.name)[kept] for field in fields(m)}
    return Matched(**(parts | {"truth": np.where(unknowable, 0, m.truth)[kept]}))


def _swaps(m: Matched) -> int:
    total = 0
    for track in np.unique(m.track[(m.track > 0) & (m.truth >= 0)]):
        rows = np.flatnonzero((m.track == track) & (m.truth >= 0))
        total += int((np.diff(m.truth[rows[np.argsort(m.frame[rows], kind="stable")]]) != 0).sum())
    return total


def _bins(confidence: FloatArray, right: NDArray[np.bool_]) -> FloatArray:
    known = np.isfinite(confidence)
    place = np.searchsorted(EDGES, confidence[known], side="right") - 1
    columns = (np.ones(len(place)), confidence[known], right[known].astype(np.float64))
    return np.stack([np.bincount(place, weights=c, minlength=len(EDGES)) for c in columns], axis=-1)


def _appearances(m: Matched, right: NDArray[np.bool_], fps: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    first: list[float] = []
    again: list[float] = []
    for vehicle in np.unique(m.truth[m.truth > 0]):
        rows = np.flatnonzero(m.truth == vehicle)
        rows = rows[np.argsort(m.frame[rows], kind="stable")]
        times = delays(m.frame[rows] / fps, right[rows])
        first += [wait for k, wait in times if k == 0]
        again += [wait for k, wait in times if k > 0]
    return tuple(first), tuple(again)


def delays(t: FloatArray, right: NDArray[np.bool_]) -> list[tuple[int, float]]:
    """Times to identity of one vehicle.

    Args:
        t: (k,) seconds at which it is seen, increasing.
        right: (k,) whether its name is right.

    Returns:
        (number of the appearance, seconds until a right name that holds for a second, inf without) for each appearance
        of two seconds and more.
    """
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > AWAY_S) + 1)
    return [(k, _delay(t[part], right[part])) for k, part in enumerate(parts) if t[part[-1]] - t[part[0]] >= MIN_S]


def _delay(t: FloatArray, right: NDArray[np.bool_]) -> float:
    wrong = np.concatenate([t[~right], [np.inf]])
    # the next moment at which the name is not right
    until = wrong[np.searchsorted(wrong, t, side="left")]
    held = right & (until > t + HOLD_S) & (t + HOLD_S <= t[-1] + 1e-9)
    return float(t[np.argmax(held)] - t[0]) if held.any() else float("inf")


NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One session and what the product made of it."""

    family: int
    hard: bool
    seed: int
    label: str
    vehicles: int
    product: BoxCounts
    """Counts of the product's names as a screen would have shown them."""
    afterwards: BoxCounts
    """Counts of its names by hindsight, as ``gcs identify`` gives them."""
    wall_ms: FloatArray
    cpu_ms: FloatArray
    faulty: frozenset[int]
    """System ids of the vehicles whose telemetry goes wrong."""
    spoofed: frozenset[int]
    """System ids of the vehicle that spoofs and of the one it copies; empty without a spoof."""
    accused: frozenset[int]
    mismatch_s: float = math.inf
    """Seconds to the alarm that video and telemetry do not match."""

    @property
    def slandered(self) -> int:
        """Vehicles with an alarm that they contradict the video and nothing wrong in their telemetry."""
        return len(self.accused - self.faulty - self.spoofed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Several sessions. Shares in percent; NaN where there is nothing to take a share of."""

    sessions: int
    precision: float
    right: float
    coverage: float
    fper: float
    false_strangers: float
    """Boxes of ours among those called strangers at 0.9 or more, percent."""
    switches: int
    swaps: int
    idf1: float
    track_idf1: float
    """Mean over sessions."""
    ece: float
    ece_all: float
    """Expected calibration error of all answers, "none of ours" among them."""
    wrong_sure_s: float
    """Vehicle-seconds wrong at 0.9 or more, in all sessions."""
    wrong_sure_worst_s: float
    """The same in the worst session."""
    first_median_s: float
    first_p90_s: float
    again_median_s: float
    again_p90_s: float


def summarise(tallies: Sequence[BoxCounts]) -> Summary:
    """Add up."""
    total = {name: sum(int(getattr(t, name)) for t in tallies) for name in _COUNTS}
    first = [wait for t in tallies for wait in t.first_s]
    again = [wait for t in tallies for wait in t.again_s]
    sure = [t.wrong_sure_s for t in tallies]
    tracked = [t.track_idf1 for t in tallies if not math.isnan(t.track_idf1)]
    return Summary(
        sessions=len(tallies),
        precision=_percent(total["right"], total["named"]),
        right=_percent(total["right"], total["ours"]),
        coverage=_percent(total["ours_named"], total["ours"]),
        fper=_percent(total["false"] - total["false_named"], total["false"]),
        false_strangers=_percent(total["false_strangers"], total["strangers"]),
        switches=total["switches"],
        swaps=total["swaps"],
        # 2 IDTP / (2 IDTP + IDFP + IDFN)
        idf1=_percent(2 * total["right"], total["ours"] + total["named"]),
        track_idf1=100.0 * float(np.mean(tracked)) if tracked else NAN,
        ece=ece_of(np.sum([t.bins for t in tallies], axis=0)) if tallies else NAN,
        ece_all=ece_of(np.sum([t.all_bins for t in tallies], axis=0)) if tallies else NAN,
        wrong_sure_s=sum(sure),
        wrong_sure_worst_s=max(sure, default=0.0),
        first_median_s=percentile(first, 50.0),
        first_p90_s=percentile(first, 90.0),
        again_median_s=percentile(again, 50.0),
        again_p90_s=percentile(again, 90.0),
    )


_COUNTS = (
    *("ours", "named", "right", "ours_named", "false", "false_named", "strangers", "false_strangers"),
    *("switches", "swaps"),
)


def ece_of(bins: FloatArray) -> float:
    """Σ share · |mean confidence − share right| over ten bins; the fine ones above 0.9 are put together.

    Args:
        bins: (bins, 3) as :class:`~bench.field.measure.BoxCounts` has them.
    """
    tenth = np.minimum((EDGES * 10 + 1e-9).astype(np.int64), 9)
    ten = np.zeros((10, 3))
    np.add.at(ten, tenth, bins)
    total = float(ten[:, 0].sum())
    return float(np.abs(ten[:, 1] - ten[:, 2]).sum() / total) if total else NAN


def percentile(values: Iterable[float], percent: float) -> float:
    """The least value that this many percent do not exceed; inf counts as later than all others."""
    ranked = sorted(values)
    return ranked[max(0, math.ceil(percent / 100.0 * len(ranked)) - 1)] if ranked else NAN


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else NAN
