"""Strangers remembered by the vehicles that were seen beside them."""

from __future__ import annotations

import numpy as np

from assoc.company import Company

COLUMNS = np.array([0, 1, 2])


def ints(*values):
    return np.array(values, np.int64)


def test_a_stranger_is_remembered_beside_whom_it_was_seen():
    company = Company()
    company.note(ints(2), ints(0, 1), ints(4, 5))
    company.note(ints(2), ints(0), ints(6))
    assert np.flatnonzero(company.of(COLUMNS, 8)[2]).tolist() == [4, 5, 6]
    assert not company.of(COLUMNS, 8)[:2].any()


def test_who_is_named_or_may_be_another_is_no_stranger_any_more():
    company = Company()
    company.note(ints(1, 2), ints(0), ints(4))
    company.note(ints(), ints(1), ints(5))
    company.forget([2])
    assert not company.of(COLUMNS, 8).any()
