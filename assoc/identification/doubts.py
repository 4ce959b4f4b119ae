"""Reasons why an answer is less sure than its evidence alone makes it.

After joint hypotheses have given the marginals of each track, steps lower what else is known to go wrong, in the order
of :class:`AnswerDoubt`: to 7 at each update, the others in each frame. Each takes and returns marginals whose rows add
up to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NOTED = 0.05
"""An answer that loses less to a step is told without it."""


class AnswerDoubt(IntEnum):
    """Reasons for which an answer is less probable than its evidence, in the order of the steps that take from it."""

    NONE = 0
    FIT = 1
    """Film and telemetry are not known to belong together."""
    DOUBLE = 2
    """Another vehicle reports the same place."""
    PLACE = 3
    """A neighbour stands near enough for receivers' errors to exchange the two, or a stranger does."""
    UNPROVEN = 4
    """The vehicles have not driven like their boxes for long enough yet."""
    WANDERING = 5
    """Receivers err in ways too fast for how vehicles drive to tell anything, so that places alone name them."""
    MISSING = 6
    """One of ours is not accounted for, so that the box may not be a stranger's."""
    UNSTEADY = 7
    """The answer has not been as probable for two seconds yet."""
    COMMON_BOX = 8
    """The box is probably round two vehicles."""
    ELSEWHERE = 9
    """Another camera sees this object, or another one with this name, and answers otherwise."""
    COASTING = 10
    """The track is predicted, and one that is seen has the name."""
    OWN_WORD = 11
    """The vehicle doubts its own position."""
    CONTESTED = 12
    """Several senders use the vehicle's id, or the UAV's."""
    CONTRADICTED = 13
    """The vehicle reports to be elsewhere."""


@dataclass(frozen=True, slots=True)
class Doubted:
    """Marginals on their way through the steps of one update."""

    p: FloatArray
    """(m, n + 1) marginals, the last column "none of ours"."""
    answer: IntArray
    """(m,) column that the evidence alone makes likeliest."""
    doubt: IntArray
    """(m,) :class:`AnswerDoubt`."""
    taken: FloatArray
    """(m,) what that step took from the answer's probability."""

    @classmethod
    def of(cls, p: FloatArray) -> Doubted:
        """Marginals before any step."""
        m = len(p)
        return cls(p, np.argmax(p, axis=1), np.full(m, AnswerDoubt.NONE, np.int64), np.full(m, _NOTED))

    def after(self, doubt: AnswerDoubt, p: FloatArray) -> Doubted:
        """Marginals after a step that gave (m, n + 1) p; what it took counts where no other took more."""
        rows = np.arange(len(p))
        taken = self.p[rows, self.answer] - p[rows, self.answer]
        more = taken > self.taken
        return Doubted(p, self.answer, np.where(more, doubt, self.doubt), np.where(more, taken, self.taken))


def lowered(doubt: AnswerDoubt, before: FloatArray, after: FloatArray, doubts: IntArray) -> IntArray:
    """(m,) doubts of the frame: this one where a step lowered a row's likeliest answer, else as they were.

    Args:
        doubt: Of the step.
        before: (m, n + 1) marginals that it took.
        after: (m, n + 1) those that it returned.
        doubts: (m,) so far.
    """
    rows, answer = np.arange(len(before)), np.argmax(before, axis=1)
    return np.where(before[rows, answer] - after[rows, answer] > _NOTED, doubt, doubts)
