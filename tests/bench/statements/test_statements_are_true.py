"""What is said of a flight is so: two short flights with every trouble, in every place where something is said.

``python -m bench.statements`` does it for many more flights, in the report and in the page of a batch too.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench.flights import FlightScript, OperatorAct, fly_script
from bench.statements.boxes import check_agreement, check_claims, check_flips, read_identity
from bench.statements.checker import check_alarms, check_flight, check_missing_alarms, check_row
from bench.statements.pages import check_report, check_rollcall
from bench.statements.sentences import Said, check_sentence, match_sentence
from sim.world.scenario import ScenarioFault
from tests.support.scripted import InjectedFaults

pytestmark = pytest.mark.slow

S = 1_000_000
PLACES = ("events", "turns", "identity", "exports", "screens", "roll call")
FLIGHTS = (
    FlightScript(
        name="one silent and back, one refused, and an operator",
        seconds=18.0,
        fps=4.0,
        vehicles=4,
        outside=1,
        faults=(ScenarioFault(vehicle=1, kind="silent", start_s=4.0, stop_s=14.0),),
        injected=InjectedFaults(signed=True, wrong_keys=frozenset((14,))),
        acts=(
            OperatorAct(at_s=3.0, kind="state", of=13, says=13),
            OperatorAct(at_s=9.0, kind="mark", of=12, text="it went behind the barn"),
            OperatorAct(at_s=12.0, kind="undo", of=13),
        ),
    ),
    FlightScript(
        name="one late, and the video stops",
        seconds=16.0,
        fps=4.0,
        vehicles=4,
        faults=(ScenarioFault(vehicle=3, kind="silent", start_s=-9.0),),
        injected=InjectedFaults(no_video=((6.0, 11.0),)),
    ),
)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    return [fly_script(script, tmp_path_factory.mktemp("flown")) for script in FLIGHTS]


@pytest.fixture
def troubled(flights):
    """The first."""
    return flights[0]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("number", range(len(FLIGHTS)), ids=[script.name for script in FLIGHTS])
def test_all_that_is_said_is_so(flights, number, place, tmp_path):
    statements, found = check_flight(flights[number], tmp_path, place)
    assert statements > 5
    assert not found


FALSE = {
    "UGV-13: no heartbeat": 8.0,
    "UGV-12: position lost": 2.0,
    "UGV-11: its position contradicts the video": 8.0,
    "UGV-11: its positions cannot be right: 0/0": 8.0,
    "UGV-13: packets with a wrong signature are rejected": 8.0,
    "system 13: 3 packets refused, bad signature (192.0.2.5:14550 on first)": 8.0,
    "UGV-12 says: Reached waypoint #1": 9.0,
    "rover 12 is there, AUTO": 9.0,
    "nothing is authenticated: anybody can pose as a vehicle": 1.0,
    "never heard: UGV-14": 16.0,
    "the video has stopped": 9.0,
    "udpin:0.0.0.0:14550: nothing is received any more": 9.0,
    "the video comes and goes: 4 times in 8 s": 9.0,
    "UGV-12: it is heard on and off: 5 times in 9 s": 9.0,
    "UGV-12: its positions come and go: 5 times in 9 s": 9.0,
    "over after 3 s: UGV-12: no heartbeat": 11.0,
    "over after 3 s: the video has stopped": 11.0,
    "stated: track 1 is UGV-12": 9.0,
    "stated: track 1 is UGV-12; withdrawn": 9.0,
    "stated: track 1 is UGV-12; it ended with the track": 9.0,
    "may be UGV-12: no position for 2 s": 10.0,
    "may be UGV-12: no position for 20 s": 10.0,
    "may be UGV-12: never heard": 10.0,
    "may be UGV-11: its position contradicts the video": 10.0,
    "it went behind the house": 9.0,
    "UGV-12: has arrived": 9.0,
}
"""What nobody should believe, and when it is said, seconds."""


@pytest.mark.parametrize(("text", "at_s"), FALSE.items())
def test_a_false_sentence_is_found(troubled, text, at_s):
    t_us = troubled.scenario.start_us + round(at_s * S)
    assert list(
        check_sentence(
            troubled, Said(where="test", t_us=t_us, text=text, standing=text.startswith(("UGV", "the video")))
        )
    )


def test_names_of_tracks_are_found_out(troubled):
    track, seen = next((track, seen) for track, seen in troubled.tracks.items() if len(seen) > 20 and seen[10][1] == 11)
    said = Said(where="test", t_us=seen[10][0], text="")
    for text in (
        "is UGV-13 (95%)",
        "is no longer UGV-11: it left the picture",
        "is no longer UGV-11: the track was lost",
    ):
        assert list(check_sentence(troubled, replace(said, text=f"track {track} {text}"))), text
    stranger = replace(said, text=f"track {track} is no longer UGV-11: none of ours is likelier (97%)")
    assert list(check_sentence(troubled, stranger))
    assert not list(check_sentence(troubled, replace(said, text=f"track {track} is UGV-11 (95%)")))


def test_every_sentence_is_of_one_template_and_typed():
    assert match_sentence("track seven is UGV-11 (95%)") is None
    assert match_sentence("track 7 is UGV-11 (95%) or so") is None
    assert match_sentence("track 7 is UGV-11 (95%)")[1] == {"track": "7", "name": "UGV-11", "percent": "95"}


def test_false_claims_of_boxes_are_found(troubled):
    claims = read_identity(troubled.folder / "identity.jsonl")
    one = next(each for each in claims if each.system_id == 11 and each.confidence > 0.95)
    other, stranger = replace(one, system_id=13, name="UGV-13"), replace(one, system_id=0, name="")
    for false in (
        other,
        stranger,
        replace(one, name="UGV-13"),
        replace(one, place=(-900.0, 0.0)),
        replace(one, t_us=7),
    ):
        assert list(check_claims(troubled, [false])), false
    later = replace(stranger, t_us=one.t_us + 250_000)
    assert list(check_flips([one, later])) and not list(check_flips([one, replace(later, confidence=0.8)]))
    assert list(check_agreement([one], [replace(one, confidence=0.5)])) and list(check_agreement([], [one]))
    assert not list(check_agreement([one], [one]))


def test_false_rows_and_missing_alarms_are_found(troubled):
    moment = next(each for each in troubled.moments if troubled.at_s(each.snapshot.t_us) > 13.0)
    rows = {row.system_id: row for row in moment.snapshot.vehicles}
    for false in (
        replace(rows[11], standing="out of view"),
        replace(rows[11], standing="no position"),
        replace(rows[11], heartbeat_age_s=5.0),
        replace(rows[12], heartbeat_age_s=0.1),
        replace(rows[15], in_view=True),
        replace(rows[11], track_id=rows[12].track_id),
    ):
        assert list(check_row(troubled, moment, false)), false
    assert not any(list(check(troubled, moment)) for check in (check_alarms, check_missing_alarms))
    silenced = replace(moment, snapshot=replace(moment.snapshot, alarms=()))
    assert list(check_missing_alarms(troubled, silenced))
    well = next(each for each in troubled.moments if troubled.at_s(each.snapshot.t_us) > 2.0)
    raised = replace(well.snapshot, alarms=moment.snapshot.alarms)
    assert list(check_alarms(troubled, replace(well, snapshot=raised)))


def test_false_counts_and_remarks_are_found(troubled):
    claims = read_identity(troubled.folder / "identity.jsonl")
    boxes = sum(claim.system_id == 11 for claim in claims)
    row = {"id": 11, "boxes": boxes, "in view": len(troubled.frames), "remark": ""}
    told = {"frames": len(troubled.frames), "boxes": len(claims)}
    assert not list(check_rollcall(troubled, told, [row], "test", claims))
    for change in ({"boxes": boxes - 1}, {"in view": 20}, {"remark": "never heard"}, {"remark": "gone fishing"}):
        assert list(check_rollcall(troubled, told, [row | change], "test", claims)), change
    assert list(check_rollcall(troubled, {"frames": 1}, [], "test", claims))
    for remark, is_so in (("never heard", False), ("all refused: packets with a wrong signature", True)):
        absent = {"id": 14, "boxes": 0, "remark": remark}
        assert bool(list(check_rollcall(troubled, told, [absent], "test", claims))) != is_so


def test_a_report_without_the_alarms_of_the_flight_is_found(troubled):
    page = "<p>3 of 4 boxes in 2 frames have a name.</p>"
    row = "<tr><td>11</td><td>0</td><td>never heard</td></tr>"
    heads = "".join(f'<th scope="col">{name}</th>' for name in ("id", "boxes", "remark"))
    table = f'<div aria-label="Roll call"><table><tr>{heads}</tr>{row}</table></div>'
    found = {said.text for said, _ in check_report(troubled, page + table, [])}
    assert {"UGV-12: no heartbeat", "it went behind the barn", "UGV-11: never heard", "2 frames"} <= found
