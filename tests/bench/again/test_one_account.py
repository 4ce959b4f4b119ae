"""What a flight says of itself at its end, its report, its replay and its identification: one account of one flight."""

import html
import re

import pytest

from bench.flights import FlightScript, OperatorAct, fly_script
from gcs.cli.rollcall import print_rollcall
from gcs.playback.identification import identify_session
from gcs.playback.replay import Replay
from gcs.report.rollcall import RollCall
from gcs.session.frame_tables import read_times
from gcs.session.session import open_session
from tests.support.bundled import swarm_session, with_packets
from tests.support.command_line import run_gcs
from tests.support.scripted import InjectedFaults
from tests.support.waiting import until

pytestmark = pytest.mark.slow

S = 1_000_000
SECONDS, LOST_S = 14.0, 8.5
FLIGHTS = {
    "lost twice": InjectedFaults(restart=(2.0, 6.5), no_telemetry=(LOST_S, 99.0)),
    "overloaded": InjectedFaults(fold_stalled=(3.0, 5.5), ring_bytes=8192, killed_s=(7.0,), no_video=((9.0, 12.5),)),
    "forged": InjectedFaults(signed=True, wrong_keys=frozenset((12,)), detector_fails=(5.0, 5.5)),
}
MARKS = ["behind the barn", "at the gate"]
RECORDED, SILENT, SILENT_FROM_US = "of real autopilots", 4, 1_795_171_703_985_018 + 7 * S
"""A recording, whose account at its end is that of its identification, and who is silent from when on."""
NEAR_S = 0.45
"""Two folds look at a silence at moments a fifth of a second apart."""
EVENTS = "Warnings and what the operator did"


@pytest.fixture(scope="module", params=[*FLIGHTS, RECORDED])
def flown(request, tmp_path_factory):
    """Which flight it is, its session folder, and the roll call at its end."""
    if request.param == RECORDED:
        folder = with_packets(swarm_session(tmp_path_factory.mktemp("cut")), tmp_path_factory.mktemp("one"), _heard)
        calls = identify_session(open_session(folder), folder.with_name("identified"), hindsight=False)
        return request.param, folder, calls
    acts = tuple(
        OperatorAct(at_s=at_s, kind="mark", of=11, text=text) for at_s, text in zip((1.0, 7.0), MARKS, strict=True)
    )
    faults = FLIGHTS[request.param]
    script = FlightScript(name=request.param, seconds=SECONDS, vehicles=3, outside=1, injected=faults, acts=acts)
    flown = fly_script(script, tmp_path_factory.mktemp("flown"))
    calls = RollCall(open_session(flown.folder).mission)
    for moment in flown.moments:
        calls.add(moment.snapshot, moment.now_us)
    calls.set_frame_count(len(read_times(flown.folder / "frames.csv").times_us))
    return request.param, flown.folder, calls


def _heard(packet):
    return [] if packet.system_id == SILENT and packet.t_us > SILENT_FROM_US else [packet]


@pytest.fixture(scope="module")
def page(flown, tmp_path_factory):
    """The report."""
    out = tmp_path_factory.mktemp("page") / "report.html"
    code, _, told = run_gcs("report", flown[1], "-o", out)
    assert code == 0, told
    return out.read_text(encoding="utf-8")


def table(page, label):
    """Cells of the rows of a table, without its head."""
    (body,) = re.findall(f'aria-label="{re.escape(label)}"><table>.*?<tbody>(.*?)</tbody>', page, flags=re.S)
    rows = re.findall(r"<tr>(.*?)</tr>", body, flags=re.S)
    return [[html.unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


def counts(calls):
    rows = [(row.boxes, row.frames_in_view, row.outcome, row.why) for row in calls.rows()]
    return calls.frames, calls.skipped_frames, calls.boxes, calls.unnamed, calls.alarms, calls.marks, rows


def test_flight_and_identification_count_alike(flown, tmp_path):
    name, folder, calls = flown
    again = identify_session(open_session(folder), tmp_path / "again", hindsight=False)
    assert counts(again) == counts(calls)
    assert calls.frames > 20 and calls.marks == 2 * (name in FLIGHTS)
    assert (calls.skipped_frames > 0) == (name in ("overloaded", "forged"))
    for there, here in zip(again.rows(), calls.rows(), strict=True):
        assert there.longest_silence_s == pytest.approx(here.longest_silence_s, abs=NEAR_S)


def test_a_flight_whose_camera_never_gave_a_picture_has_a_report_too(tmp_path):
    script = FlightScript(name="blind", seconds=6.0, vehicles=2, injected=InjectedFaults(no_video=((-9.0, 99.0),)))
    folder = fly_script(script, tmp_path / "flown").folder
    code, _, told = run_gcs("report", folder, "-o", tmp_path / "report.html")
    assert code == 0, told
    remarks = [cells[-1] for cells in table((tmp_path / "report.html").read_text(encoding="utf-8"), "Roll call")]
    assert remarks == ["no frame was looked at"] * 2


def test_a_silence_and_its_alarms_last_to_the_end(flown):
    name, _, calls = flown
    lost_s = SECONDS - LOST_S if name == "lost twice" else 0.0
    assert all(row.longest_silence_s > lost_s - NEAR_S for row in calls.rows())
    assert calls.alarms.alarms >= (2 * (1 + len(calls.rows())) if lost_s else 0)


def test_the_report_quotes_the_roll_call(flown, page, capsys):
    _, _, calls = flown
    assert f"{calls.boxes - calls.unnamed} of {calls.boxes} boxes in {calls.frames} frames have a name." in page
    skipped = f"{calls.skipped_frames} more frames came and were not looked at" in page
    assert skipped == (calls.skipped_frames > 0)
    print_rollcall(calls)
    assert calls.reports in re.sub("</?strong>", "", page) and calls.reports in capsys.readouterr().out
    for row, cells in zip(calls.rows(), table(page, "Roll call"), strict=True):
        assert (cells[0], cells[7], cells[6]) == (row.name, str(row.system_id), str(row.boxes))
        found = dict(table(page, f"What is known of {row.name}"))
        silence_s = float(found["longest without a position"].split()[0])
        assert silence_s == pytest.approx(row.longest_silence_s, abs=NEAR_S)
    events = table(page, EVENTS) if f'aria-label="{EVENTS}"' in page else []
    told = [f"UGV-11: {text}" for text in MARKS]
    assert [cells[3] for cells in events if cells[2] == "mark"] == told * (calls.marks > 0)


def test_the_replay_shows_the_alarms_and_marks_of_the_report(flown, page):
    _, folder, calls = flown
    listed = {cells[4] for cells in table(page, "Alarms")} if calls.alarms.alarms + calls.alarms.warnings else set()
    replay = Replay(open_session(folder))
    try:
        replay.pause()
        assert until(lambda: not replay.title.endswith(")")), replay.error
        shown, before = set(), None
        for t_us in range(replay.start_us + S, replay.stop_us, S // 2):
            replay.seek(t_us)
            # while the fold stood still there is no other moment to show
            until(lambda before=before: replay.latest() is not before, timeout_s=0.5)
            before = replay.latest()
            shown |= {alarm.text for alarm in before.alarms if not alarm.reported}
        marks = [event.text for event in replay.events() if event.kind == "mark"]
    finally:
        replay.stop()
    assert listed == shown
    assert marks == MARKS * (calls.marks > 0)
