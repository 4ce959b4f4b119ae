"""Every place in which something is said of a flight, held against the truth."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from bench.statements.boxes import (
    Claim,
    check_agreement,
    check_claims,
    check_flips,
    read_cot,
    read_geojson,
    read_identity,
)
from bench.statements.flights import TrueFlight
from bench.statements.pages import check_batch, check_report, check_rollcall, printed_remarks
from bench.statements.rows import check_alarms, check_missing_alarms, check_rows
from bench.statements.screens import check_screens
from bench.statements.sentences import Said, check_sentence
from gcs.batch.report.overview import batch_page, read_results
from gcs.batch.stores import open_results
from gcs.cli.results.report import report
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.export.cot import cot_boxes, cot_event
from gcs.export.job import ExportJob
from gcs.export.maps.geojson import GeoJsonExport
from gcs.report.rollcall import RollCall
from gcs.session.session import open_session

GCS_WORDS = (sys.executable, "-c", "from gcs.cli.app import main; main()")
SCREENS = 40
"""Screens of each flight that are drawn."""
Found = Iterator[tuple[int, Iterable[tuple[Said | Claim, str]]]]
"""How many statements were checked, and what is false."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Falsehood:
    """Something that is said and not so."""

    where: str
    at_s: float
    """Since the first frame."""
    said: str
    true: str


def check_flight(flown: TrueFlight, folder: Path, place: str) -> tuple[int, list[Falsehood]]:
    """How many statements were checked, and which are false.

    Args:
        flown: the flight.
        folder: for what is exported.
        place: one of ``PLACES``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    count, found = 0, list[Falsehood]()
    for statements, what in PLACES[place](flown, folder):
        count += statements
        for said, why in what:
            text = said.text if isinstance(said, Said) else str(said)
            found.append(Falsehood(where=said.where, at_s=flown.at_s(said.t_us), said=text, true=why))
    return count, found


def _sentences(flown: TrueFlight, sentences: Iterable[Said]) -> Found:
    for said in sentences:
        yield 1, [(said, why) for why in check_sentence(flown, said)]


def _events(flown: TrueFlight, folder: Path) -> Found:
    rows = map(json.loads, (flown.folder / "events.jsonl").read_text(encoding="utf-8").splitlines())
    said = (
        Said(where="events.jsonl", t_us=row["time_us"], text=row["text"], system_id=row["system_id"] or 0)
        for row in rows
    )
    yield from _sentences(flown, said)


def _turns(flown: TrueFlight, folder: Path) -> Found:
    for moment in flown.moments:
        for check in (check_rows, check_alarms, check_missing_alarms):
            yield len(moment.snapshot.vehicles), list(check(flown, moment))


def _own(flown: TrueFlight) -> list[Claim]:
    return read_identity(flown.folder / "identity.jsonl")


def _identity(flown: TrueFlight, folder: Path) -> Found:
    claims = _own(flown)
    yield len(claims), [*check_claims(flown, claims), *check_flips(claims)]
    words = ((claim, text) for claim in claims for text in (claim.may_be, claim.doubt) if text)
    yield from _sentences(flown, (Said(where=claim.where, t_us=claim.t_us, text=text) for claim, text in words))


def _exports(flown: TrueFlight, folder: Path) -> Found:
    own, frames = _own(flown), [moment.snapshot for moment in flown.moments if moment.snapshot.new_boxes]
    by_frame = {snapshot.frame: snapshot.t_us for snapshot in frames}
    export = GeoJsonExport(ExportJob(path=folder / "boxes.geojson"))
    for snapshot in frames:
        export.write(snapshot)
    export.close()
    events = [cot_event(snapshot, box, source="flight") for snapshot in frames for box in cot_boxes(snapshot)]
    for claims in (read_geojson(folder / "boxes.geojson", by_frame), read_cot(events, by_frame)):
        yield len(claims), [*check_agreement(own, claims), *check_claims(flown, claims)]


def _screens(flown: TrueFlight, folder: Path) -> Found:
    moments = flown.moments[:: max(1, len(flown.moments) // SCREENS)]
    yield from asyncio.run(check_screens(flown, moments))


def _rollcall(flown: TrueFlight, folder: Path) -> Found:
    """As ``gcs fly`` adds it up, as JSON and as it is printed."""
    mission = open_session(flown.folder).mission
    assert mission is not None
    calls = RollCall(mission)
    for moment in flown.moments:
        calls.add(moment.snapshot, moment.now_us)
    told = rollcall_json(calls)
    printed = printed_remarks(lambda: print_rollcall(calls))
    rows = [
        {
            "id": row["system_id"],
            "boxes": row["boxes"],
            "in view": row["frames_in_view"],
            "unknown": row["frames_unknown"],
            "remark": remark,
        }
        for row, remark in zip(told["vehicles"], printed, strict=True)
    ]
    sums = {key: told[key] for key in ("frames", "boxes", "unnamed")}
    yield len(rows) + len(sums), list(check_rollcall(flown, sums, rows, "roll call", _own(flown)))


def _report(flown: TrueFlight, folder: Path) -> Found:
    report(flown.folder, folder / "report.html")
    page = (folder / "report.html").read_text(encoding="utf-8")
    yield page.count("<td"), list(check_report(flown, page, _own(flown)))


def _batch(flown: TrueFlight, folder: Path) -> Found:
    subprocess.run(
        [*GCS_WORDS, "batch", "run", str(flown.folder), "-o", str(folder / "batch")], check=True, capture_output=True
    )
    page = batch_page(read_results(open_results(str(folder / "batch"))), "batch")
    yield page.count("<td"), list(check_batch(flown, page, _own(flown)))


PLACES: MappingProxyType[str, Callable[[TrueFlight, Path], Found]] = MappingProxyType(
    {
        "events": _events,
        "turns": _turns,
        "identity": _identity,
        "exports": _exports,
        "screens": _screens,
        "roll call": _rollcall,
        "report": _report,
        "batch page": _batch,
    }
)
"""Where something is said; ``turns``: the rows and alarms that screens are drawn from, at every turn of the fold."""
