"""The account of an import: of each file its clock, what was read, assumed and left out."""

import dataclasses
import json
import re
import tomllib

import pytest

from gcs.session.session import open_session
from tests.support.command_line import run_gcs
from tests.support.imports.flown import FOV_DEG, fly
from tests.support.imports.log_writers import dataflash
from tests.support.imports.srt_writers import srt
from tests.support.imports.text_writers import nmea


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """An import with a fleet's log, a receiver's that is damaged in one sentence, and an autopilot's."""
    folder = tmp_path_factory.mktemp("flown")
    flown = fly(folder, 30)
    (folder / "DJI.srt").write_text(srt("keyed", flown.spots()))
    (folder / "r11.nmea").write_text(nmea(flown, 11).replace("GGA,", "GGA,1", 1))
    (folder / "r12.bin").write_bytes(dataflash(flown, 12))
    ugv = ("--ugv", f"11={folder / 'r11.nmea'}", "--ugv", folder / "r12.bin")
    options = ("--video", flown.video, "--uav", folder / "DJI.srt", "--tlog", flown.fleet, *ugv, "--fov", FOV_DEG)
    return ("import", *options, "--clock=+0")


def test_every_file_has_its_clock_and_what_was_made_of_it(words, tmp_path):
    code, told, _ = run_gcs(*words, "-o", tmp_path / "s", "--explain")
    assert code == 0
    rows = [tuple(line.split(None, 1)) for line in told.splitlines()]
    assert [row for row in rows if row[0] in ("video", "uav", "fleet")] == [
        ("video", "video.mp4"),
        ("uav", "DJI.srt"),
        ("fleet", "fleet.tlog"),
    ]
    assert sum(row[0] == "clock" for row in rows) == 5 + 1  # and that of the film beside the fleet's
    assert "time since its start, with GPS time less 18 s beside it" in told
    assert "1 sentences with a wrong checksum" in told
    assert "the clock of system" in told and "system 13: " in told and "system 11: " not in told
    # what is told of a file is not told again of all
    assert told.count("the date in its subtitles is UTC") == 1
    assert "ellipsoid" not in told
    assert told.count("the camera looks straight down") == 1
    assert len(rows) < 50


def test_altitudes_with_another_zero_than_the_fleets_are_told(tmp_path):
    flown = fly(tmp_path, 20)
    above_ellipsoid = [(t, dataclasses.replace(spot, alt=spot.alt + 47.0)) for t, spot in flown.spots()]
    (tmp_path / "DJI.srt").write_text(srt("keyed", above_ellipsoid))
    files = ("--video", flown.video, "--uav", tmp_path / "DJI.srt", "--tlog", flown.fleet)
    code, told, _ = run_gcs("import", *files, "--fov", FOV_DEG, "--clock=+0", "-o", tmp_path / "s", "--json")
    assert code == 0
    (said,) = (words for words in json.loads(told)["assumed"] if "ellipsoid" in words)
    above_m = float(re.search(r"took off ([-+]\d+) m", said).group(1))
    assert above_m == pytest.approx(47.0, abs=2.0)


def test_programs_and_the_session_have_the_same_account(words, tmp_path):
    code, told, _ = run_gcs(*words, "-o", tmp_path / "s", "--json")
    assert code == 0
    sources = json.loads(told)["sources"]
    assert [each["role"] for each in sources] == ["video", "uav", "ugv 11", "ugv 12", "fleet"]
    assert sources[2]["left_out"] == {"sentences with a wrong checksum": 1}
    table = tomllib.loads((tmp_path / "s" / "session.toml").read_text())
    assert table["session"]["imported"]["sources"] == sources
    notes = open_session(tmp_path / "s").notes
    rows, spans = notes.imported, dict(notes.spans)
    assert list(spans)[:5] == ["video", "uav", "ugv 11", "ugv 12", "system 13"]
    assert spans["video"] == ((0.0, pytest.approx(2.9, abs=0.1)),)
    assert all(len(parts) == 1 for parts in spans.values())
    assert ("ugv 12", "r12.bin") in rows and ("clock", sources[3]["clock"]) in rows
    assert ("left out", "1 sentences with a wrong checksum") in rows
