"""What lowered an answer most is told."""

from __future__ import annotations

import numpy as np

from assoc.identification.doubts import AnswerDoubt, Doubted, lowered


def test_the_step_that_took_most_is_told():
    p = np.array([[0.9, 0.0, 0.1], [0.9, 0.0, 0.1], [0.0, 0.2, 0.8]])
    told = Doubted.of(p)
    told = told.after(AnswerDoubt.PLACE, np.array([[0.7, 0.2, 0.1], [0.88, 0.02, 0.1], [0.0, 0.2, 0.8]]))
    told = told.after(AnswerDoubt.MISSING, np.array([[0.7, 0.2, 0.1], [0.88, 0.02, 0.1], [0.1, 0.5, 0.4]]))
    told = told.after(AnswerDoubt.UNSTEADY, np.array([[0.6, 0.2, 0.2], [0.86, 0.02, 0.12], [0.1, 0.5, 0.4]]))
    assert told.doubt.tolist() == [AnswerDoubt.PLACE, AnswerDoubt.NONE, AnswerDoubt.MISSING]


def test_a_steps_answer_is_that_of_the_evidence_and_not_of_the_step_before():
    told = Doubted.of(np.array([[0.6, 0.4, 0.0]])).after(AnswerDoubt.DOUBLE, np.array([[0.3, 0.7, 0.0]]))
    assert told.answer.tolist() == [0]
    assert told.after(AnswerDoubt.PLACE, np.array([[0.3, 0.2, 0.5]])).doubt.tolist() == [AnswerDoubt.DOUBLE]


def test_what_lowers_an_answer_in_a_frame_stands_before_what_did_at_the_update():
    before = np.array([[0.95, 0.05], [0.95, 0.05]])
    after = np.array([[0.75, 0.25], [0.95, 0.05]])
    doubts = np.array([AnswerDoubt.UNPROVEN, AnswerDoubt.UNPROVEN])
    assert lowered(AnswerDoubt.COMMON_BOX, before, after, doubts).tolist() == [
        AnswerDoubt.COMMON_BOX,
        AnswerDoubt.UNPROVEN,
    ]
