"""Words of others leave the program as plain lines: in files, on stdout and on stderr, in films."""

import csv
import json
import logging
import tomllib

import numpy as np
import pytest

from gcs.cli.rollcall import print_rollcall
from gcs.health.faults import Faults
from gcs.mission.mission import Mission, MissionVehicle
from gcs.report.overlay import draw, label_of
from gcs.report.rollcall import RollCall
from gcs.session.event_log import event_row
from gcs.session.log import RecordSenders
from gcs.session.metadata import mission_table
from gcs.snapshot import Event
from infra.plain_text import from_cell, plain, to_cell
from mavlink.tlog.writer import TlogWriter
from tests.support.bundled import swarm_session
from tests.support.command_line import run_gcs
from tests.support.fake_station import HOSTILE
from tests.support.snapshots import box, snapshot

FORGED = "x\ngcs: all is well\x1b[31m\u202e\x9b"
NAMES = {
    2: '=HYPERLINK("http://x";"y")',
    3: "+1|' /C calc'!A0",
    4: "\u202eA\x9b31m\x1b]0;owned\x07",
    5: "a\n  7  forged",
    6: "@SUM(1)",
    7: " \uff1d1",
}


@pytest.fixture(scope="module")
def named_badly(tmp_path_factory):
    """The bundled telemetry with names that somebody else chose, identified in a folder of his choice too."""
    tmp_path = tmp_path_factory.mktemp("names")
    folder = swarm_session(tmp_path, frames=60)
    table = tomllib.loads((folder / "session.toml").read_text())
    for vehicle in table["ugv"]:
        vehicle["name"] = NAMES[vehicle["system_id"]]
    text = json.dumps  # JSON's strings are TOML's
    vehicles = "".join(f"[[ugv]]\nsystem_id = {v['system_id']}\nname = {text(v['name'])}\n" for v in table["ugv"])
    old = (folder / "session.toml").read_text()
    start, stop = old.index("[[ugv]]"), old.index("[", old.rindex("[[ugv]]") + 2)
    (folder / "session.toml").write_text(old[:start] + vehicles + old[stop:])
    folder = folder.rename(tmp_path / FORGED)
    out = tmp_path / f"out {FORGED}"
    return folder, out, run_gcs("identify", folder, "-o", out)


def is_plain(text):
    return all(line.isprintable() for line in text.split("\n"))


@pytest.mark.slow
def test_a_recording_of_others_is_named_in_plain_words(named_badly):
    _, out, (code, stdout, stderr) = named_badly
    assert code == 0, stderr
    for said in (stdout, stderr):
        assert is_plain(said)
        assert "owned" in stdout
        assert not any(line.startswith(("gcs: all is well", "  7  forged")) for line in said.splitlines())
    for file in out.iterdir():
        assert is_plain(file.read_text()), file
    names = {json.loads(line)["name"] for line in (out / "identity.jsonl").read_text().splitlines()}
    assert plain(NAMES[4]) in names
    assert NAMES[2] in names, "JSON runs no formulas"


@pytest.mark.slow
def test_an_export_runs_nothing_in_a_spreadsheet(named_badly, tmp_path):
    folder, out, _ = named_badly
    identity = ("--identity", out / "identity.csv")
    code, stdout, stderr = run_gcs("export", folder, *identity, "-o", tmp_path / "o.csv")
    assert (code, stdout) == (0, ""), stderr
    assert is_plain(stderr)
    text = (tmp_path / "o.csv").read_text()
    assert is_plain(text)
    rows = list(csv.DictReader(text.splitlines()))
    named = {row["name"] for row in rows if row["name"]}
    assert named == {to_cell(NAMES[int(row["system_id"])]) for row in rows if row["name"]}
    assert {"'" + NAMES[2], "'" + NAMES[3], "'" + NAMES[6], "'" + NAMES[7]} <= named
    assert any(float(row["angle"]) < 0 for row in rows), "numbers stay numbers"


def test_what_the_command_line_repeats_is_plain(tmp_path):
    for words in (
        ("replay", FORGED, FORGED),
        ("nothing" + FORGED,),
        ("identify", tmp_path / FORGED, "-o", tmp_path / "o"),
    ):
        code, stdout, stderr = run_gcs(*words)
        assert code == 2
        assert is_plain(stdout + stderr)
        assert not any(line.startswith("gcs: all is well") for line in stderr.splitlines())
        assert "all is well" in stderr


@pytest.mark.parametrize("name", [*filter(None, HOSTILE), *NAMES.values()])
def test_every_border_is_plain_whatever_a_vehicle_is_called(name, tmp_path, capsys, caplog):
    mission = Mission(uav=MissionVehicle(system_id=1, name=name), ugv=(MissionVehicle(system_id=2, name=name),))
    toml = mission_table(mission, {})
    assert is_plain(toml)
    if "\ud800" not in name:
        assert tomllib.loads(toml)["uav"]["name"] == name
    print_rollcall(RollCall(mission))
    printed = capsys.readouterr().out
    assert is_plain(printed)
    assert printed.count("\n") == 4
    event = event_row(Event(t_us=1, level="info", kind="text", text=name))
    assert event.isprintable()
    assert json.loads(event)["text"] == plain(name)
    # pytest keeps what is logged as it is, and cannot hand half a character from one process to another
    with caplog.at_level(logging.CRITICAL, "gcs.health.faults"):
        Faults(tmp_path / "faults.txt").record(plain(name), ValueError(name))
    assert is_plain((tmp_path / "faults.txt").read_text())
    cell = to_cell(name)
    assert cell.isprintable()
    assert not cell.lstrip().startswith(tuple("=+-@"))
    assert from_cell(cell) == plain(name)


def test_a_film_has_no_letter_that_its_font_lacks():
    shot = snapshot(boxes=[box(1, 2)], image=np.zeros((48, 64, 3), np.uint8))
    assert label_of(shot, shot.boxes[0])
    assert draw(shot).shape == (48, 64, 3)


@pytest.mark.parametrize("name", ["=1+1", "tty\x1b[31m", "'=1", "udpin:0.0.0.0:14550"])
def test_senders_are_read_back_as_they_were(name, tmp_path):
    with TlogWriter(tmp_path / "telemetry.tlog") as log:
        log.write_sender(0, 1000, 7, 0, 0, name, name)
    text = (tmp_path / "senders.csv").read_text()
    assert is_plain(text)
    assert ",=" not in text
    heard = RecordSenders.read(tmp_path / "senders.csv", np.array([1000]), np.array([7], dtype=np.uint8))
    assert (heard.names, heard.address(0, 0)) == ((plain(name),), plain(name))
