"""Benchmarks write into the working folder, and refuse options that cannot be."""

from __future__ import annotations

import csv
import os
import subprocess
import sys

import pytest

from bench.command_line import count, parser_of
from tests.support.bundled import ROOT


@pytest.mark.slow
def test_results_go_into_the_working_folder_and_nowhere_else(tmp_path):
    kept = {path: path.stat().st_mtime_ns for path in (ROOT / "bench" / "results").rglob("*")}
    done = subprocess.run(
        [sys.executable, "-m", "bench.latency", "--quick"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "bench-results" / "latency"
    with (folder / "latency.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["part"], row["frames"]) for row in rows] == [("tracker", "30"), ("identifier", "30"), ("both", "30")]
    assert all(float(row["cpu_median_ms"]) > 0.0 for row in rows)
    assert {path.name for path in folder.iterdir()} == {"latency.csv", "latency.md"}
    assert done.stdout.strip() == (folder / "latency.md").read_text().strip()
    assert kept == {path: path.stat().st_mtime_ns for path in (ROOT / "bench" / "results").rglob("*")}


@pytest.mark.parametrize("text", ["0", "-3", "nan", "two"])
def test_a_count_of_workers_that_cannot_be(text, capsys):
    parser = parser_of("x", "A benchmark", "less")
    parser.add_argument("--workers", type=count)
    with pytest.raises(SystemExit) as left:
        parser.parse_args(["--workers", text])
    assert left.value.code == 2
    assert "--workers" in capsys.readouterr().err
