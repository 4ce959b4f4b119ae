"""The views of one flight's cameras, folded side by side in time, each taking in what the others learnt."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from gcs.snapshot import Snapshot

if TYPE_CHECKING:
    from gcs.playback.analysis import Analysis

Moments = Iterator[tuple[int, Snapshot]]


def side_by_side(analyses: Sequence[Analysis], moments: Sequence[Moments], wanted: int) -> list[Moments]:
    """The same moments of the first analyses, whichever of them is asked for first.

    Always the view that is furthest behind goes on, so that names do not depend on who asks for which of them.

    Args:
        analyses: of the same flight, one a camera.
        moments: of each alone, with their times on the recording's time line, in order, not begun yet.
        wanted: how many analyses are asked for; the others are folded beside them.
    """
    steps = _FoldSteps(analyses, moments, wanted)
    return [steps.of(view) for view in range(wanted)]


class _FoldSteps:
    def __init__(self, analyses: Sequence[Analysis], moments: Sequence[Moments], wanted: int) -> None:
        self._analyses, self._moments = analyses, moments
        self._waiting = [deque[tuple[int, Snapshot]](maxlen=None if k < wanted else 0) for k in range(len(analyses))]
        self._reached = {view: (0, analysis.mission.uav.system_id) for view, analysis in enumerate(analyses)}
        """Time, and an id for views that are at the same, of those that go on."""

    def of(self, view: int) -> Moments:
        """The moments of one view."""
        while self._waiting[view] or view in self._reached:
            if self._waiting[view]:
                yield self._waiting[view].popleft()
            else:
                self._step()

    def _step(self) -> None:
        view = min(self._reached, key=lambda view: self._reached[view])
        analysis = self._analyses[view]
        analysis.hear(other for other in self._analyses if other is not analysis)
        moment = next(self._moments[view], None)
        if moment is None:
            del self._reached[view]
        else:
            self._reached[view] = moment[0], self._reached[view][1]
            self._waiting[view].append(moment)
