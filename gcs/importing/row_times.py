"""Times of a file's rows, in the order of the file, as those of one clock: judged for every reader alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from infra.clock_steps import restarts

__all__ = ["NO_ZONE", "RowTimes", "check_one_clock", "row_times", "unix_seconds"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NO_ZONE = "times without a zone are UTC; --clock corrects that"
_BACK_US = 1_000_000
_AGREE = 2
"""Rows of one logger come late alone, if at all."""
_SECOND_US = 1_000_000
_LEAST_ROWS = 3
_GAP_US, _GAP_STEPS = 5_000_000, 10
"""A gap is longer than this, and than so many of the usual steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowTimes:
    """Rows in order of time, one for each."""

    rows: Ints
    """(k,) places in the file."""
    t_us: Ints
    """(k,) increasing."""
    assumed: tuple[str, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)


def check_one_clock(t_us: Ints, source: str, *, blocks: bool = False) -> None:
    """See that times (n,) in the order of the file are of one clock; some files have the latest first.

    Args:
        t_us: µs.
        source: names the file in messages.
        blocks: blocks may stand in another order, as long as they do not lie over each other.

    Raises:
        ImportFileError: the times begin again, or all of them are the same.
    """
    if len(t_us) >= _LEAST_ROWS and np.ptp(t_us) == 0:
        raise ImportFileError(
            f"{source}: all {len(t_us)} positions have the same time, {_words(int(t_us[0]))}: they tell no path"
        )
    back_to_front = np.count_nonzero(np.diff(t_us) < 0) * 2 > len(t_us)
    times = t_us[::-1] if back_to_front else t_us
    again = restarts(times, _BACK_US, _AGREE)
    if again and not (blocks and _apart(np.split(times, again))):
        row = again[0]
        raise ImportFileError(
            f"{source}: its times begin again: position {row + 1} of {len(t_us)} is "
            f"{(times[row - 1] - times[row]) * 1e-6:.1f} s earlier than the one in front of it; two recordings, or a "
            "clock that was set: cut it there"
        )


def _apart(blocks: Sequence[Ints]) -> bool:
    """Whether no two blocks of times share more than a moment."""
    spans = sorted((int(block.min()), int(block.max())) for block in blocks)
    return all(last - first < _BACK_US for (_, last), (first, _) in pairwise(spans))


def row_times(t_us: Ints, places: Floats, source: str) -> RowTimes:
    """Times of rows in the order of the file as those of one clock.

    Whole seconds that several rows share are spread over the second, where the places differ within it; of other rows
    with one time the first counts.

    Args:
        t_us: (n,) as they stand there.
        places: (n, 2) beside them.
        source: names the file in messages.

    Raises:
        ImportFileError: the times begin again, or all of them are the same.
    """
    check_one_clock(t_us, source)
    order = np.argsort(t_us, kind="stable")
    times, counts = np.unique(t_us, return_counts=True)
    rows = order[np.cumsum(counts) - counts]
    if len(rows) * 2 <= len(t_us) and not (times % _SECOND_US).any() and _differ(places[order], t_us[order]):
        many, spread = int(np.median(counts)), _spread(times, counts)
        said = f"times are whole seconds that {many} rows share: spread evenly, ±{0.5 / many:.2f} s"
        return RowTimes(rows=order, t_us=spread, assumed=(said,))
    lost = len(t_us) - len(rows)
    skipped = {"positions with the time of another": lost} if lost else {}
    late = int(np.count_nonzero(t_us < np.maximum.accumulate(t_us)))
    moved = (f"{late} positions stand behind later ones: put in order",) if 0 < late * 2 < len(t_us) else ()
    return RowTimes(rows=rows, t_us=times, assumed=(*moved, *_gap_words(times)), skipped=skipped)


def _gap_words(times: Ints) -> tuple[str, ...]:
    """The longest gap, if it is one: a clock that was set forward looks the same."""
    steps = np.diff(times)
    if not len(steps) or steps.max() < max(_GAP_US, _GAP_STEPS * float(np.median(steps))):
        return ()
    row = int(np.argmax(steps))
    return (f"nothing was logged for {steps[row] * 1e-6:.1f} s after position {row + 1} of {len(times)}",)


def _differ(places: Floats, t_us: Ints) -> bool:
    """Whether most neighbours with one time are at different places."""
    same_time = np.diff(t_us) == 0
    moved = (np.diff(places, axis=0) != 0.0).any(axis=1)
    return bool(np.count_nonzero(moved & same_time) * 2 > np.count_nonzero(same_time))


def _spread(seconds_us: Ints, counts: Ints) -> Ints:
    """Times of rows, ``counts`` in each second; the first second is full at its end, the others at their beginning."""
    most = np.maximum(counts, int(np.median(counts)))
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    place[: counts[0]] += most[0] - counts[0]
    share = (place + 0.5) / np.repeat(most, counts)
    return np.asarray(np.repeat(seconds_us, counts) + np.rint(share * _SECOND_US), np.int64)


def _words(t_us: int) -> str:
    return f"{datetime.fromtimestamp(t_us // 1_000_000, UTC):%Y-%m-%d %H:%M:%S}"


def unix_seconds(text: str) -> tuple[float, bool]:
    """Unix seconds of a date in ISO 8601, NaN where it is none, and whether it has a zone; without one it is UTC."""
    try:
        when = datetime.fromisoformat(text.strip())
    except ValueError:
        return float("nan"), True
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp(), when.tzinfo is not None
