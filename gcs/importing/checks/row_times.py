"""Times of a file's rows as those of one clock, judged for every reader alike."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.clock_leaps import path_leaps
from gcs.importing.checks.one_path import several_paths
from gcs.importing.checks.plausible import alone, metres, usual_step
from gcs.importing.checks.steps import STALE, STAYS, stays
from gcs.importing.vehicle_log import Where, in_order, whole_places
from infra.clock_steps import restarts, set_back

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NO_ZONE = "times without a zone are UTC; --clock corrects that"
_NO_PLACE = "positions that are no place"
_BACK_US = 1_000_000
_AGREE = 2
"""Number of rows on each side that must agree on a restart: rows of one logger come late one at a time, if at all."""
_SECOND_US = 1_000_000
_MIN_ROWS = 3
_GAP_US, _GAP_STEPS = 1_000_000, 5
"""Least length of a gap, µs and as a multiple of the usual step."""
_MOST_OF_ALL = 0.9
_NEAR_M, _STEPS = 2.0, 3.0
"""A row that comes late is nearer to the path at its time than this and this many usual steps."""
_FAR_M, _FASTEST_MPS = 30.0, 40.0
"""Distance out of its path, and speed of the way back, that nothing exceeds."""
_YEAR_FIRST = re.compile(r"^(\d{4})[/.](\d{2})[/.](\d{2})", re.ASCII)
_UTC = re.compile(r" ?(?:UTC|GMT)$")
_MAX_SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RowTimes:
    """Rows in order of time, one for each."""

    rows: Ints
    """(k,) places in the file."""
    t_us: Ints
    """(k,) increasing."""
    assumed: tuple[str, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)


def by_number(row: int) -> str:
    """Place of a record in what has no lines."""
    return f"position {row + 1}"


def numbered(word: str, numbers: Sequence[int] | Ints) -> Where:
    """Places by numbers of lines or bytes."""
    return lambda row: f"{word} {numbers[row]}"


def at_second(t_us: Ints, of: str) -> Where:
    """Places by the time since a beginning, µs."""
    return lambda row: f"{t_us[row] * 1e-6:.1f} s of the {of}"


def check_one_clock(t_us: Ints, source: str, where: Where = by_number, *, blocks: bool = False) -> None:
    """See that times (n,) in the order of the file are of one clock; some files have the latest first.

    Args:
        t_us: µs.
        where: their places in the file, for messages.
        blocks: blocks may stand in another order, as long as they do not lie over each other.

    Raises:
        ImportFileError: the times begin again, or all of them are the same.
    """
    if len(t_us) >= _MIN_ROWS and np.ptp(t_us) == 0:
        raise ImportFileError(
            f"{source}: all {len(t_us)} positions have the same time, {_words(int(t_us[0]))}: they tell no path"
        )
    back_to_front = np.count_nonzero(np.diff(t_us) < 0) * 2 > len(t_us)
    times = t_us[::-1] if back_to_front else t_us
    again = sorted({*restarts(times, _BACK_US, _AGREE), *set_back(times)})
    if again and not (blocks and _apart(np.split(times, again))):
        row = again[0]
        raise ImportFileError(
            f"{source}: its times begin again: {where(len(t_us) - 1 - row if back_to_front else row)} is "
            f"{(times[row - 1] - times[row]) * 1e-6:.2f} s earlier than the one in front of it; two recordings, or a "
            "clock that was set: cut it there"
        )


def _apart(blocks: Sequence[Ints]) -> bool:
    """Tell whether no two blocks of times lie over each other."""
    spans = sorted((int(block.min()), int(block.max())) for block in blocks)
    return all(last <= first for (_, last), (first, _) in pairwise(spans))


def row_times(
    t_us: Ints,
    places: Floats,
    source: str,
    where: Where = by_number,
    *,
    blocks: bool = False,
    own_us: Ints | None = None,
    shared: bool = False,
) -> RowTimes:
    """Times of rows in the order of the file as those of one clock.

    Whole seconds that several rows share are spread over the second, where the places differ within it; of other rows
    with one time the first counts. Rows that are there again, damaged times and places, and what is no place are left
    out.

    Args:
        t_us: (n,) as they stand there.
        places: (n, 2) beside them.
        where: their places in the file, for messages.
        blocks: blocks may stand in another order, as long as they do not lie over each other.
        own_us: (n,) by the clock of what moves, where ``t_us`` is when that arrived.
        shared: what is made of the rows finds out itself that two vehicles have one id: that is reported, not refused.

    Raises:
        ImportFileError: the times begin again, or all of them are the same, or several paths take turns.
    """
    whole = np.flatnonzero(whole_places(places[:, 0], places[:, 1]))
    nowhere = {_NO_PLACE: len(t_us) - len(whole)} if len(whole) < len(t_us) else {}
    if not len(whole):
        return RowTimes(rows=whole, t_us=t_us[whole], skipped=nowhere)
    first = _first_of_repeated(t_us[whole], places[whole])
    repeated, whole = len(whole) - len(first), whole[first]
    t_us, places = t_us[whole], places[whole]
    check_one_clock(t_us, source, lambda row: where(int(whole[row])), blocks=blocks)
    if blocks:
        in_time = np.argsort(t_us, kind="stable")
        whole, t_us, places = whole[in_time], t_us[in_time], places[in_time]
    kept, strays = _without_strays(t_us, places)
    times, counts = np.unique(t_us[kept], return_counts=True)
    order = kept[np.argsort(t_us[kept], kind="stable")]
    rows = order[np.cumsum(counts) - counts]
    assumed: list[str] = []
    if len(rows) * 2 <= len(order) and not (times % _SECOND_US).any() and _differ(places[order], t_us[order]):
        many, times, rows = int(np.median(counts)), _spread(times, counts), order
        assumed.append(f"times are whole seconds that {many} rows share: spread evenly, ±{0.5 / many:.2f} s")
    else:
        late = int(np.count_nonzero(t_us[kept] < np.maximum.accumulate(t_us[kept])))
        assumed += [f"{late} positions stand behind later ones: put in order"] if 0 < late * 2 < len(kept) else []

    def in_file(row: int) -> str:
        return where(int(whole[rows[row]]))

    several = several_paths(times, places[rows], in_file)
    if several and not shared:
        raise ImportFileError(f"{source}: {several}; give them one by one, or with a column of system ids")
    assumed += [several] if several else []
    path_m = metres(places[rows])
    out = alone(times, path_m, _FAR_M, _FASTEST_MPS)
    stale = stays(times, places[rows], path_m) & ~out
    if stale.any():
        assumed.append(f"{STAYS} from {in_file(int(np.argmax(stale)) - 1)} on")
    there = ~(out | stale)
    left_out = {
        "positions that are there twice": repeated,
        "positions with the time of another": len(order) - len(rows),
        "positions whose time is not that of those around them": strays,
        "positions out of the path and back at once": int(np.count_nonzero(out)),
        STALE: int(np.count_nonzero(stale)),
    }
    kept_rows = rows[there]
    moved_us = times[there] if own_us is None else own_us[whole[kept_rows]]
    assumed += _describe_leaps(times[there], moved_us, path_m[there], lambda row: where(int(whole[kept_rows[row]])))
    return RowTimes(
        rows=whole[kept_rows],
        t_us=times[there],
        assumed=(*assumed, *_describe_gaps(times, in_file)),
        skipped={**nowhere, **{reason: count for reason, count in left_out.items() if count}},
    )


def _without_strays(t_us: Ints, places: Floats) -> tuple[Ints, int]:
    """Rows but those whose time is damaged: out of order, and of another place than the others have then.

    A row that only comes late has the place of its time.
    """
    back_to_front = np.count_nonzero(np.diff(t_us) < 0) * 2 > len(t_us)
    line = _longest_ascent(t_us[::-1] if back_to_front else t_us)
    line = len(t_us) - 1 - line[::-1] if back_to_front else line
    odd = np.setdiff1d(np.arange(len(t_us)), line)
    if not len(odd) or len(odd) * 2 > len(t_us):
        return np.arange(len(t_us)), 0
    line = line[np.argsort(t_us[line], kind="stable")]
    since_s, at_s = (t_us[line] - t_us[line[0]]) * 1e-6, (t_us[odd] - t_us[line[0]]) * 1e-6
    path_m = metres(places)
    then_m = np.column_stack([np.interp(at_s, since_s, path_m[line, axis]) for axis in (0, 1)])
    away_m = np.hypot(*(path_m[odd] - then_m).T)
    strays = odd[away_m > _NEAR_M + _STEPS * usual_step(path_m[line])]
    return np.setdiff1d(np.arange(len(t_us)), strays), len(strays)


def ascending(t_us: Ints) -> Ints:
    """Rows of times (n,) in ascending order, one for each: damaged times are left out, where few are out of order."""
    line = _longest_ascent(t_us)
    line = line if len(line) > _MOST_OF_ALL * len(t_us) else np.arange(len(t_us))
    return line[in_order(t_us[line])]


def _longest_ascent(t_us: Ints) -> Ints:
    """Rows of the longest part of times (n,) that never goes back."""
    if not (np.diff(t_us) < 0).any():
        return np.arange(len(t_us))
    ends: list[int] = []
    last: list[int] = []
    before = np.full(len(t_us), -1, np.int64)
    for row, t in enumerate(t_us.tolist()):
        place = bisect_right(ends, t)
        before[row] = last[place - 1] if place else -1
        ends[place : place + 1], last[place : place + 1] = [t], [row]
    found, row = [], last[-1]
    while row >= 0:
        found.append(row)
        row = int(before[row])
    return np.array(found[::-1], np.int64)


def gaps(times: Ints) -> Ints:
    """Behind which rows of ascending times (n,) nothing was logged for long."""
    steps = np.diff(times)
    usual_us = float(np.median(steps)) if len(steps) else 0.0
    return np.asarray(np.flatnonzero(steps >= max(_GAP_US, _GAP_STEPS * usual_us)), np.int64)


def _describe_leaps(times: Ints, moved_us: Ints, path_m: Floats, where: Where) -> list[str]:
    """Describe the leaps of the clock of what moves."""
    longest = gaps(times)
    found = [(row, by_us) for row, by_us in path_leaps(moved_us, path_m) if row not in longest]
    leaps = [
        f"its clock leaps by {by_us * 1e-6:+.2f} s after {where(row)}: the path goes on as if no time had passed; cut "
        "it there"
        for row, by_us in found[:_MAX_SHOWN]
    ]
    if len(found) > _MAX_SHOWN:
        return [f"{leaps[0]}; and so it does {len(found) - 1} times more: times that were cut, or of another clock?"]
    return leaps


def _describe_gaps(times: Ints, where: Where) -> tuple[str, ...]:
    """Describe the longest gap: in one a vehicle may have stood, or its clock was set."""
    steps, longest = np.diff(times), gaps(times)
    if not len(longest):
        return ()
    row = int(longest[np.argmax(steps[longest])])
    return (f"nothing was logged for {steps[row] * 1e-6:.1f} s after {where(row)}",)


def _first_of_repeated(t_us: Ints, places: Floats) -> Ints:
    """Leave out the rows that stand behind later ones and were there before, as where a part of a file is in it
    twice."""
    late = t_us < np.maximum.accumulate(t_us)
    if not late.any():
        return np.arange(len(t_us))
    _, first, same = np.unique(np.column_stack([t_us, places]), axis=0, return_index=True, return_inverse=True)
    return np.flatnonzero(~late | (first[same.ravel()] == np.arange(len(t_us))))


def _differ(places: Floats, t_us: Ints) -> bool:
    """Tell whether most neighbours with one time are at different places."""
    same_time = np.diff(t_us) == 0
    moved = (np.diff(places, axis=0) != 0.0).any(axis=1)
    return bool(np.count_nonzero(moved & same_time) * 2 > np.count_nonzero(same_time))


def _spread(seconds_us: Ints, counts: Ints) -> Ints:
    """Times of rows, ``counts`` in each second; the first one and those behind a hole are full at their end, the others
    at their beginning."""
    most = np.maximum(counts, int(np.median(counts)))
    begun_late = np.r_[True, np.diff(seconds_us) > _SECOND_US]
    before = np.where(begun_late, most - counts, 0)
    place = np.arange(counts.sum()) + np.repeat(before - np.cumsum(counts) + counts, counts)
    share = (place + 0.5) / np.repeat(most, counts)
    return np.asarray(np.repeat(seconds_us, counts) + np.rint(share * _SECOND_US), np.int64)


def _words(t_us: int) -> str:
    return f"{datetime.fromtimestamp(t_us // 1_000_000, UTC):%Y-%m-%d %H:%M:%S}"


def unix_seconds(text: str) -> tuple[float, bool]:
    """Unix seconds of a date in ISO 8601, NaN where it is none, and whether it has a zone; without one it is UTC.

    The year may have slashes or points behind it: only where it comes first is it clear which the month is.
    """
    try:
        when = datetime.fromisoformat(_UTC.sub("Z", _YEAR_FIRST.sub(r"\1-\2-\3", text.strip())))
    except ValueError:
        return float("nan"), True
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp(), when.tzinfo is not None
