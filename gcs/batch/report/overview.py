"""The page over all flights of a batch: sums, failures, flights from the worst to the best and why, vehicles.

It also has how well a flight went, in words, and which of two went worse.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.batch.flights_table import read_flights
from gcs.batch.jobs import FAILED, FLIGHTS_TABLE, FlightRecord, ScoreRecord, VehicleCall
from gcs.batch.stores import ResultStore
from gcs.certainty import certainty
from gcs.errors import BatchError
from gcs.report.page.html import Line, Section, card, empty, fixed, listed, page, section, table
from gcs.report.rollcall import WITHOUT_POSITION

LATE_S: Final = 10.0
"""Most vehicles are named after two or three seconds in view."""
UNSURE: Final = 0.9
"""Confidence as in the score: below it a name counts as not sure."""
WRONG: Final = 0.02
"""Share of boxes without their right name that is worth a word."""
OUTAGE_S: Final = 10.0
"""Time without a position after which a vehicle may be anywhere near, s; radios hold positions up for less."""
UNNAMED: Final = 0.5
"""Share of boxes without a name beyond which they are more than strangers that drive by."""
MAX_FLIGHTS: Final = 2000
"""Most flights of each kind that one page lists; a browser shows as many at once."""
MAX_VEHICLES: Final = 1000
_FIGURES: Final = ("right", "precision", "name changes", "calibration error")
"""Columns of flights whose truth is known."""
Finding = tuple[float, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightJudgement:
    """A flight that was done, judged."""

    record: FlightRecord
    rank: int
    """Rank of the worst finding's kind, 0 the worst."""
    amount: float
    """Amount by which findings of one kind are compared."""
    reasons: tuple[str, ...]
    """Findings, the worst first."""

    @property
    def level(self) -> str:
        """Level of the worst, as a card shows it."""
        return "bad" if self.rank <= _CHECKS.index(_nobody_named) else "warn"

    @property
    def order(self) -> tuple[int, float, str]:
        """The worst flight sorts first."""
        return self.rank, -self.amount, self.record.flight


def judge(record: FlightRecord) -> FlightJudgement:
    """Judge what a flight's record says of its names."""
    found = [(rank, finding) for rank, check in enumerate(_CHECKS) if (finding := check(record)) is not None]
    rank, amount = (found[0][0], found[0][1][0]) if found else (len(_CHECKS), 0.0)
    return FlightJudgement(record=record, rank=rank, amount=amount, reasons=tuple(text for _, (_, text) in found))


def mean_confidence(records: Iterable[FlightRecord]) -> float:
    """Return the mean confidence of all named boxes; NaN without any."""
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


def _nobody_named(record: FlightRecord) -> Finding | None:
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


_CHECKS: tuple[Callable[[FlightRecord], Finding | None], ...] = (
    _wrong,
    _false_strangers,
    _alarms,
    _outage,
    _nobody_named,
    _never_named,
    _not_right,
    _unnamed,
    _late,
    _unsure,
    _absent,
)
"""Checks of a flight, the worst finding first."""


def read_results(results: ResultStore) -> list[FlightRecord]:
    """The flights of a batch.

    Raises:
        BatchError: there is no table of flights, or it is none.
        StoreError: the store does not answer.
    """
    data = results.read(FLIGHTS_TABLE)
    if data is None:
        raise BatchError(f"{results.address}: no {FLIGHTS_TABLE} in it; give the folder that gcs batch run -o wrote")
    return read_flights(data, f"{results.address}/{FLIGHTS_TABLE}")


def batch_page(records: Sequence[FlightRecord], where: str) -> str:
    """The whole page, one HTML file that needs nothing else."""
    failed = [record for record in records if record.status == FAILED]
    done = [record for record in records if record.status != FAILED]
    judged = sorted(map(judge, done), key=lambda each: each.order)
    lead = f"{len(done)} of {len(records)} flights were named, {len(failed)} failed."
    sections = [_failed(failed), _flights(judged), _vehicles(done), _sums(done, failed)]
    return page(f"Batch {where}", lead, _at_a_glance(judged, failed), [part for part in sections if part])


def _at_a_glance(judged: Sequence[FlightJudgement], failed: Sequence[FlightRecord]) -> tuple[str, str, str]:
    """The cards: who was named, in which flights something went wrong, which failed."""
    done = [each.record for each in judged]
    named, vehicles = _sum(done, "named"), _sum(done, "vehicles")
    confidence = certainty(mean_confidence(done))
    sums: list[Line] = [(f"confidence of names, on average: {confidence}", "")] if confidence else []
    if scores := [record.score for record in done if record.score is not None]:
        sums += [(f"{what}: {figure}", "") for what, figure in _score_sums(scores)]
    else:
        sums.append(("how right the names were is not known: no flight has its truth", "warn"))
    wrong = [each for each in judged if each.reasons]
    worst = [(f"{each.record.flight}: {each.reasons[0]}", each.level) for each in wrong]
    errors = [(f"{record.flight}: {record.error or ''}", "bad") for record in failed]
    kinds = "good" if named == vehicles else "warn" if named else "bad", wrong[0].level if wrong else "good"
    return (
        card("Who was named", (f"{named} of {vehicles}", "vehicles were named"), sums, kinds[0]),
        card("What went wrong", (f"{len(wrong)} of {len(done)}", "flights want a look"), listed(worst), kinds[1]),
        card(
            "What failed",
            (str(len(failed)), f"flight{'s' * (len(failed) != 1)} failed"),
            listed(errors),
            "bad" if failed else "good",
        ),
    )


def _sum(records: Iterable[FlightRecord], name: str) -> int:
    return sum(getattr(record, name) or 0 for record in records)


def _share(part: float, whole: float) -> str:
    return fixed(100 * part / whole if whole else math.nan, 1, "%")


def _sums(done: Sequence[FlightRecord], failed: Sequence[FlightRecord]) -> Section:
    boxes, unnamed = _sum(done, "boxes"), _sum(done, "unnamed")
    scores = [record.score for record in done if record.score is not None]
    span_s, cpu_s = (math.fsum(getattr(each, name) or 0.0 for each in done) for name in ("span_s", "cpu_seconds"))
    rows = [
        ("flights named", str(len(done))),
        ("flights failed", str(len(failed))),
        ("hours of flight", fixed(span_s / 3600, 2)),
        ("frames looked at", str(_sum(done, "frames"))),
        ("frames without boxes that perhaps nobody looked at", str(_sum(done, "skipped_frames"))),
        ("boxes", str(boxes)),
        ("boxes with a name", _share(boxes - unnamed, boxes)),
        ("mean confidence of names", certainty(mean_confidence(done)) or "–"),
        ("flights with known truth", str(len(scores))),
        ("alarms", str(_sum(done, "alarms"))),
        *_score_sums(scores),
        ("core hours", fixed(cpu_s / 3600, 2)),
        ("most memory of a worker", fixed(max((each.peak_bytes or 0 for each in done), default=0) / 1e6, 0, "MB")),
        ("Rollcall", _counted(record.version for record in (*done, *failed))),
        ("options", _counted("none" if each.options == "{}" else each.options for each in (*done, *failed))),
    ]
    return section("Sums", table(("sum", "all flights"), rows, right=("all flights",), caption="Sums over all flights"))


def _score_sums(scores: Sequence[ScoreRecord]) -> list[tuple[str, str]]:
    """Return sums over all flights of which the truth is known."""
    rows = []
    for what, name in (("right names", "right"), ("precision of names", "precision")):
        known = [value for score in scores if (value := getattr(score, name)) is not None]
        rows.append((f"{what} in them, mean", fixed(100 * statistics.fmean(known), 1, "%") if known else "–"))
        rows.append((f"{what} in the worst", fixed(100 * min(known), 1, "%") if known else "–"))
    strangers = [score.false_strangers for score in scores if score.false_strangers is not None]
    rows += [
        ("wrong and sure", fixed(math.fsum(score.wrong_sure_s for score in scores), 1, "s") if scores else "–"),
        ("surely called strangers, and ours, in the worst", fixed(100 * max(strangers), 1, "%") if strangers else "–"),
        ("names that changed", str(sum(score.switches for score in scores)) if scores else "–"),
    ]
    return rows


def _counted(values: Iterable[str]) -> str:
    """The values there are; with how many flights each, where they differ."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{value} ({count} flights)" for value, count in counts.most_common())


def _failed(failed: Sequence[FlightRecord]) -> Section | None:
    if not failed:
        return None
    rows = [
        (record.flight, record.error or "", str(record.attempts), "kept" if record.earlier_result else "none")
        for record in sorted(failed, key=lambda record: record.flight)[:MAX_FLIGHTS]
    ]
    names = ("flight", "what is wrong", "attempts", "earlier result")
    listed = table(names, rows, right=("attempts",), caption="Flights that failed")
    return section("Failed flights", listed, _left_out(len(failed), MAX_FLIGHTS, "failed flights"))


def _left_out(count: int, most: int, what: str) -> str:
    return empty(f"{count - most} more {what} are in {FLIGHTS_TABLE}.") if count > most else ""


def _flights(judged: Sequence[FlightJudgement]) -> Section:
    if not judged:
        return section("Flights, the worst first", empty("Not one flight was named."))
    scored = any(each.record.score is not None for each in judged)
    rows = []
    for each in judged[:MAX_FLIGHTS]:
        record = each.record
        boxes, unnamed = record.boxes or 0, record.unnamed or 0
        rows.append(
            (
                record.flight,
                "; ".join(each.reasons) or "–",
                f"{record.named} of {record.vehicles}",
                fixed(record.span_s if record.span_s is not None else math.nan, 0, "s"),
                str(boxes),
                _share(boxes - unnamed, boxes),
                certainty(mean_confidence([record])) or "–",
                "–" if record.alarms is None else str(record.alarms),
                *(_figures(record.score) if scored else ()),
            )
        )
    figures = ("named", "lasted", "boxes", "with a name", "confidence", "alarms", *(_FIGURES if scored else ()))
    listed = table(
        ("flight", "reason", *figures), rows, right=figures, caption="Flights that were named, the worst first"
    )
    return section("Flights, the worst first", listed, _left_out(len(judged), MAX_FLIGHTS, "better flights"))


def _figures(score: ScoreRecord | None) -> tuple[str, ...]:
    """Score of a flight's names, as ``_FIGURES``."""
    if score is None:
        return ("–",) * len(_FIGURES)
    shares = (score.right, score.precision)
    right, precision = ("–" if share is None else fixed(100 * share, 1, "%") for share in shares)
    return right, precision, str(score.switches), "–" if score.ece is None else fixed(score.ece, 3)


def _vehicles(done: Sequence[FlightRecord]) -> Section | None:
    calls: dict[tuple[str, int], list[VehicleCall]] = {}
    for record in done:
        for call in record.roll_call:
            calls.setdefault((call.name, call.system_id), []).append(call)
    rows = []
    for (name, system_id), each in sorted(calls.items(), key=lambda item: (_share_named(item[1]), item[0]))[
        :MAX_VEHICLES
    ]:
        first_s = [call.first_named_s for call in each if call.first_named_s is not None]
        boxes = sum(call.boxes for call in each)
        confidence = sum(call.boxes * (call.confidence or 0.0) for call in each) / boxes if boxes else math.nan
        rows.append(
            (
                name,
                str(system_id),
                f"{sum(call.boxes > 0 for call in each)} of {len(each)}",
                str(boxes),
                certainty(confidence) or "–",
                fixed(statistics.median(first_s) if first_s else math.nan, 1, "s"),
            )
        )
    if not rows:
        return None
    right = ("system id", "flights", "boxes", "confidence", "named after, median")
    listed = table(("vehicle", *right), rows, right=right, caption="Vehicles over all flights, the worst first")
    return section("Vehicles, the worst first", listed, _left_out(len(calls), MAX_VEHICLES, "vehicles"))


def _share_named(calls: Sequence[VehicleCall]) -> float:
    return sum(call.boxes > 0 for call in calls) / len(calls)
