"""The answers of one view with those of the others: hears what they tell of their tracks, frame by frame.

What is heard changes answers alone. Evidence, pose and all that is learnt stay the view's own, and it is this that it
tells the others in turn: nothing comes back to where it began, and nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assoc.other_views.opinions import Hearsay, answers_for, information_of, pooled, without_taken
from assoc.other_views.reconcile import Cause, Reconciliation
from assoc.other_views.same_boxes import SameBoxes, newest_answers, places_at
from assoc.records import Sighting

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SURE = 0.8
"""Probability from which on two answers that differ are a contradiction."""
_MORE = 1.2
"""A view that knows this many times less is the likelier one to be wrong."""


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
    cause: Cause | None
    """Cause that would explain it; None: nothing, or the data do not tell."""


class Hearing:
    """Words of the other views that one hears, over time."""

    def __init__(self) -> None:
        self._same: dict[int, SameBoxes] = {}
        self._hearsay: dict[int, Hearsay] = {}
        self._apart: dict[int, Reconciliation] = {}
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
            said, is_same = answers_for(newest_answers(track_id, theirs), pairs)
            fit = theirs[-1].fit
            apart = self._apart.setdefault(view, Reconciliation())
            if apart.is_due(t := 1e-6 * mine.t_us):
                apart.look(t, *_both_name(mine, theirs))
            contradictions += _contradictions(view, mine, said, is_same, fit, apart)
            hearsay = self._hearsay.setdefault(view, Hearsay())
            said, is_same = hearsay.update(1e-6 * mine.t_us, mine.track_id, said, is_same)
            answers.append(said)
            same.append(is_same)
            fits.append(fit)
        self.contradictions, self.pairs = tuple(contradictions), every
        return without_taken(mine.p, pooled(answers, same, fits))


def _contradictions(
    view: int, mine: Sighting, said: FloatArray, same: FloatArray, fit: float, apart: Reconciliation
) -> Iterator[Contradiction]:
    """Contradictions between another view's words (m, n + 1) and what this one is sure of.

    Args:
        same: (m,) as far as both see one object.
        fit: as far as the other view fits.
        apart: by how much both have vehicles apart.
    """
    own, other = np.argmax(mine.p, axis=1), np.argmax(said, axis=1)
    sure = np.min([np.max(mine.p, axis=1), np.max(said, axis=1), same, np.full(len(same), min(fit, mine.fit))], axis=0)
    known, theirs = mine.fit * information_of(mine.p), same * fit * information_of(said)
    rows = np.flatnonzero((sure >= _SURE) & (own != other)).tolist()
    cause = apart.cause() if rows else None
    for row in rows:
        wrong = -1 if theirs[row] > _MORE * known[row] else 1 if known[row] > _MORE * theirs[row] else 0
        yield Contradiction(int(own[row]), int(other[row]), view, wrong, cause)


def _both_name(mine: Sighting, theirs: Sequence[Sighting]) -> tuple[IntArray, FloatArray]:
    """Vehicles (k,) that both views name surely, and rows (k, 5) as :meth:`Reconciliation.look` takes them."""
    track_id, place, cov = places_at(mine.t_us, theirs)
    answers, sure = newest_answers(track_id, theirs), np.full(mine.p.shape[1] - 1, -1)
    there, here = sure.copy(), sure
    for p, row_of in ((mine.p, here), (answers, there)):
        row, vehicle = np.nonzero(p[:, :-1] >= _SURE)
        row_of[vehicle] = row
    both = np.flatnonzero((here >= 0) & (there >= 0))
    i, j = here[both], there[both]
    var = 0.5 * np.trace(mine.cov_m2[i] + cov[j], axis1=1, axis2=2)
    return both, np.column_stack([mine.place[i] - place[j], place[j], var])
