"""Benchmarks write into the working folder, and say the same to people and to programs."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from bench.command_line import count, parser_of, print_results
from tests.support.bundled import ROOT


@pytest.mark.slow
def test_results_go_into_the_working_folder_and_nowhere_else(tmp_path):
    kept = {path: path.stat().st_mtime_ns for path in (ROOT / "bench" / "results").rglob("*")}
    done = subprocess.run(
        [sys.executable, "-m", "bench.latency", "--quick", "--json"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["folder"] == "bench-results/latency"
    assert [(row["part"], row["frames"]) for row in told["rows"]] == [("tracker", 30), ("identifier", 30), ("both", 30)]
    assert all(row["cpu_median_ms"] > 0.0 for row in told["rows"])
    written = {path.name for path in (tmp_path / "bench-results" / "latency").iterdir()}
    assert written == {"latency.csv", "latency.md"}
    assert kept == {path: path.stat().st_mtime_ns for path in (ROOT / "bench" / "results").rglob("*")}


def test_rows_of_numbers_and_words_for_programs(tmp_path, capsys):
    (tmp_path / "rows.csv").write_text("method,frames,share,p95\nTTS,12,0.5,\n[red]x,0,nan,1e-3\n")
    print_results("| a table |", tmp_path / "rows.csv", as_json=True)
    assert json.loads(capsys.readouterr().out)["rows"] == [
        {"method": "TTS", "frames": 12, "share": 0.5, "p95": None},
        {"method": "[red]x", "frames": 0, "share": None, "p95": 0.001},
    ]
    print_results("| a table |", tmp_path / "rows.csv", as_json=False)
    assert capsys.readouterr().out == "| a table |\n"


@pytest.mark.parametrize("text", ["0", "-3", "nan", "two"])
def test_a_count_of_workers_that_cannot_be(text, capsys):
    parser = parser_of("x", "A benchmark", "less")
    parser.add_argument("--workers", type=count)
    with pytest.raises(SystemExit) as left:
        parser.parse_args(["--workers", text])
    assert left.value.code == 2
    assert "--workers" in capsys.readouterr().err
