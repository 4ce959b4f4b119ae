"""Which offset of the fleet's clock fits the film, and whether it can be relied on.

Offsets worth a closer look are fitted one by one, and about the best one others are held fixed, so that it is seen how
wide it is. An offset is found where it explains the film far better than an unrelated fleet would and than any other
offset that is more than its own width away. Among the hundreds of offsets that are compared, those that fit by chance
reach well over half of one another's evidence, the right one lets others reach a third; where the right one is not
within the bounds, the best is one of many such.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from assoc.clock_search.coarse import coarse_starts
from assoc.clock_search.fine import OffsetFit, fit_at
from assoc.clock_search.inputs import CameraPath, FleetLog
from assoc.history import TrackHistory

__all__ = ["ClockSearch", "ClockVerdict", "find_clock"]

_STARTS, _LEAST_STARTS, _START_SHARE = 30, 10, 0.5
"""Most offsets that are fitted; and fewer where the rough score of the rest is less than a share of the best."""
_WIDTH_S = 0.8
"""Offsets within it are one: the identifier finds the rest."""
_BESIDE_S = (1.0, 1.6, 2.5)
"""Offsets to both sides of the best at which its width is seen."""
_LEAST = 45.0
"""Evidence, nats, that no unrelated fleet reaches but for a few in a hundred."""
_SHARE, _MOST_SHARE = 0.35, 0.8
"""Share of the best evidence by which it must surpass the runner-up's, and the most where little is explained ..."""
_MARGIN = 25.0
"""... and how much at least, nats."""
_UNKNOWN_SHARE = 0.5
"""Of what should be seen, where that is not known."""
_WELL_EXPLAINED = 0.85
"""The right offset usually explains at least this share of what should be seen, by a nat for each second."""
_BESIDE_MARGIN = 20.0
"""The same for offsets beside it, which share its errors."""
_LEAST_SEEN = 0.4
"""Share of the time in which vehicles should be well inside the picture that they must be matched."""
_LARGEST_STD_S = 0.2


class ClockVerdict(Enum):
    """What came of a search."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    """The runner-up is nearly as good."""
    UNRELATED = "unrelated"
    """No offset fits better than an unrelated fleet would."""
    NO_OVERLAP = "no overlap"
    """Within the bounds no report of the fleet is of the film's time, or nothing was seen for long enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSearch:
    """The best offset and what speaks for and against it."""

    verdict: ClockVerdict
    best: OffsetFit | None
    runner_up: OffsetFit | None
    """Of those that are more than the width of the best away, the one that comes nearest to what none may reach."""
    tried: int
    """Offsets that were fitted."""


def find_clock(
    tracks: TrackHistory, path: CameraPath, log: FleetLog, bounds_s: tuple[float, float], *, camera_too: bool = False
) -> ClockSearch:
    """Find δ with which the fleet's log, p(t + δ), fits the film.

    Args:
        tracks: The film, by :func:`~assoc.clock_search.inputs.film_tracks`.
        path: The camera's.
        log: The fleet's.
        bounds_s: Least and largest δ, seconds.
        camera_too: The camera's path is on the fleet's clock; else on the film's.
    """
    starts = coarse_starts(tracks, path, log, bounds_s, camera_too=camera_too, most=_STARTS)
    most = starts[0].score if starts else 0.0
    starts = [start for k, start in enumerate(starts) if k < _LEAST_STARTS or start.score >= _START_SHARE * most]
    fitted = [fit_at(tracks, path, log, start.offset_s, start.yaw, camera_too=camera_too) for start in starts]
    low, high = bounds_s
    fits = [fit for fit in fitted if fit is not None and fit.pairs and low <= fit.offset_s <= high]
    if not fits:
        return ClockSearch(verdict=ClockVerdict.NO_OVERLAP, best=None, runner_up=None, tried=len(starts))
    best = max(fits, key=lambda fit: fit.evidence)
    beside = [
        fit_at(tracks, path, log, best.offset_s + step, best.yaw, camera_too=camera_too, free=False)
        for each in _BESIDE_S
        for step in (-each, each)
    ]
    fits += [fit for fit in beside if fit is not None]
    rivals = [fit for fit in fits if _distance_s(fit, best) > _WIDTH_S]
    runner_up = max(rivals, key=lambda fit: fit.evidence - _allowed(best, fit), default=None)
    return ClockSearch(verdict=_verdict(best, runner_up), best=best, runner_up=runner_up, tried=len(starts))


def _distance_s(fit: OffsetFit, other: OffsetFit) -> float:
    return abs(fit.offset_s - other.offset_s)


def _allowed(best: OffsetFit, rival: OffsetFit) -> float:
    """Evidence that a rival of the best may have, nats."""
    near = _distance_s(best, rival) <= max(_BESIDE_S) + _WIDTH_S
    if near:
        return best.evidence - _BESIDE_MARGIN
    seen_share = best.seen_share if np.isfinite(best.seen_share) else _UNKNOWN_SHARE
    explained = seen_share * min(best.evidence / max(best.matched_s, 1.0), 1.0)
    share = min(_SHARE + max(_WELL_EXPLAINED - explained, 0.0), _MOST_SHARE)
    return best.evidence - max(_MARGIN, share * best.evidence)


def _verdict(best: OffsetFit, runner_up: OffsetFit | None) -> ClockVerdict:
    if best.evidence < _LEAST or best.seen_share < _LEAST_SEEN:
        return ClockVerdict.UNRELATED
    if best.std_s > _LARGEST_STD_S:
        return ClockVerdict.AMBIGUOUS
    if runner_up is not None and runner_up.evidence > _allowed(best, runner_up):
        return ClockVerdict.AMBIGUOUS
    return ClockVerdict.FOUND
