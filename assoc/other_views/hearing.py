"""The answers of one view with those of the others: hears what they tell of their tracks, frame by frame.

What is heard changes answers alone. Evidence, pose and all that is learnt stay the view's own, and it is this that it
tells the others in turn: nothing comes back to where it began, and nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.other_views.opinions import Hearsay, founded, pooled, said_of, without_taken
from assoc.other_views.same_boxes import SameBoxes, newest_answers
from assoc.records import Sighting

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SURE = 0.8
"""Probability from which on two answers that differ are a contradiction."""
_MORE = 1.2
"""A view that knows so many times less is the likelier one to be wrong."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Two views are sure of one object, each of another answer."""

    mine: int
    """Column of this view's answer, n: none of ours."""
    theirs: int
    """Column of the other view's."""
    view: int
    """The other one."""
    wrong: int
    """The view that is likelier wrong: −1 this one, 1 the other one, 0 not known."""


class Hearing:
    """Words of the other views that one hears, over time."""

    def __init__(self) -> None:
        self._same: dict[int, SameBoxes] = {}
        self._hearsay: dict[int, Hearsay] = {}
        self.contradictions: tuple[Contradiction, ...] = ()
        """Contradictions of the views in the last frame."""
        self.pairs: Mapping[int, tuple[IntArray, FloatArray]] = {}
        """Tracks (k,) of each other view in the last frame, and the probability (m, k) of each pair to be one."""

    def answers(self, mine: Sighting, told: Mapping[int, Sequence[Sighting]]) -> FloatArray:
        """Answers on the tracks of a frame by all that views know.

        Args:
            mine: By this view alone.
            told: The last frames of each other view that tells anything, in order, in this view's world and of its
                fleet.

        Returns:
            (m, n + 1) probabilities, the last column "none of ours".
        """
        answers, same, fits = [mine.p], [np.ones(len(mine.p))], [mine.fit]
        contradictions, every = list[Contradiction](), dict[int, tuple[IntArray, FloatArray]]()
        for view, theirs in told.items():
            track_id, pairs = self._same.setdefault(view, SameBoxes()).update(mine, theirs)
            every[view] = track_id, pairs
            said, is_same = said_of(newest_answers(track_id, theirs), pairs)
            fit = theirs[-1].fit
            contradictions += _contradictions(view, mine, said, is_same, fit)
            hearsay = self._hearsay.setdefault(view, Hearsay())
            said, is_same = hearsay.update(1e-6 * mine.t_us, mine.track_id, said, is_same)
            answers.append(said)
            same.append(is_same)
            fits.append(fit)
        self.contradictions, self.pairs = tuple(contradictions), every
        return without_taken(mine.p, pooled(answers, same, fits))


def _contradictions(
    view: int, mine: Sighting, said: FloatArray, same: FloatArray, fit: float
) -> Iterator[Contradiction]:
    """Contradictions between another view's words (m, n + 1) and what this one is sure of.

    Args:
        same: (m,) as far as both see one object.
        fit: as far as the other view fits.
    """
    own, other = np.argmax(mine.p, axis=1), np.argmax(said, axis=1)
    sure = np.min([np.max(mine.p, axis=1), np.max(said, axis=1), same, np.full(len(same), min(fit, mine.fit))], axis=0)
    known, theirs = mine.fit * founded(mine.p), same * fit * founded(said)
    for row in np.flatnonzero((sure >= _SURE) & (own != other)).tolist():
        wrong = -1 if theirs[row] > _MORE * known[row] else 1 if known[row] > _MORE * theirs[row] else 0
        yield Contradiction(int(own[row]), int(other[row]), view, wrong)
