"""The examples run as they are written, on the bundled recordings."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path("examples")


def run(name, *words):
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={"PYTHONPATH": ".", "PATH": "/usr/bin:/bin"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_run_here():
    here = Path(__file__).read_text(encoding="utf-8")
    for example in EXAMPLES.glob("*.py"):
        assert f'"{example.name}"' in here, example.name
        assert f"python {example} " in example.read_text(encoding="utf-8")


def test_a_log_becomes_arrays():
    text = run("tlog_to_numpy.py", "sitl_logs/ardupilot-swarm/telemetry.tlog")
    assert len(re.findall(r"^system \d+: \d{3,} positions", text, re.MULTILINE)) == 7


def test_boxes_of_anybodys_detector_get_names():
    text = run("own_detector.py", "sitl_logs/curved-road")
    assert len(re.findall(r": \d{2,} boxes", text)) >= 3, text


def test_telemetry_falls_on_the_vehicles(tmp_path):
    text = run("project_telemetry.py", "sitl_logs/curved-road", "60", str(tmp_path / "crosses.png"))
    assert "6 vehicles on frame 60" in text
    assert (tmp_path / "crosses.png").stat().st_size > 100_000


def test_an_export_of_ones_own(tmp_path):
    run("own_export.py", "sitl_logs/ardupilot-swarm", str(tmp_path / "seen.txt"))
    lines = (tmp_path / "seen.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) > 200
    with pytest.raises(AssertionError, match="FileExistsError"):
        run("own_export.py", "sitl_logs/ardupilot-swarm", str(tmp_path / "seen.txt"))


def test_a_flight_frame_by_frame():
    text = run("fold_frame_by_frame.py", "sitl_logs/ardupilot-swarm")
    named = float(re.search(r"([\d.]+) of 6 vehicles named", text)[1])
    assert named > 4.0
