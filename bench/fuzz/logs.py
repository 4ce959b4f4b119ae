"""Damaged logs against the reader, with the truth beside it.

A log is drawn (senders, clocks, stamps, one writer or two), damaged in one to four ways, indexed, and compared byte by
byte: what is still whole must be found with its own time, nothing else may be, and the damage named must be the damage.
"""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from bench.fuzz.damage import DAMAGES, interleaved
from bench.fuzz.frames import TUNNEL_ID, UNKNOWN_ID, frame_pool, is_signed
from bench.fuzz.marked import Marked, MarkedTruth, marked_log
from mavlink.protocol.packet import Packet
from mavlink.tlog.index import TlogIndex, build_index

_T0_US = 1_790_000_000_123_456
_HOUR_US = 3_600_000_000
_HIDDEN_US = 60_000_000  # a stamp that is wrong by less looks like late traffic
_LAYOUTS = ("big-endian", "big-endian", "big-endian", "little-endian", "none", "two writers", "two writers, two clocks")
_Mask = NDArray[np.bool_]
_CLOCKS = ("steady", "steady", "step", "silences", "jitter")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCase:
    """One damaged log."""

    seed: int
    layout: str
    clock: str
    damages: tuple[str, ...]
    truth: MarkedTruth
    log: Marked


@dataclass(slots=True, kw_only=True)
class LogScore:
    """Sums over cases."""

    logs: int = 0
    whole: int = 0
    """Records that the damage left whole."""
    lost: int = 0
    wrong_times: int = 0
    """Whole records that came with another time than their own."""
    lonely: int = 0
    """The same where no record beside it has its clock: such a stamp looks like a damaged one."""
    phantoms: int = 0
    """Known messages that were never written."""
    unknown_phantoms: int = 0
    """The same of unknown messages, which are never decoded."""
    found_besides: int = 0
    """Whole frames whose own stamp is gone."""
    stamps_believed: int = 0
    """Of those, with a stamp a minute or more off that was accepted."""
    damaged_bytes: int = 0
    false_bytes: int = 0
    """Undamaged bytes named as damaged."""
    missed_bytes: int = 0
    """Damaged bytes in no range."""
    wrong_counts: int = 0
    """Logs whose summary disagrees with their rows."""
    slowest_ms: float = 0.0
    failures: list[str] = field(default_factory=list)

    def add(self, other: LogScore) -> None:
        for f in fields(self):
            mine, theirs = getattr(self, f.name), getattr(other, f.name)
            setattr(self, f.name, max(mine, theirs) if f.name == "slowest_ms" else mine + theirs)


def _times(count: int, clock: str, rng: random.Random) -> NDArray[np.int64]:
    steps = np.array([rng.randrange(1, 40_000) for _ in range(count)], dtype=np.int64)
    if clock == "silences":
        steps[rng.sample(range(count), min(count, 3))] += _HOUR_US
    t_us = _T0_US + np.cumsum(steps)
    if clock == "step":
        t_us[rng.randrange(count) :] += rng.choice((-1, 1)) * rng.choice((1, 70, 3600, 30 * 86_400)) * 1_000_000
    if clock == "jitter":
        t_us += np.array([rng.randrange(-500_000, 500_000) for _ in range(count)])
    return t_us


def draw_case(seed: int) -> LogCase:
    """The same case for the same seed."""
    rng = random.Random(seed)
    pool = frame_pool()
    unsigned = [frame for frame in pool[:200] if not is_signed(frame)]
    count = rng.choice((5, 30, 120, 400, 1200)) + rng.randrange(20)
    layout, clock = rng.choice(_LAYOUTS), rng.choice(_CLOCKS)
    order = {"none": "", "little-endian": "<"}.get(layout, ">")
    two = layout.startswith("two writers")
    first = rng.randrange(len(pool) - 2 * count)
    t_us = _times(count, clock, rng)
    if two:
        offset_us = rng.choice((-7, 1, 24)) * _HOUR_US if layout.endswith("clocks") else rng.randrange(200_000)
        t_us = np.concatenate([t_us, t_us + offset_us])
    frames = pool[first : first + t_us.size]
    if order == "<":  # the programs that wrote such logs were gone before signing came
        frames = tuple(frame if not is_signed(frame) else unsigned[i % len(unsigned)] for i, frame in enumerate(frames))
    truth = MarkedTruth(frames=frames, t_us=t_us, order=order)
    log = marked_log(truth, range(count))
    if two:
        log = interleaved(log, marked_log(truth, range(count, 2 * count)), rng)
    damages = tuple(rng.choices(list(DAMAGES), k=rng.choice((0, 1, 1, 2, 3, 4))))
    for name in damages:
        if log.size > 40:
            log = DAMAGES[name](log, rng)
    return LogCase(seed=seed, layout=layout, clock=clock, damages=damages, truth=truth, log=log)


def run_case(case: LogCase) -> LogScore:
    """Index one log and compare."""
    start = time.process_time()
    index = build_index(case.log.data)
    took_ms = (time.process_time() - start) * 1e3
    score = compare(case, index)
    score.slowest_ms = took_ms
    return score


def compare(case: LogCase, index: TlogIndex) -> LogScore:
    """What the reader made of a log against what is in it."""
    whole, partly = case.truth.standing(case.log)
    found = {int(offset): row for row, offset in enumerate(index.offset)}
    score = LogScore(logs=1, whole=len(whole), wrong_counts=int(not _counts_agree(index, case.log.size)))
    # bytes that must not be named as damaged, and bytes that may be or not
    undamaged, either = np.zeros((2, case.log.size), dtype=np.bool_)
    for offset, record in whole:
        _judge_whole(case, index, offset, record, found, score, undamaged)
    for offset, record in partly:
        _judge_partly(case, index, offset, record, found, score, either)
    intact = {offset for offset, _ in (*whole, *partly)}
    for offset, row in found.items():
        if offset not in intact:
            either[max(0, offset - case.truth.width) : offset + int(index.length[row])] = True
            if not _carried(case, offset):
                score.phantoms += bool(index.known[row])
                score.unknown_phantoms += not index.known[row]
    named = np.zeros(case.log.size, dtype=np.bool_)
    for damage in index.damage:
        named[damage.start : damage.stop] = True
    score.damaged_bytes = int(np.count_nonzero(named))
    score.false_bytes = int(np.count_nonzero(named & undamaged & ~either))
    score.missed_bytes = int(np.count_nonzero(~named & ~undamaged & ~either))
    if score.lost or score.wrong_times or score.phantoms or score.false_bytes or score.missed_bytes:
        damages = ", ".join(case.damages) or "untouched"
        counts = f"lost {score.lost}, wrong times {score.wrong_times}, phantoms {score.phantoms}"
        score.failures.append(f"{case.seed}: {counts}; {case.layout}, {case.clock} clock: {damages}")
    return score


def _judge_whole(
    case: LogCase, index: TlogIndex, offset: int, record: int, found: dict[int, int], score: LogScore, undamaged: _Mask
) -> None:
    frame, width = case.truth.frames[record], case.truth.width
    row = found.get(offset)
    if row is None or int(index.length[row]) != len(frame):
        if not _unprovable(case, frame):
            score.lost += 1
            undamaged[offset - width : offset + len(frame)] = True
        return
    undamaged[offset - width : offset + len(frame)] = True
    if width and int(index.t_us[row]) != int(case.truth.t_us[record]):
        alone = _lonely(index, row, int(case.truth.t_us[record]))
        score.lonely += alone
        score.wrong_times += not alone
        undamaged[offset - width : offset] = not alone


def _judge_partly(
    case: LogCase, index: TlogIndex, offset: int, record: int, found: dict[int, int], score: LogScore, either: _Mask
) -> None:
    width = case.truth.width
    either[max(0, offset - width) : offset + len(case.truth.frames[record])] = True
    row = found.get(offset)
    if row is not None:
        score.found_besides += 1
        off_us = abs(int(index.t_us[row]) - int(case.truth.t_us[record]))
        score.stamps_believed += bool(width and index.time_ok[row] and off_us > _HIDDEN_US)


def _unprovable(case: LogCase, frame: bytes) -> bool:
    """An unknown message in a file without times is kept only beside others: else there is no evidence for it."""
    return not case.truth.order and Packet(0, frame).message_id == UNKNOWN_ID


def _lonely(index: TlogIndex, row: int, t_us: int) -> bool:
    return not (np.abs(index.t_us[[max(0, row - 1), min(len(index) - 1, row + 1)]] - t_us) <= _HIDDEN_US).any()


def _carried(case: LogCase, offset: int) -> bool:
    """A frame inside a tunnel that is damaged, in a file without times: it looks like any other."""
    record = int(case.log.record[offset])
    return not case.truth.order and record >= 0 and Packet(0, case.truth.frames[record]).message_id == TUNNEL_ID


def _counts_agree(index: TlogIndex, size: int) -> bool:
    counts = index.counts
    ends = index.offset + index.length
    return (
        counts.records == len(index)
        and counts.size_bytes == size
        and counts.unknown == int(np.count_nonzero(~index.known))
        and counts.bad_times == int(np.count_nonzero(~index.time_ok))
        and bool((index.offset[1:] >= ends[:-1]).all())
        and counts.damaged_bytes <= sum(d.stop - d.start for d in index.damage)
    )


def fuzz_logs(seeds: Sequence[int]) -> dict[str, LogScore]:
    """Scores of many cases by kind: of everything, of each layout, clock and damage."""
    scores: dict[str, LogScore] = {"all": LogScore()}
    for seed in seeds:
        case = draw_case(seed)
        try:
            score = run_case(case)
        except Exception as error:  # noqa: BLE001  (that there is none is what is being measured)
            score = LogScore(logs=1, failures=[f"{seed}: {error!r}"])
        for kind in ("all", f"layout: {case.layout}", f"clock: {case.clock}", *sorted(set(case.damages))):
            scores.setdefault(kind, LogScore()).add(score)
    return scores
