"""Checks a telemetry log: is it complete, are its times plausible, did several programs write it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mavlink.protocol.framing import split
from mavlink.protocol.packet import MAGIC_V1, MAGIC_V2
from mavlink.tlog.clocks import SenderClock, sender_clocks
from mavlink.tlog.file_type import looks_like, sent_as_text
from mavlink.tlog.index import Damage
from mavlink.tlog.log import Tlog
from mavlink.tlog.scan import Frames, Ints
from mavlink.tlog.timestamps import TIME_LENGTH, TimeSource, read_times

_MAX_GAPS = 1000
"""Damaged places in which split frames are searched for: bounds the time."""
_LONGEST_GAP = 300
"""Bytes: a longer damaged place holds more than a part of one frame (at most 280 bytes)."""
_MIN_CUT_FRAMES = 8
"""Least number of frames without an end in a row: fewer may be chance."""
_WINDOW = 1 << 20
"""Bytes read at a time; one such window shows the byte order of the times."""
_FAR_BACK_US = 1_000_000
"""Times that step back further than this are counted apart from the jitter of several links."""
_MIN_COLLISIONS = 3
"""Torn frames and crossed times from which several programs wrote the file; fewer may be other damage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TlogCheck:
    """The result of checking a log."""

    size_bytes: int
    records: int
    """Whole frames."""
    whole_records: int
    """Records with a usable time; all of them in a file without times."""
    unknown: int
    """Records of messages that are not in the dialect."""
    version_1: int
    version_2: int
    signed: int
    time_source: TimeSource
    bad_times: int
    """Records without a usable time, which got that of the record before; 0 in a file without times."""
    backward_steps: int
    """Records whose time is earlier than that of the record before."""
    far_backward_steps: int
    """Backward steps of more than a second."""
    clocks: tuple[SenderClock, ...]
    torn_by_others: int
    """Frames cut in two by other records and whole when put together: several programs wrote the file."""
    times_crossed: int
    """Damaged places behind which the time is earlier than in front: several programs wrote over each other."""
    cut_short: int
    """Frames of a log in which every frame lacks its end."""
    looks_like: str
    """Other file type whose signature it begins with; empty for none."""
    sent_as_text: bool
    """True if every line feed follows a carriage return: the log was transferred as text."""
    damaged_bytes: int
    damage: tuple[Damage, ...]

    @property
    def several_writers(self) -> bool:
        """True if several programs wrote into the file at once."""
        return self.torn_by_others + self.times_crossed >= _MIN_COLLISIONS and not self.sent_as_text

    @property
    def speed(self) -> float:
        """Seconds of the senders' clocks per second of stamps, by the sender with most samples; NaN unknown."""
        known = [clock for clock in self.clocks if clock.speed == clock.speed]
        return max(known, key=lambda clock: clock.samples).speed if known else float("nan")

    @property
    def whole(self) -> bool:
        """True if every byte belongs to a record with a usable time."""
        return not self.damage and not self.bad_times and self.records > 0


def check(tlog: Tlog) -> TlogCheck:
    """Check a whole log."""
    index = tlog.index
    untimed = index.time_source == "none"
    cut_short, source = (0, index.time_source) if len(index) else _cut_short(tlog)
    magic = tlog.data[index.offset]
    back_us = -np.diff(index.t_us)
    return TlogCheck(
        size_bytes=tlog.data.size,
        records=len(index),
        whole_records=len(index) if untimed else int(np.count_nonzero(index.time_ok)),
        unknown=index.counts.unknown,
        version_1=int(np.count_nonzero(magic == MAGIC_V1)),
        version_2=int(np.count_nonzero(magic == MAGIC_V2)),
        signed=int(np.count_nonzero(index.signed)),
        time_source=source,
        bad_times=0 if untimed else index.counts.bad_times,
        backward_steps=index.counts.backward_steps,
        far_backward_steps=int(np.count_nonzero(back_us > _FAR_BACK_US)),
        clocks=sender_clocks(tlog) if len(index) else (),
        torn_by_others=_torn_by_others(tlog),
        times_crossed=int(np.isin(_record_starts(tlog)[1:][back_us > 0], [d.stop for d in index.damage]).sum()),
        cut_short=cut_short,
        looks_like=looks_like(tlog.data),
        sent_as_text=len(index) > 0 and sent_as_text(tlog.data),
        damaged_bytes=sum(damage.stop - damage.start for damage in index.damage),
        damage=index.damage,
    )


def _record_starts(tlog: Tlog) -> Ints:
    return tlog.index.offset - (0 if tlog.index.time_source == "none" else TIME_LENGTH)


def _torn_by_others(tlog: Tlog) -> int:
    """Frames whose two halves lie in neighbouring gaps."""
    gaps = [
        tlog.data[d.start : min(d.stop, d.start + _LONGEST_GAP)].tobytes()
        for d in tlog.index.damage[:_MAX_GAPS]
        if d.stop - d.start < _LONGEST_GAP and d.reason != "impossible time"
    ]
    return sum(_joins(one, other) for one, other in pairwise(gaps))


def _joins(one: bytes, other: bytes) -> bool:
    """Tell whether a frame begins somewhere in one gap and ends where the next gap ends, behind a part of another's."""
    for at, byte in enumerate(one[:-1]):
        if byte not in (MAGIC_V1, MAGIC_V2):
            continue
        length = one[at + 1] + (8 if byte == MAGIC_V1 else 12)
        for missing in range(max(1, length - (len(one) - at)), min(length - 2, len(other)) + 1):
            frame = one[at : at + length - missing] + other[-missing:]
            if split(frame)[1].good == 1 and len(frame) == length:
                return True
    return False


def _cut_short(tlog: Tlog) -> tuple[int, TimeSource]:
    """MAVLink 1 frames that have only as many bytes as their payload, each with a time, and what those times are.

    Some programs wrote whole logs of them.
    """
    data = tlog.data
    seen = count = 0
    sample = Frames(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
    for start in range(0, data.size, _WINDOW):
        at = np.flatnonzero(data[start : start + _WINDOW] == MAGIC_V1) + start
        at = at[(at >= TIME_LENGTH) & (at + 1 < data.size)]
        length = data[at + 1].astype(np.int64)
        following = at + length + TIME_LENGTH
        chained = following < data.size
        chained[chained] = data[following[chained]] == MAGIC_V1
        seen, count = seen + at.size, count + int(np.count_nonzero(chained))
        if not sample.offset.size:
            sample = Frames(at[chained], length[chained])
    if count < max(_MIN_CUT_FRAMES, seen // 4):
        return 0, "none"
    return count, read_times(data, sample)[2]
