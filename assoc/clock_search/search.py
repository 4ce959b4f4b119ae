"""Offset of the fleet's clock that fits the film, and whether it can be relied on.

Offsets worth a closer look are fitted one by one, and about the best one others are held fixed, so that it is seen how
wide it is. An offset is found where it explains the film far better than an unrelated fleet would and than any other
offset that is more than its own width away. Among the hundreds of offsets that are compared, those that fit by chance
reach well over half of one another's evidence, the right one lets others reach a third; where the right one is not
within the bounds, the best is one of many such.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from assoc.clock_search.coarse import coarse_starts
from assoc.clock_search.fine import OffsetFit, fit_at
from assoc.clock_search.inputs import CameraPath, FleetLog
from assoc.history import TrackHistory

_STARTS, _MIN_STARTS, _START_SHARE = 30, 10, 0.5
"""Most offsets that are fitted; and fewer where the rough score of the rest is less than a share of the best."""
_WIDTH_S = 1.0
"""Offsets within it are one: the identifier finds the rest."""
_ABOUT_S, _BESIDE_S = (-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2), (-2.5, -1.6, 1.6, 2.5)
"""Offsets about the best at which it is held fixed: those by which it is smoothed, and others that it must surpass."""
_MIN_EVIDENCE = 45.0
"""Evidence, nats, that no unrelated fleet reaches but for a few in a hundred."""
_SHARE, _FEW_SHARE, _MAX_SHARE = 0.3, 0.5, 0.8
"""Share of the best evidence by which it must surpass the runner-up's, what is added for a single vehicle, half of it
for two, and the most where little is explained."""
_MARGIN = 25.0
"""Least advantage of the best evidence over the runner-up's, nats."""
_BESIDE_MARGIN = 10.0
"""Least margin over offsets beside it, nats, which share its errors; how wide it is tells its 1σ."""
_UNKNOWN_SHARE = 0.7
"""Share of what should be seen, where that is not known."""
_WELL_EXPLAINED = 0.85
"""The right offset usually explains at least this share of what should be seen, by a nat for each second."""
_MIN_EXPLAINED = 0.5
"""An offset that explains less is a chance fit, whatever the others do."""
_LASTING = 2.0
"""1σ of what is found against that of the parabola: errors of UAV and receivers last, and are counted as if they did
less."""
_LARGEST_STD_S, _LARGEST_MOVE_S = 0.32, 0.6
"""1σ of an offset that is reported, and by how much smoothing may move it, seconds."""


class ClockVerdict(Enum):
    """Outcome of a search."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    """The runner-up is nearly as good."""
    UNRELATED = "unrelated"
    """No offset fits better than an unrelated fleet would."""
    NO_OVERLAP = "no overlap"
    """No report of the fleet within the bounds is of the film's time, or nothing was seen for long enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockSearch:
    """The best offset and what speaks for and against it."""

    verdict: ClockVerdict
    best: OffsetFit | None
    runner_up: OffsetFit | None
    """Offset that comes closest to being as good as the best, among those farther away than its width."""
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
    starts = [start for k, start in enumerate(starts) if k < _MIN_STARTS or start.score >= _START_SHARE * most]
    fitted = [fit_at(tracks, path, log, start.offset_s, start.yaw, camera_too=camera_too) for start in starts]
    low, high = bounds_s
    fits = [fit for fit in fitted if fit is not None and fit.pairs and low <= fit.offset_s <= high]
    if not fits:
        return ClockSearch(verdict=ClockVerdict.NO_OVERLAP, best=None, runner_up=None, tried=len(starts))
    first = max(fits, key=lambda fit: fit.evidence)
    about, beside = (
        [
            fit_at(tracks, path, log, first.offset_s + step, first.yaw, camera_too=camera_too, free=False)
            for step in steps
        ]
        for steps in (_ABOUT_S, _BESIDE_S)
    )
    best = _smoothed(first, about)
    fits += [fit for fit in (*about, *beside) if fit is not None]
    rivals = [fit for fit in fits if _distance_s(fit, best) > _WIDTH_S]
    runner_up = max(rivals, key=lambda fit: fit.evidence - _allowed(best, fit), default=None)
    return ClockSearch(verdict=_verdict(best, runner_up), best=best, runner_up=runner_up, tried=len(starts))


def _smoothed(best: OffsetFit, about: Sequence[OffsetFit | None]) -> OffsetFit:
    """The best offset by a parabola through the evidence about it: assignments that change make it jagged.

    V(δ) ≈ a δ² + b δ + c:  δ* = −b/2a,  σ = 2/√(−2a)
    """
    known = [fit for fit in about if fit is not None]
    a, b = 0.0, 0.0
    if len(known) > 2:
        steps = np.array([fit.offset_s - best.offset_s for fit in known])
        a, b, _ = np.polyfit(steps, [fit.evidence for fit in known], 2).tolist()
    move_s = -b / (2.0 * a) if a < 0.0 else np.inf
    if abs(move_s) > _LARGEST_MOVE_S:
        return replace(best, std_s=np.inf)
    return replace(best, offset_s=best.offset_s + move_s, std_s=float(_LASTING / np.sqrt(-2.0 * a)))


def _distance_s(fit: OffsetFit, other: OffsetFit) -> float:
    return abs(fit.offset_s - other.offset_s)


def _allowed(best: OffsetFit, rival: OffsetFit) -> float:
    """Evidence that a rival of the best may have, nats."""
    near = _distance_s(best, rival) <= max(_BESIDE_S) + _LARGEST_MOVE_S
    if near:
        return best.evidence - _BESIDE_MARGIN
    few = _FEW_SHARE / max(best.vehicles, 1)
    share = min(_SHARE + few + max(_WELL_EXPLAINED - _explained(best), 0.0), _MAX_SHARE)
    return best.evidence - max(_MARGIN, share * best.evidence)


def _explained(best: OffsetFit) -> float:
    """Share of what should be seen that the best explains, by a nat for each second."""
    seen_share = best.seen_share if np.isfinite(best.seen_share) else _UNKNOWN_SHARE
    return seen_share * min(max(best.evidence, 0.0) / max(best.matched_s, 1.0), 1.0)


def _verdict(best: OffsetFit, runner_up: OffsetFit | None) -> ClockVerdict:
    if best.evidence < _MIN_EVIDENCE or _explained(best) < _MIN_EXPLAINED:
        return ClockVerdict.UNRELATED
    if best.std_s > _LARGEST_STD_S:
        return ClockVerdict.AMBIGUOUS
    if runner_up is not None and runner_up.evidence > _allowed(best, runner_up):
        return ClockVerdict.AMBIGUOUS
    return ClockVerdict.FOUND
