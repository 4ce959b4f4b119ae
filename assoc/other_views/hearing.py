"""The answers of one view with those of the others: hears what they tell of their tracks, frame by frame.

What is heard changes answers alone. Evidence, pose and all that is learnt stay the view's own, and it is this that it
tells the others in turn: nothing comes back to where it began, and nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from assoc.other_views.opinions import Hearsay, mixed, pooled, without_taken
from assoc.other_views.same_boxes import SameBoxes, newest_answers
from assoc.records import Sighting

FloatArray = NDArray[np.float64]


class Hearing:
    """What one view hears of the others, over time."""

    def __init__(self) -> None:
        self._same: dict[int, SameBoxes] = {}
        self._hearsay: dict[int, Hearsay] = {}

    def answers(self, mine: Sighting, told: Mapping[int, Sequence[Sighting]]) -> FloatArray:
        """What the tracks of a frame are by all that views know.

        Args:
            mine: By this view alone.
            told: The last frames of each other view that tells anything, in order, in this view's world and of its
                fleet.

        Returns:
            (m, n + 1) probabilities, the last column "none of ours".
        """
        answers, trusts = [mine.p], [np.full(len(mine.p), mine.fit)]
        for view, theirs in told.items():
            track_id, same = self._same.setdefault(view, SameBoxes()).update(mine, theirs)
            said = mixed(newest_answers(track_id, theirs), same)
            trust = np.minimum(np.sum(same, axis=1), 1.0) * theirs[-1].fit
            hearsay = self._hearsay.setdefault(view, Hearsay())
            said, trust = hearsay.update(1e-6 * mine.t_us, mine.track_id, said, trust)
            answers.append(said)
            trusts.append(trust)
        if not np.any(trusts[1:]):
            return mine.p
        return without_taken(mine.p, pooled(answers, trusts))
