"""The examples run as they are written, on the bundled recordings."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

from tests.support.bundled import CURVED_ROAD, SWARM, shortened

EXAMPLES = Path("examples")


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs an example as ``python`` does; returns what it prints."""

    def run_example(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *map(str, words)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run_example


def test_every_example_is_run_here_and_short():
    here = Path(__file__).read_text(encoding="utf-8")
    for example in EXAMPLES.glob("*.py"):
        text = example.read_text(encoding="utf-8")
        assert f'"{example.name}"' in here, example.name
        assert f"python {example} " in text
        assert len(text.splitlines()) <= 25, example.name
        assert "\nimport rollcall\n" in text


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_without_arguments_says_how_it_is_run(run, example):
    with pytest.raises(SystemExit, match=f"python {example} "):
        run(example.name)


def test_a_log_becomes_arrays(run):
    text = run("tlog_to_numpy.py", SWARM / "telemetry.tlog")
    assert len(re.findall(r"^system \d+: \d{3,} positions", text, re.MULTILINE)) == 7


def test_own_tracks_get_names_by_own_positions(run):
    assert "{1: 13, 2: 12, 3: 11}" in run("own_tracks.py", 5)


@pytest.mark.slow
def test_boxes_of_anybodys_detector_get_names(run, tmp_path):
    text = run("own_detector.py", shortened(CURVED_ROAD, tmp_path / "session", 30))
    assert len(re.findall(r": \d{2,} boxes", text)) >= 3, text


@pytest.mark.slow
def test_telemetry_falls_on_the_vehicles(run, tmp_path):
    text = run("project_telemetry.py", CURVED_ROAD, 6, tmp_path / "crosses.png")
    assert "6 vehicles on frame 6" in text
    assert (tmp_path / "crosses.png").stat().st_size > 100_000


@pytest.fixture
def six_seconds(tmp_path):
    return shortened(SWARM, tmp_path / "session", 60)


@pytest.mark.slow
def test_names_as_a_table(run, six_seconds):
    text = run("names_of_a_flight.py", six_seconds)
    assert len(re.findall(r": \d{2,} boxes", text)) >= 5, text
    assert float(re.search(r"right: ([\d.]+)%", text)[1]) > 95.0


def test_an_export_of_ones_own(run, six_seconds, tmp_path):
    run("own_export.py", six_seconds, tmp_path / "seen.txt")
    lines = (tmp_path / "seen.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) > 10
    with pytest.raises(FileExistsError):
        run("own_export.py", six_seconds, tmp_path / "seen.txt")


@pytest.mark.slow
def test_a_flight_frame_by_frame(run, six_seconds):
    text = run("fold_frame_by_frame.py", six_seconds)
    named = float(re.search(r"([\d.]+) of 6 vehicles named", text)[1])
    assert named > 2.0
