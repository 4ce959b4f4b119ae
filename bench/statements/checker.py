"""Every place in which something is said of a flight, held against the truth."""

from __future__ import annotations

import asyncio
import json
import math
import re
import subprocess
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

from bench.flights import Moment, TrueFlight
from bench.statements.boxes import (
    Claim,
    check_agreement,
    check_claims,
    check_flips,
    read_cot,
    read_geojson,
    read_identity,
)
from bench.statements.pages import check_batch, check_report, check_rollcall, overall, printed_remarks
from bench.statements.screens import check_screens
from bench.statements.sentences import ADRIFT_S, HOLD_S, LOST_S, SILENT_S, SLACK_S, Said, check_sentence
from gcs.batch.report.overview import batch_page, read_results
from gcs.batch.stores import open_results
from gcs.cli.results.report import report
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.export.cot import cot_boxes, cot_event
from gcs.export.job import ExportJob
from gcs.export.maps.geojson import GeoJsonExport
from gcs.flight.view import FlightView
from gcs.flight.views import beside
from gcs.playback.identification import identify_session
from gcs.report.rollcall import RollCall
from gcs.session.frame_tables import read_times
from gcs.session.session import open_session
from gcs.snapshot import OF_A_CAMERA, Snapshot, VehicleRow
from tests.support.command_line import GCS

S = 1_000_000
EDGE_PX = 60.0
"""Three metres of a position's error, near the border of the frame."""
AGAIN_S = 0.45
MOMENTS_APART = 5
"""Turns from one comparison of several cameras to the next."""
FOUND_OUT_S = 3.0
TURN_S = 0.3
CONTRADICTIONS = ("conflict", "doubted", "refused")
LATE_S = 4.0
"""An alarm is there this long after what raises it, where its rule asks for no longer."""


def check_rows(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """Standing, ages and whether it is in view, of each ground vehicle."""
    snapshot = moment.snapshot
    for row in snapshot.vehicles:
        if row.role == "ugv":
            for what, why in check_row(flown, moment, row):
                yield Said(where="fleet", t_us=snapshot.t_us, text=f"{row.name}: {what}", system_id=row.system_id), why


def check_row(flown: TrueFlight, moment: Moment, row: VehicleRow) -> Iterator[tuple[str, str]]:
    """Check one vehicle's row; yields what is false. Ages that are not told are NaN."""
    snapshot, i = moment.snapshot, row.system_id
    for what, told_s in (("heartbeat", row.heartbeat_age_s), ("position", row.position_age_s)):
        # what has come since the frame was taken may be in it
        true_s, least_s = (flown.silent_s(i, t_us, what) for t_us in (snapshot.t_us, moment.now_us))
        # what has just come is in the next one
        turn_s = TURN_S + flown.silent_s(i, snapshot.t_us - round(TURN_S * S), what)
        younger = told_s < min(true_s, least_s) - SLACK_S
        # a position that was refused is none, whenever it came
        faulty = what == "position" and flown.fault_of(i, snapshot.t_us, within_s=5)
        older = told_s > max(true_s, turn_s) + SLACK_S and not faulty
        if younger or older:
            yield f"{what} {told_s:.1f} s ago", f"it came {true_s:.1f} s before"
    frame = flown.frames.get(snapshot.seen_us)
    if frame is None:
        return
    if row.standing == "confirmed" and not row.stated and not snapshot.held:
        box = next(box for box in snapshot.boxes if box.track_id == row.track_id)
        whose = frame.whose(box.cx, box.cy)
        if whose not in (None, i):
            yield f"confirmed {row.confidence:.2f}", f"its box is {flown.name(whose or 0)}'s"
    outside_px = frame.outside_px(i)
    # a lie that is found out is told: its place is then not where it reports to be; none is found out at once
    fault = flown.fault_of(i, snapshot.t_us)
    fresh = fault is not None and flown.at_s(snapshot.t_us) < fault.start_s + FOUND_OUT_S
    told = fresh or any(alarm.system_id == i and alarm.key.startswith(CONTRADICTIONS) for alarm in snapshot.alarms)
    if row.standing == "out of view" and outside_px < -EDGE_PX and not told:
        yield "out of view", f"it is {-outside_px:.0f} px inside of the picture"
    if row.in_view and outside_px > EDGE_PX and not told:
        yield "in view", f"it is {outside_px:.0f} px outside of the picture"
    yield from _without_place(flown, snapshot.t_us, row)


def _without_place(flown: TrueFlight, t_us: int, row: VehicleRow) -> Iterator[tuple[str, str]]:
    """Check a vehicle of which it is said that nobody knows where it is."""
    i = row.system_id
    if row.standing == "misplaced" and not flown.fault_of(i, t_us, within_s=HOLD_S + ADRIFT_S):
        yield "misplaced", "its positions are right"
    if row.standing == "no position":
        age_s = flown.silent_s(i, t_us, "position")
        if age_s < LOST_S - SLACK_S and not flown.fault_of(i, t_us, within_s=5):
            yield "no position", f"one came {age_s:.1f} s before"


def check_alarms(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """Every alarm that stands has its cause, or had it a moment ago."""
    for alarm in moment.snapshot.alarms:
        said = Said(
            where="alarms", t_us=moment.snapshot.t_us, text=alarm.text, system_id=alarm.system_id, standing=True
        )
        yield from ((said, why) for why in check_sentence(flown, said))


def check_missing_alarms(flown: TrueFlight, moment: Moment) -> Iterator[tuple[Said, str]]:
    """Check that what is wrong for long is told: a vehicle is silent, or the video has stopped."""
    t_us = moment.snapshot.t_us
    texts = {alarm.text for alarm in moment.snapshot.alarms}
    for i in flown.scenario.ugv_ids:
        silent_s = flown.silent_s(i, t_us)
        if SILENT_S + LATE_S < silent_s < math.inf and f"{flown.name(i)}: no heartbeat" not in texts:
            yield _nothing(t_us, i), f"{flown.name(i)} has been silent for {silent_s:.1f} s"
    frames = [frame_us for now_us, frame_us in flown.turns if frame_us and now_us <= t_us]
    told = any("the video has stopped" in text or "the video comes and goes" in text for text in texts)
    if frames and t_us - frames[-1] > LATE_S * S and not told:
        yield _nothing(t_us, 0), f"the last frame is of {(t_us - frames[-1]) / S:.1f} s before"


def _nothing(t_us: int, system_id: int) -> Said:
    return Said(where="alarms", t_us=t_us, text="no alarm", system_id=system_id, standing=True)


SCREENS = 40
"""Screens of each flight that are drawn."""
Found = Iterator[tuple[int, Iterable[tuple[Said | Claim, str]]]]
"""Number of statements that were checked, and those that are false, with why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Falsehood:
    """Something that is said and not so."""

    where: str
    at_s: float
    """Time since the first frame, s."""
    said: str
    true: str


def check_beside(flown: TrueFlight, folder: Path) -> Found:
    """Check what the screens of each of several cameras tell of the others: who is named there, and their alarms."""
    flights = (flown, *flown.beside)
    views = [_view(each) for each in flights]
    for k, here in enumerate(flights if flown.beside else ()):
        for moment in here.moments[::MOMENTS_APART]:
            for each, view in zip(flights, views, strict=True):
                at = bisect_right(each.moments, moment.now_us, key=lambda other: other.now_us)
                view.loop.latest = each.moments[max(at - 1, 0)].snapshot
            shown = beside(moment.snapshot, views[k], [view for view in views if view is not views[k]])
            told = [*_elsewhere(shown, flights, views), *_alarms_beside(shown, here, flights, views)]
            yield len(shown.vehicles) + len(shown.alarms), told


def _view(flown: TrueFlight) -> FlightView:
    view = FlightView.__new__(FlightView)
    mission = open_session(flown.folder).mission
    view.pipeline, view.loop = SimpleNamespace(mission=mission), SimpleNamespace()  # type: ignore[assignment]
    return view


def _elsewhere(
    shown: Snapshot, flights: Sequence[TrueFlight], views: Sequence[FlightView]
) -> Iterator[tuple[Said, str]]:
    """Check that who is said to be in another camera's picture is there."""
    for row in shown.vehicles:
        for flown, view in zip(flights, views, strict=True):
            frame = flown.frames.get(view.loop.latest.seen_us) if view.loop.latest else None
            if view.name in row.elsewhere and frame and frame.outside_px(row.system_id) > EDGE_PX:
                said = Said(where="beside", t_us=shown.t_us, text=f"{row.name}: seen by {view.name}")
                yield said, f"it is {frame.outside_px(row.system_id):.0f} px outside of that picture"


def _alarms_beside(
    shown: Snapshot, here: TrueFlight, flights: Sequence[TrueFlight], views: Sequence[FlightView]
) -> Iterator[tuple[Said, str]]:
    """Alarms are of the camera that they name, and what is wrong with each camera is told."""
    texts, aircraft = {alarm.text for alarm in shown.alarms}, [each.uav_id for each in flights]
    for flown, view in zip(flights, views, strict=True):
        own, t_us = f"{view.name}: ", view.loop.latest.t_us if view.loop.latest else 0
        missing = replace(flown.moments[0], snapshot=replace(shown, t_us=t_us, alarms=shown.alarms))
        yield from check_missing_alarms(flown, missing)
        for alarm in shown.alarms:
            named = alarm.kind in OF_A_CAMERA and alarm.text.startswith(own)
            of_camera = named and alarm.system_id == flown.uav_id
            if named or (flown is here and not (alarm.kind in OF_A_CAMERA or alarm.system_id in aircraft)):
                text = alarm.text.removeprefix(own) if named else alarm.text
                system_id = 0 if of_camera else alarm.system_id
                said = Said(where="beside", t_us=t_us, text=text, system_id=system_id, standing=True)
                yield from ((said, why) for why in check_sentence(flown, said))
    yield from ((_nothing(shown.t_us, 0), "two say the same") for _ in range(len(shown.alarms) - len(texts)))


def check_flight(flown: TrueFlight, folder: Path, place: str) -> tuple[int, list[Falsehood]]:
    """Check a flight; returns how many statements were checked, and which are false.

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


def check_cameras(flown: TrueFlight, folder: Path, place: str) -> tuple[int, list[Falsehood]]:
    """The same of a flight with all its cameras."""
    checked = [check_flight(each, folder / str(each.uav_id), place) for each in (flown, *flown.beside)]
    return sum(count for count, _ in checked), [false for _, found in checked for false in found]


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


def _calls(flown: TrueFlight) -> RollCall:
    """Roll call as ``gcs fly`` adds it up."""
    mission = open_session(flown.folder).mission
    assert mission is not None
    calls = RollCall(mission)
    for moment in flown.moments:
        calls.add(moment.snapshot, moment.now_us)
    calls.set_frame_count(len(read_times(flown.folder / "frames.csv").times_us))
    return calls


def _again(flown: TrueFlight, folder: Path) -> Found:
    """The flight's roll call, that of its replay, and what its report quotes: alarms, marks, counts, silences."""
    calls = _calls(flown)
    again = identify_session(open_session(flown.folder), folder / "again", hindsight=False)
    there, here = _counts(again), _counts(calls)
    yield len(here), [(overall(flown, "again", f"{what}: {there[what]}"), f"in flight {here[what]}") for what in here
                      if there[what] != here[what] and not _near(there[what], here[what])]  # fmt: skip
    page = re.sub("</?strong>", "", _page(flown, folder))
    yield 1, [(overall(flown, "again", "report"), f"in flight {calls.reports}")] * (calls.reports not in page)


def _counts(calls: RollCall) -> dict[str, object]:
    told = rollcall_json(calls)
    rows = {f"{row['name']}: {key}": value for row in told.pop("vehicles") for key, value in row.items()}
    return {key: value for key, value in told.items() if key not in ("span_s", "other_views")} | rows


def _near(one: object, other: object) -> bool:
    """Two folds look at a silence at moments a fifth of a second apart; two NaN are the same."""
    numbers = isinstance(one, float) and isinstance(other, float)
    return numbers and (abs(float(one) - float(other)) < AGAIN_S or (one != one and other != other))  # type: ignore[arg-type]


def _rollcall(flown: TrueFlight, folder: Path) -> Found:
    """Roll call as ``gcs fly`` adds it up, as JSON and as it is printed."""
    calls = _calls(flown)
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


def _page(flown: TrueFlight, folder: Path) -> str:
    """The report; written once."""
    if not (path := folder / "report.html").exists():
        report(flown.folder, path)
    return path.read_text(encoding="utf-8")


def _report(flown: TrueFlight, folder: Path) -> Found:
    page = _page(flown, folder)
    yield page.count("<td"), list(check_report(flown, page, _own(flown)))


def _batch(flown: TrueFlight, folder: Path) -> Found:
    subprocess.run(
        [*GCS, "batch", "run", str(flown.folder), "-o", str(folder / "batch")], check=True, capture_output=True
    )
    page = batch_page(read_results(open_results(str(folder / "batch"))), "batch")
    yield page.count("<td"), list(check_batch(flown, page, _own(flown)))


PLACES: MappingProxyType[str, Callable[[TrueFlight, Path], Found]] = MappingProxyType(
    {
        "events": _events,
        "turns": _turns,
        "beside": check_beside,
        "identity": _identity,
        "exports": _exports,
        "screens": _screens,
        "roll call": _rollcall,
        "report": _report,
        "again": _again,
        "batch page": _batch,
    }
)
"""Places of statements; ``turns``: the rows and alarms that screens are drawn from, at every turn of the fold;
``beside``: what several cameras tell of one another; ``again``: what roll call, replay and report tell alike."""
