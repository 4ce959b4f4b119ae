"""Damaged logs against the reader, with the truth beside it.

A log is drawn (senders, clocks, stamps, one writer or two), damaged in one to four ways, indexed, and compared byte by
byte: what is still whole must be found with its own time, nothing else may be, and the damage named must be the damage.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.fuzz.frames import TUNNEL_ID, UNKNOWN_ID, FuzzScore, frame_pool, is_signed
from mavlink.protocol.framing import SIGNATURE_LENGTH
from mavlink.protocol.packet import MAGIC_V2, Packet
from mavlink.tlog.index import TlogIndex, build_index

_FOREIGN = -1


@dataclass(slots=True)
class Marked:
    """A log's bytes (size,) and, for each, the record it is of and its place in it."""

    data: NDArray[np.uint8]
    record: NDArray[np.int32]
    """−1: a byte of no record."""
    place: NDArray[np.int32]
    width: int
    """Bytes of a stamp."""

    @property
    def size(self) -> int:
        return self.data.size

    def part(self, start: int, stop: int) -> Marked:
        span = slice(start, stop)
        return Marked(self.data[span], self.record[span], self.place[span], self.width)

    def without(self, start: int, stop: int) -> Marked:
        return joined([self.part(0, start), self.part(stop, self.size)])

    def with_bytes(self, at: int, data: bytes) -> Marked:
        return joined([self.part(0, at), foreign(data, self.width), self.part(at, self.size)])

    def overwritten(self, at: int, data: bytes) -> Marked:
        new = np.frombuffer(data, dtype=np.uint8)[: self.size - at]
        out = replace(self, data=self.data.copy())
        out.data[at : at + new.size] = new
        return out


def foreign(data: bytes, width: int) -> Marked:
    """Bytes that are of no record."""
    none = np.full(len(data), _FOREIGN, dtype=np.int32)
    return Marked(np.frombuffer(data, dtype=np.uint8), none, none, width)


def joined(parts: Sequence[Marked]) -> Marked:
    """One after the other."""
    data, record, place = (np.concatenate([getattr(p, name) for p in parts]) for name in ("data", "record", "place"))
    return Marked(data, record, place, parts[0].width)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkedTruth:
    """Content of a log as it was written: stamps (count,) of eight bytes or none, and frames."""

    frames: tuple[bytes, ...]
    t_us: NDArray[np.int64]
    order: str
    """``>`` or ``<``, empty without times."""

    @property
    def width(self) -> int:
        """Bytes of a stamp."""
        return 8 if self.order else 0

    def stamp(self, record: int) -> bytes:
        return int(self.t_us[record]).to_bytes(8, "big" if self.order == ">" else "little") if self.order else b""

    def standing(self, log: Marked) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """(offset of the frame, record) of the records that are whole, and of frames that are whole but their stamp or
        signature."""
        whole: list[tuple[int, int]] = []
        partly: list[tuple[int, int]] = []
        raw = log.data.tobytes()
        end, last = 0, (0, 0)
        first, fourth = ((log.place == self.width + k) & (log.record != _FOREIGN) for k in (0, 3))
        places = {(k, int(log.record[k])) for k in np.flatnonzero(first).tolist()}
        # a cut after the first bytes of two frames that begin alike makes one of them
        places |= {(k - 3, int(log.record[k])) for k in np.flatnonzero(fourth).tolist() if k >= 3}
        for offset, record in sorted(places):
            frame = self.frames[record]
            checked = len(frame) - (SIGNATURE_LENGTH if frame[0] == MAGIC_V2 and frame[2] & 1 else 0)
            if raw[offset : offset + checked] != frame[:checked]:
                continue
            signature = raw[offset + checked : offset + len(frame)] == frame[checked:]
            stamped = offset >= self.width and raw[offset - self.width : offset] == self.stamp(record)
            # a byte lost from one record may be the same in the next, but it is of one of them only
            shared = stamped and offset - self.width < end
            if shared and whole and whole[-1] == last:
                partly.append(whole.pop())
            last = (offset, record)
            (whole if signature and stamped and not shared else partly).append(last)
            end = offset + len(frame)
        return whole, partly


def marked_log(truth: MarkedTruth, records: Sequence[int]) -> Marked:
    """These records, one after the other."""
    parts = [truth.stamp(i) + truth.frames[i] for i in records]
    sizes = [len(part) for part in parts]
    data = np.frombuffer(b"".join(parts), dtype=np.uint8)
    record = np.repeat(np.asarray(records, dtype=np.int32), sizes)
    place = np.concatenate([np.arange(size, dtype=np.int32) for size in sizes])
    return Marked(data, record, place, truth.width)


HEADER_FIELDS = ("stamp", "magic", "length", "incompat", "compat", "seq", "system", "component", "id", "payload", "end")
_OFFSETS_V2 = {"magic": 0, "length": 1, "incompat": 2, "compat": 3, "seq": 4, "system": 5, "component": 6}

Damager = Callable[[Marked, random.Random], Marked]


def _starts(log: Marked) -> list[int]:
    """Offsets at which records begin, bytes."""
    return np.flatnonzero((log.place == 0) & (log.record >= 0)).tolist()


def _stop_of(log: Marked, start: int) -> int:
    """End of the record that begins at ``start``."""
    same = log.record[start : start + 400] == log.record[start]
    return start + int(np.argmin(same)) if not same.all() else start + same.size


def _some(log: Marked, rng: random.Random, share: float = 0.05) -> list[int]:
    starts = _starts(log)
    return rng.sample(starts, min(len(starts), max(1, round(len(starts) * share * rng.random())))) if starts else []


def _field_offset(field: str, width: int, size: int, rng: random.Random) -> int:
    if field == "stamp":
        return rng.randrange(width) if width else 0
    if field == "id":
        return width + rng.choice((5, 7, 8, 9))
    if field == "payload":
        return rng.randrange(min(width + 10, size - 1), size)
    if field == "end":
        return size - 1 - rng.randrange(2)
    return width + _OFFSETS_V2[field]


def flipper(field: str) -> Damager:
    """Flips bits of one field in some records."""

    def flip(log: Marked, rng: random.Random) -> Marked:
        for start in _some(log, rng, 0.1):
            at = start + _field_offset(field, log.width, _stop_of(log, start) - start, rng)
            if at < log.size:
                log = log.overwritten(at, bytes([log.data[at] ^ rng.randrange(1, 256)]))
        return log

    return flip


def _span(log: Marked, rng: random.Random, longest: int = 4096) -> tuple[int, int]:
    start = rng.randrange(log.size)
    return start, min(log.size, start + rng.randrange(1, min(longest, max(2, log.size // 2))))


def cut_start(log: Marked, rng: random.Random) -> Marked:
    return log.part(_span(log, rng)[1] % (log.size // 2 + 1), log.size)


def cut_end(log: Marked, rng: random.Random) -> Marked:
    return log.part(0, max(1, log.size - rng.randrange(1, min(log.size, rng.choice((30, 4096))))))


def hole_removed(log: Marked, rng: random.Random) -> Marked:
    return log.without(*_span(log, rng))


def hole_zeroed(log: Marked, rng: random.Random) -> Marked:
    start, stop = _span(log, rng)
    return log.overwritten(start, bytes(stop - start))


def overwritten(log: Marked, rng: random.Random) -> Marked:
    start, stop = _span(log, rng, 600)
    return log.overwritten(start, rng.randbytes(stop - start))


def inserted(log: Marked, rng: random.Random) -> Marked:
    for _ in range(rng.randrange(1, 20)):
        kind = rng.randrange(6)
        data = (
            rng.randbytes(rng.choice((1, 7, 64, 300))),
            b"\xfd\xff\x00",
            b"\xfe\xff\x00\x01\x01\x00",
            b"Init ArduCopter V4.6",
            bytes(rng.randrange(1, 64)),
            b"\xfd" * rng.randrange(1, 40),
        )[kind]
        at = rng.randrange(log.size + 1) if rng.random() < 0.3 else rng.choice([*_starts(log), log.size])
        log = log.with_bytes(at, data)
    return log


def zero_tail(log: Marked, rng: random.Random) -> Marked:
    return log.with_bytes(log.size, bytes(rng.choice((1, 7, 8, 9, 512, 4096))))


def torn(log: Marked, rng: random.Random) -> Marked:
    """Some records lose their end: the disk was full, then had room again."""
    for start in sorted(_some(log, rng), reverse=True):
        stop = _stop_of(log, start)
        log = log.without(start + rng.randrange(1, max(2, stop - start)), stop)
    return log


def headless(log: Marked, rng: random.Random) -> Marked:
    """Some records lose their beginning."""
    for start in sorted(_some(log, rng), reverse=True):
        log = log.without(start, start + rng.randrange(1, max(2, _stop_of(log, start) - start)))
    return log


def repeated(log: Marked, rng: random.Random) -> Marked:
    """A block is there twice: a page was written again."""
    start, stop = _span(log, rng)
    return joined([log.part(0, stop), log.part(start, stop), log.part(stop, log.size)])


def swapped(log: Marked, rng: random.Random) -> Marked:
    """Two blocks changed places."""
    a, b, c = sorted(rng.randrange(log.size + 1) for _ in range(3))
    return joined([log.part(0, a), log.part(b, c), log.part(a, b), log.part(c, log.size)])


def interleaved(one: Marked, other: Marked, rng: random.Random) -> Marked:
    """Two programs wrote one file through buffers of their own: records are cut by the other's."""
    parts: list[Marked] = []
    logs, at = [one, other], [0, 0]
    block = rng.choice((512, 4096))
    while at[0] < one.size or at[1] < other.size:
        i = rng.randrange(2)
        stop = min(logs[i].size, at[i] + block)
        parts.append(logs[i].part(at[i], stop))
        at[i] = stop
    return joined(parts)


DAMAGES: dict[str, Damager] = {
    **{f"flipped {field}": flipper(field) for field in HEADER_FIELDS},
    "start cut off": cut_start,
    "end cut off": cut_end,
    "hole removed": hole_removed,
    "hole zeroed": hole_zeroed,
    "overwritten with noise": overwritten,
    "noise inserted": inserted,
    "zeros at the end": zero_tail,
    "records torn": torn,
    "records headless": headless,
    "block repeated": repeated,
    "blocks swapped": swapped,
}


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
class LogScore(FuzzScore):
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
    """Records among those with a stamp a minute or more off that was accepted."""
    damaged_bytes: int = 0
    false_bytes: int = 0
    """Undamaged bytes named as damaged."""
    missed_bytes: int = 0
    """Damaged bytes in no range."""
    wrong_counts: int = 0
    """Logs whose summary disagrees with their rows."""
    slowest_ms: float = 0.0


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
    """Compare what the reader made of a log with what is in it."""
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
