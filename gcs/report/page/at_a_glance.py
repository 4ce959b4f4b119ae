"""Answers first: who was named, how surely and for how long; what went wrong; how far to trust it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from gcs.certainty import CONFIRMED, certainty
from gcs.health.alarm_history import AlarmSpan
from gcs.report.page.flight_summary import FlightSummary
from gcs.report.page.html import Line, card, fixed, listed
from gcs.report.page.timeline import clock
from gcs.report.page.vehicle_parts import standing_of
from gcs.report.score import Matched, score
from gcs.report.vehicle_names import text_with_sender

MAX_NAMES: Final = 8
"""Most vehicles named in one line; the roll call has all of them."""


def at_a_glance(record: FlightSummary, matched: Matched | None, lacks: Sequence[str]) -> tuple[str, str, str]:
    """The three cards.

    Args:
        matched: names beside the truth, None unknown.
        lacks: what the recording does not have, and what that costs.
    """
    return _named(record), _wrong(record, matched), _doubtful(record, matched, lacks)


def _named(record: FlightSummary) -> str:
    named, count = record.rollcall.named, len(record.vehicles)
    kind = "good" if named == count else "warn" if named else "bad"
    return card("Who was named", (f"{named} of {count}", "vehicles were named"), [*_standings(record)], kind)


def _standings(record: FlightSummary) -> Iterator[Line]:
    rows = record.rollcall.rows()
    for standing in ("confirmed", "tentative"):
        if names := [row.name for row in rows if standing_of(record, row) == standing]:
            more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
            yield f"{standing}: {', '.join(names[:MAX_NAMES])}{more}", standing
    never = (row for row in rows if standing_of(record, row) == "never named")
    yield from listed([(f"never named: {row.name} ({row.remark})", "never") for row in never])
    if seen := [row for row in rows if row.boxes and row.frames_in_view]:
        least = min(seen, key=lambda row: row.share)
        mean = sum(row.share for row in seen) / len(seen)
        least_named = f", {least.name} least, in {_percent(least.share)}" if len(seen) > 1 else ""
        yield f"with their name in {_percent(mean)} of the frames in view{least_named}", ""


def _wrong(record: FlightSummary, matched: Matched | None) -> str:
    sure_s = score(matched).wrong_sure_s if matched is not None else 0.0
    lines: list[Line] = [(f"wrong and sure for {clock(sure_s)}", "bad")] if sure_s > 0 else []
    lines += listed(_alarms(record))
    # counted by what they are about: one cause may give a hundred, each in other words
    besides = Counter(event.kind for event in record.events if event.kind not in ("mark", "operator"))
    lines += [(f"other warnings about {kind}: {count}", "warn") for kind, count in besides.most_common(3)]
    marks = (event for event in record.events if event.kind == "mark")
    lines += listed([(f"marked: {text_with_sender(event, record.name_of)}", "") for event in marks])
    kind = "bad" if sure_s > 0 or record.rollcall.alarms.alarms else "warn" if lines else "good"
    figure, _, what = record.rollcall.reports.partition(" ")
    summed = (figure, what) if lines else ("", "nothing that is known of")
    return card("What went wrong", summed, lines, kind)


def _alarms(record: FlightSummary) -> list[Line]:
    """Each trouble once, the gravest and longest first, with how often and how long it was on."""
    troubles: dict[tuple[bool, str], list[AlarmSpan]] = {}
    for span in record.alarms:
        troubles.setdefault((span.alarm.level != "alarm", span.alarm.key), []).append(span)
    lines = []
    for (lesser, _), spans in troubles.items():
        on_s = _on_s(record, spans)
        often = f"{len(spans)} times, " if len(spans) > 1 else ""
        lines.append((lesser, -on_s, f"{spans[0].alarm.text} ({often}{clock(on_s)})"))
    return [(text, "warn" if lesser else "bad") for lesser, _, text in sorted(lines)]


def _doubtful(record: FlightSummary, matched: Matched | None, lacks: Sequence[str]) -> str:
    calls = record.rollcall
    doubts: dict[str, list[AlarmSpan]] = {}
    for span in record.alarms:
        if span.alarm.doubts_name:
            doubts.setdefault(record.name_of(span.alarm.system_id), []).append(span)
    longest = sorted(((_on_s(record, spans), name) for name, spans in doubts.items()), reverse=True)
    lines = listed([(f"{name}: its name in doubt for {clock(on_s)}", "bad") for on_s, name in longest])
    unsure = (row for row in calls.rows() if row.boxes and row.confidence < CONFIRMED)
    lines += listed([(f"{row.name}: {certainty(row.confidence)} sure, on average", "tentative") for row in unsure])
    lines += [(calls.skipped, "warn")] * bool(calls.skipped)
    if once := sum(bool(span.alarm.reported) for span in record.alarms):
        lines.append((f"{once} of the alarms only the flight tells, or only its replay", "warn"))
    lines += listed([(text, "warn") for text in lacks])
    unnamed = (_percent(calls.unnamed / calls.boxes), "of the boxes have no name") if calls.boxes else ("", "no boxes")
    if matched is None:
        return card("How far to trust it", unnamed, lines, "warn")
    lines.append((" ".join(unnamed), ""))
    summed = (_percent(score(matched).precision), "of the names were right")
    return card("How far to trust it", summed, lines, "warn" if len(lines) > 1 else "good")


def _on_s(record: FlightSummary, spans: Sequence[AlarmSpan]) -> float:
    """Time in which any of some alarms was on: two at once last no longer than one."""
    on_us, reached_us = 0, record.start_us
    for span in sorted(spans, key=lambda span: span.alarm.since_us):
        on_us += max(span.until_us - max(span.alarm.since_us, reached_us), 0)
        reached_us = max(reached_us, span.until_us)
    return on_us * 1e-6


def _percent(share: float) -> str:
    return fixed(100 * share, 1, "%")
