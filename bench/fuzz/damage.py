"""The ways in which a log is damaged: by disks, radios, other writers, clocks and a hand that flips bits."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np

from bench.fuzz.marked import Marked, joined

HEADER_FIELDS = ("stamp", "magic", "length", "incompat", "compat", "seq", "system", "component", "id", "payload", "end")
_OFFSETS_V2 = {"magic": 0, "length": 1, "incompat": 2, "compat": 3, "seq": 4, "system": 5, "component": 6}

Damager = Callable[[Marked, random.Random], Marked]


def _starts(log: Marked) -> list[int]:
    """Where records begin."""
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
