"""How well a flight went, in words, and which of two went worse."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from gcs.batch.jobs import FlightRecord
from gcs.report.rollcall import WITHOUT_POSITION

LATE_S: Final = 10.0
"""Most vehicles are named after two or three seconds in view."""
UNSURE: Final = 0.9
"""Confidence as in the score: below it a name counts as not sure."""
WRONG: Final = 0.02
"""Share of boxes without their right name that is worth a word."""
OUTAGE_S: Final = 10.0
"""Without a position for so long a vehicle may be anywhere near; radios hold positions up for less."""
UNNAMED: Final = 0.5
"""More boxes without a name than this are more than strangers that drive by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightJudgement:
    """A flight that was done, judged."""

    record: FlightRecord
    rank: int
    """The kind of the worst that was found, 0 the worst."""
    amount: float
    """How much of it."""
    reasons: tuple[str, ...]
    """All that was found, the worst first."""

    @property
    def level(self) -> str:
        """How grave the worst is, as a card shows it."""
        return "bad" if self.rank <= _LOOKS.index(_nobody) else "warn"

    @property
    def order(self) -> tuple[int, float, str]:
        """The worst flight sorts first."""
        return self.rank, -self.amount, self.record.flight


Finding = tuple[float, str]


def judge(record: FlightRecord) -> FlightJudgement:
    """Judge what a flight's record says of its names."""
    found = [(rank, finding) for rank, look in enumerate(_LOOKS) if (finding := look(record)) is not None]
    rank, amount = (found[0][0], found[0][1][0]) if found else (len(_LOOKS), 0.0)
    return FlightJudgement(record=record, rank=rank, amount=amount, reasons=tuple(text for _, (_, text) in found))


def mean_confidence(records: Iterable[FlightRecord]) -> float:
    """Over all named boxes; NaN without any."""
    calls = [call for record in records for call in record.roll_call if call.confidence is not None]
    boxes = sum(call.boxes for call in calls)
    return sum(call.boxes * (call.confidence or 0.0) for call in calls) / boxes if boxes else math.nan


def _wrong(record: FlightRecord) -> Finding | None:
    wrong_s = record.score.wrong_sure_s if record.score else 0.0
    return (wrong_s, f"wrong and sure for {wrong_s:.1f} s") if wrong_s > 0 else None


def _false_strangers(record: FlightRecord) -> Finding | None:
    share = (record.score.false_strangers or 0.0) if record.score else 0.0
    return (share, f"{share:.1%} of boxes surely called strangers are ours") if share > 0 else None


def _alarms(record: FlightRecord) -> Finding | None:
    alarms, warnings = record.alarms or 0, record.warnings or 0
    if not alarms:
        return None
    return alarms + 1e-6 * warnings, f"{alarms} alarms, {warnings} warnings"


def _outage(record: FlightRecord) -> Finding | None:
    """Vehicles that had a position, and had none for long."""
    silent = {
        call.name: call.longest_silence_s
        for call in record.roll_call
        if (call.longest_silence_s or 0.0) > OUTAGE_S and call.outcome not in WITHOUT_POSITION
    }
    longest_s = max(silent.values(), default=None, key=lambda each: each or 0.0)
    if longest_s is None:
        return None
    whole = len(silent) == len(record.roll_call) > 1
    who = f"the whole fleet ({len(silent)} vehicles)" if whole else ", ".join(silent)
    return len(silent) + 1e-9 * longest_s, f"no position for up to {longest_s:.0f} s: {who}"


def _nobody(record: FlightRecord) -> Finding | None:
    if not record.boxes:
        return 2.0, "not one vehicle was detected"
    return None if record.named else (1.0, "nobody was named")


def _never_named(record: FlightRecord) -> Finding | None:
    if not record.named:
        return None
    never = [call for call in record.roll_call if not call.boxes and call.frames_in_view]
    most = max((call.frames_in_view for call in never), default=0)
    text = f"in view, never named: {', '.join(call.name for call in never)} ({most} frames)"
    return (len(never) + most * 1e-9, text) if never else None


def _not_right(record: FlightRecord) -> Finding | None:
    right = record.score.right if record.score else None
    if right is None or right >= 1 - WRONG:
        return None
    return 1 - right, f"{right:.1%} of boxes with the right name"


def _unnamed(record: FlightRecord) -> Finding | None:
    share = (record.unnamed or 0) / record.boxes if record.boxes else 0.0
    return (share, f"{share:.0%} of boxes without a name") if share > UNNAMED else None


def _late(record: FlightRecord) -> Finding | None:
    late = {call.name: call.first_named_s for call in record.roll_call if (call.first_named_s or 0.0) > LATE_S}
    if not late:
        return None
    name, late_s = max(late.items(), key=lambda item: item[1] or 0.0)
    others = f" and {len(late) - 1} more late" if len(late) > 1 else ""
    return late_s or 0.0, f"{name} named after {late_s:.0f} s{others}"


def _unsure(record: FlightRecord) -> Finding | None:
    confidence = mean_confidence([record])
    return (1 - confidence, f"mean confidence {confidence:.2f}") if confidence < UNSURE else None


def _absent(record: FlightRecord) -> Finding | None:
    """Vehicles that could not be named, by why."""
    absent: dict[str, list[str]] = {}
    for call in record.roll_call:
        if not call.boxes and not call.frames_in_view and call.outcome:
            absent.setdefault(call.outcome + f" ({call.why})" * bool(call.why), []).append(call.name)
    text = "; ".join(f"{why}: {', '.join(names)}" for why, names in absent.items())
    return (sum(map(len, absent.values())), text) if absent else None


_LOOKS: tuple[Callable[[FlightRecord], Finding | None], ...] = (
    _wrong,
    _false_strangers,
    _alarms,
    _outage,
    _nobody,
    _never_named,
    _not_right,
    _unnamed,
    _late,
    _unsure,
    _absent,
)
"""The worst first."""
