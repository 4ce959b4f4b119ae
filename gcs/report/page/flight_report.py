"""The report of one flight, put together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Final

from gcs.report.page.at_a_glance import at_a_glance
from gcs.report.page.flight_summary import FlightSummary
from gcs.report.page.html import empty, page, section, table, whole_words
from gcs.report.page.map_drawing import draw_map
from gcs.report.page.score_parts import score_parts
from gcs.report.page.stills import Stills
from gcs.report.page.timeline import clock, draw_sources, draw_timeline
from gcs.report.page.vehicle_parts import rollcall_table, vehicle_parts
from gcs.report.score import Matched
from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Reported

MAX_LISTED: Final = 1000
"""Alarms, and other events, of one flight that the page lists; the rest is counted."""
_REPORTED: Final[Mapping[Reported, str]] = {
    "": "",
    "then": "the flight alone",
    "now": "its replay alone",
}
"""Words for whether the flight or its replay reported something, where it is not both."""
_LEVELS: Final = MappingProxyType({"level": MappingProxyType({"alarm": "bad", "warning": "warn"}).get})


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Sources that a report was made of."""

    name: str
    """Name of the recording."""
    lacks: Sequence[str] = ()
    """Gaps of the recording, and what they cost, a line each."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Programs, options and networks, by what they are."""
    files: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file that was read, by name."""
    imported: Sequence[tuple[str, str]] = ()
    """Account of the files from other programs that the recording was made from."""
    spans: Sequence[tuple[str, Sequence[tuple[float, float]]]] = ()
    """Spans of the film, seconds from and to, in which each of these files tells of vehicles."""


def flight_report(record: FlightSummary, stills: Stills, matched: Matched | None, about: Provenance) -> str:
    """Make the page of one flight.

    Args:
        matched: names beside the truth, None unknown.
    """
    calls = record.rollcall
    began = datetime.fromtimestamp(record.start_us * 1e-6, UTC)
    lead = (
        f"{began:%Y-%m-%d %H:%M:%S} UTC, {clock(record.span_s)} long. "
        f"{calls.boxes - calls.unnamed} of {calls.boxes} boxes in {calls.frames} frames have a name."
    )
    truth = "Nobody recorded which box is which vehicle: how right the names were is not known."
    sections = [
        section("Roll call", rollcall_table(record)),
        section("Time line", draw_timeline(record)),
        section("Map", draw_map(record)),
        section("Moments", stills.drawn(record)),
        section("Alarms and warnings", _alarms(record), _events(record)),
        section("Vehicles", vehicle_parts(record)),
        section("Names beside the truth", empty(truth) if matched is None else score_parts(matched)),
        section("What the recording lacks", _lines(about.lacks)),
        section("What this page was made of", _made_of(about)),
    ]
    return page(f"Flight {about.name}", lead, at_a_glance(record, matched, about.lacks), sections)


def _alarms(record: FlightSummary) -> str:
    if not record.alarms:
        return empty("No alarm was raised.")
    rows = [
        (
            str(number),
            clock((span.alarm.since_us - record.start_us) * 1e-6),
            clock((span.until_us - record.start_us) * 1e-6),
            span.alarm.level,
            span.alarm.text,
            span.alarm.advice,
            _REPORTED[span.alarm.reported],
        )
        for number, span in enumerate(record.alarms[:MAX_LISTED], 1)
    ]
    more = _left_out(len(record.alarms), "alarms")
    columns = ("number", "from", "until", "level", "what", "what to do", "told by")
    return _reports(columns, rows, columns[:3], "Alarms") + more


def _events(record: FlightSummary) -> str:
    if not record.events:
        return empty("No warning was given.")
    # what the operator did and marked is always listed
    own = [event for event in record.events if event.kind in ("mark", "operator")]
    listed = {id(event) for event in (*own, *record.events)[: max(MAX_LISTED, len(own))]}
    rows = [
        (
            clock((event.t_us - record.start_us) * 1e-6),
            event.level,
            event.kind,
            text_with_sender(event, record.name_of),
            _REPORTED[event.reported],
        )
        for event in record.events
        if id(event) in listed
    ]
    more = _left_out(len(record.events), "of them")
    columns = ("at", "level", "about", "what", "told by")
    return _reports(columns, rows, columns[:1], "Warnings and what the operator did") + more


def _reports(columns: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[str], caption: str) -> str:
    """A table of which the last column is left out where it is empty."""
    columns = columns if any(row[-1] for row in rows) else columns[:-1]
    rows = [row[: len(columns)] for row in rows]
    return table(columns, rows, right=right, kinds=_LEVELS, caption=caption)


def _left_out(count: int, what: str) -> str:
    return empty(f"{count - MAX_LISTED} more {what} are not listed.") if count > MAX_LISTED else ""


def _lines(lines: Sequence[str]) -> str:
    if not lines:
        return empty("Nothing that is known of.")
    return f"<ul>{''.join(f'<li>{whole_words(line)}</li>' for line in lines)}</ul>"


def _made_of(about: Provenance) -> str:
    settings = table(("what", "which"), list(about.settings.items()), caption="Programs and options")
    kinds = {"SHA-256": lambda _: "code"}
    files = table(("file", "SHA-256"), list(about.files.items()), kinds=kinds, caption="Files that were read")
    imported = table(("what", "how"), list(about.imported), caption="Files of others that the recording was made from")
    return settings + files + (draw_sources(about.spans) + imported if about.imported else "")
