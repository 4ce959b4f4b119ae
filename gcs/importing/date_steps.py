"""By how much one clock of a file is ahead of another: it is the same all the time, unless one of them was set."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from infra.clock_steps import level_steps

__all__ = ["first_frame_us", "longest_level"]

Ints = NDArray[np.int64]

_SECOND_US, _CUT_STEP_US, _STEP_US = 1_000_000, 1_200_000, 500_000
"""Dates of whole seconds step by one."""
_AROUND, _MOST_TOLD = 8, 3
"""Samples on either side that agree about a step, and how many are told."""


def longest_level(what: str, ahead_us: Ints, t_us: Ints, step_us: int) -> tuple[Ints, tuple[str, ...]]:
    """What holds longest of how much a clock is ahead (n,), and in words where it steps.

    Args:
        what: the clock, in messages.
        ahead_us: (n,) in the order of the file.
        t_us: (n,) by the clock that it is ahead of.
        step_us: smaller steps are lateness.
    """
    steps = level_steps(ahead_us, step_us, _AROUND)
    if not steps:
        return ahead_us, ()
    first, last = max(pairwise([0, *(row for row, _ in steps), len(ahead_us)]), key=lambda part: part[1] - part[0])
    longest = ahead_us[np.abs(ahead_us - np.median(ahead_us[first:last])) < step_us]
    said = ", ".join(f"{by_us * 1e-6:+.1f} s at {t_us[row] * 1e-6:.1f} s" for row, by_us in steps[:_MOST_TOLD])
    return longest, (f"{what} steps by {said}: what holds longest counts",)


def first_frame_us(unix_us: Ints, t_us: Ints) -> tuple[int, tuple[str, ...]]:
    """Unix µs of a video's first frame by the dates in its subtitles, 0 without any, and in words what was assumed.

    Args:
        unix_us: (n,) dates, 0 unknown.
        t_us: (n,) when they are shown, since the first frame.
    """
    dated = unix_us > 0
    if not dated.any():
        return 0, ()
    cut = not (unix_us % _SECOND_US).any()
    ahead_us, step_us = (unix_us - t_us)[dated], _CUT_STEP_US if cut else _STEP_US
    longest, told = longest_level("the date in its subtitles", ahead_us, t_us[dated], step_us)
    # dates that are cut to whole seconds are on average half a second early
    zero_us = int(np.quantile(longest, 0.5, method="lower")) + (_SECOND_US // 2 if cut else 0)
    return max(0, zero_us), ("the date in its subtitles is UTC", *told)
