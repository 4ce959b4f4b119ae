"""Sessions added up: shares of all boxes of a family, not means of sessions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.field.measure import EDGES, BoxCounts

FloatArray = NDArray[np.float64]

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
    ours: int
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
    """In all sessions."""
    wrong_sure_worst_s: float
    """In the worst session."""
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
        ours=total["ours"],
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
