"""Two clocks of one file, as a date beside a film's time stamps: how far one is ahead, where it steps, how it runs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from infra.clock_steps import level_steps

Ints = NDArray[np.int64]

DATE_IN_UTC = "the date in its subtitles is UTC"
_SECOND_US = 1_000_000
_AROUND, _MAX_SHOWN = 8, 3
"""Samples on either side that agree about a step, and how many steps are reported."""
_STEP_US, _SPREAD = 80_000, 4.0
"""Least size of a step: this, and this many times the usual difference between two samples."""
_CUT_SHARE, _CUT_AROUND = 1.2, 3
"""Dates of whole seconds, of which there are few: least size of a step in intervals of the samples, and samples that
agree."""
_RATE, _DRIFT_US = 5e-4, 50_000
"""Least rate and least sum of a drift that is reported: crystals differ by a tenth of the rate, and less in all is
delay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockLead:
    """Lead of one clock over another."""

    longest_us: Ints
    """(k,) of those samples between whose steps it holds longest, µs."""
    notes: tuple[str, ...] = ()
    """Sentences on where it steps, and that it grows."""


def clock_lead(
    what: str, beside: str, unix_us: Ints, t_us: Ints, *, cut: bool = False, latest_us: int = 0
) -> ClockLead:
    """Lead of a clock that tells the date over one that counts.

    A date that is cut to whole seconds tells the time where the next one begins, to the time between two samples.

    Args:
        what: the one that tells the date, in messages.
        beside: the other one.
        unix_us: (n,) in the order of the file.
        t_us: (n,) beside them.
        cut: dates of whole seconds are cut also where no two samples share one.
        latest_us: a date may come as late as this: smaller steps are reported, and samples count on either side.
    """
    within_us, around, late_us, notes = 0.0, _AROUND, 0, list[str]()
    begins = np.flatnonzero(np.diff(unix_us)) + 1
    # some writers put the same digits behind each second
    shared = len(begins) * 2 < len(unix_us) and not (np.diff(unix_us) % _SECOND_US).any()
    if shared or (cut and not (unix_us % _SECOND_US).any()):
        within_us = float(np.median(np.abs(np.diff(t_us)))) if len(begins) else _SECOND_US
        late_us = round(min(_SECOND_US, within_us) / 2)
        around = _CUT_AROUND
        notes.append(f"{what} is cut to whole seconds: ±{late_us * 1e-6:.2f} s")
        unix_us, t_us = (unix_us[begins], t_us[begins]) if len(begins) else (unix_us, t_us)
    ahead_us = unix_us - t_us + late_us
    differ_us = float(np.median(np.abs(np.diff(ahead_us)))) if len(ahead_us) > 1 else 0.0
    # whole seconds of samples that are a second apart slip by one where the date passes a sample
    noise_us = max(_SPREAD * differ_us, _CUT_SHARE * within_us)
    steps = level_steps(ahead_us, round(max(_STEP_US, noise_us)), around)
    set_at = [row for row, by_us in steps if abs(by_us) > latest_us]
    first, last = max(pairwise([0, *set_at, len(ahead_us)]), key=lambda part: part[1] - part[0])
    if steps:
        where = ", ".join(f"{by_us * 1e-6:+.2f} s at {t_us[row] * 1e-6:.1f} s" for row, by_us in steps[:_MAX_SHOWN])
        notes.append(f"{what} steps by {where}: {'what holds longest counts' if set_at else 'it may have come late'}")
    rate, drift_us = _drift(ahead_us[first:last], t_us[first:last])
    if abs(rate) > _RATE and abs(drift_us) > max(_DRIFT_US, noise_us):
        notes.append(
            f"{what} runs {abs(rate):.2%} {'faster' if rate > 0 else 'slower'} than {beside}: they drift apart by "
            f"{abs(drift_us) * 1e-6:.2f} s"
        )
    return ClockLead(longest_us=ahead_us[first:last], notes=tuple(notes))


def _drift(ahead_us: Ints, t_us: Ints) -> tuple[float, float]:
    """Growth of a lead (n,) per second of the clock that it is over, and in all, µs."""
    third = len(ahead_us) // 3
    span_us = float(np.median(t_us[-third:]) - np.median(t_us[:third])) if third >= _AROUND else 0.0
    if span_us <= 0.0:
        return 0.0, 0.0
    rate = float(np.median(ahead_us[-third:] - ahead_us[0]) - np.median(ahead_us[:third] - ahead_us[0])) / span_us
    return rate, rate * float(np.ptp(t_us))


def film_date(what: str, unix_us: Ints, t_us: Ints, *, cut: bool = False) -> tuple[int, tuple[str, ...]]:
    """Unix µs of a video's first frame by dates in it, 0 without any, and in words what is wrong with them.

    Args:
        what: the dates, in messages.
        unix_us: (n,) dates, 0 unknown.
        t_us: (n,) when they are shown, since the first frame.
        cut: those of whole seconds are cut.
    """
    dated = unix_us > 0
    if not dated.any():
        return 0, ()
    lead = clock_lead(what, "the film's time stamps", unix_us[dated], t_us[dated], cut=cut)
    return max(0, int(np.quantile(lead.longest_us, 0.5, method="lower"))), lead.notes
