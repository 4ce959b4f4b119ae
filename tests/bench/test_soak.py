"""The soak's instruments: what was recorded, what a process costs, and a page that adds up."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bench.soak import Run, mission, report
from bench.station import cost_of, family
from gcs.mission.mission import load_mission

KEY = bytes(range(32))
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@LINUX
def test_a_process_and_all_below_it():
    words = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'input()'])"
    with subprocess.Popen([sys.executable, "-c", words], stdin=subprocess.PIPE, text=True) as process:
        while len(family(process.pid)) < 2:
            assert process.poll() is None
        cost = cost_of(process.pid)
        process.communicate("\n", timeout=120)
    assert cost.processes == 2 and cost.rss_mb > cost.own_mb > 1 and cost.threads >= 2
    assert family(process.pid) == [] and cost_of(process.pid).rss_mb == 0
    assert cost_of(os.getpid()).descriptors > 2


def test_the_missions_fleet_is_the_fakes(tmp_path):
    (tmp_path / "mission.toml").write_text(mission(4))
    loaded = load_mission(tmp_path / "mission.toml")
    assert loaded.uav.system_id == 1 and loaded.ugv_ids == (11, 12, 13)


def test_the_page_says_what_is_missing():
    sample = {"processes": 3, "cpu_percent": 9.0, "threads": 12, "descriptors": 33, "records": 0, "stalls": 0}
    samples = [
        sample | {"t_s": 10.0 * k, "rss_mb": 200.0 + k, "own_mb": 100.0, "longest_stall_ms": 60} for k in range(1, 101)
    ]
    sent = {"packets": {"1": 50, "11": 50, "impostor 11": 10, "texts": 5, "garbage": 9, "boot words": 4},
            "seconds": 1000.0, "late_ms": 3.0}  # fmt: skip
    run = Run(
        samples=samples, sent=sent, recorded={1: 50, 11: 63, 200: 4}, stalls=0, longest_s=0.1, exit_code=0,
        last_line="", told=["UGV-11: no heartbeat", "UGV-11: no heartbeat", "a flood"],
    )  # fmt: skip
    chosen = argparse.Namespace(
        seconds=1000.0,
        rate=100.0,
        vehicles=2,
        video=Path("a.mp4"),
        fleet=["--flood", "5"],
        out=Path(),
        name="soak",
    )
    page = report(run, chosen)
    assert "| packets sent by vehicles | 115 |" in page and "| not in the recording | 2 |" in page
    assert "| warnings and alarms | 3; UGV-11: no heartbeat; a flood |" in page
    assert "+360.0 MB an hour" in page and "+0.0%; " in page and "-- --flood 5" in page
