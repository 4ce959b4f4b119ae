"""What commands print for programs has the shape that docs/json.md tells."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from gcs.cli.identify import identify_into
from sim.live import PlaybackCounts
from tests.support.bundled import ROOT, SWARM, swarm_session
from tests.support.command_line import help_pages, run_gcs
from tests.support.films.board_video import BoardCamera, poses, write_video
from tests.support.ports import free_port
from vision.evaluation import evaluate
from vision.evaluation.comparison import Comparison, compare
from vision.evaluation.report import as_json

SECTIONS = dict(
    zip(
        *[iter(re.split(r"^## (.*)$", (ROOT / "docs" / "json.md").read_text(), flags=re.MULTILINE)[1:])] * 2,
        strict=True,
    )
)


def documented(command):
    """The top keys that the page has for a command."""
    (body,) = (body for head, body in SECTIONS.items() if f"`gcs {command}`" in head or f"`gcs {command} -" in head)
    return {key for row in re.findall(r"^\| (`.*?) \|", body, re.MULTILINE) for key in re.findall(r"`(\w+)`", row)}


def printed(*words, code=0):
    """The one object that a command prints."""
    got, stdout, stderr = run_gcs(*words, "--json")
    assert got == code, stderr
    assert stdout.count("\n") == 1
    return json.loads(stdout)


def test_every_command_with_json_is_documented():
    able = {command for command, page in help_pages() if "--json" in page}
    assert able == {
        *("fly", "identify", "demo", "score", "tlog info", "tlog check", "keys list", "keys check"),
        *("doctor", "calibrate", "eval-detector", "import", "batch run", "sim run", "sim from-tracks"),
    }
    for command in able:
        assert documented(command)


def test_recordings(tmp_path):
    named = printed("identify", swarm_session(tmp_path, frames=3), "-o", tmp_path / "out")
    assert set(named) == documented("identify") - {"packets"}
    assert {(row["system_id"], row["name"]) for row in named["vehicles"]} == {(i, f"UGV-{i}") for i in range(2, 8)}
    score = printed("score", SWARM, tmp_path / "out" / "identity.csv")
    assert set(score) == documented("score")


@pytest.mark.slow
def test_batches(tmp_path):
    code, stdout, _ = run_gcs("batch", "run", swarm_session(tmp_path, frames=3), "-o", tmp_path / "out", "--json")
    assert code == 0
    flight, sums = map(json.loads, stdout.splitlines())
    assert set(flight) | set(sums) == documented("batch run")


def test_logs_and_keys(tmp_path):
    log = SWARM / "telemetry.tlog"
    assert set(printed("tlog", "info", log)) == documented("tlog info")
    assert set(printed("tlog", "check", log)) == documented("tlog check")
    for who in ("11", "12"):
        assert run_gcs("keys", "new", who, "--keys", tmp_path / "keys")[0] == 0
    keys = printed("keys", "list", "--keys", tmp_path / "keys")
    assert set(keys) == documented("keys list")
    assert [key["of"] for key in keys["keys"]] == ["system 11", "system 12"]
    (tmp_path / "keys" / "12.key").write_bytes((tmp_path / "keys" / "11.key").read_bytes())
    checked = printed("keys", "check", "--keys", tmp_path / "keys", "--log", log)
    assert set(checked) == documented("keys check")
    assert checked["shared"] == [["system 11", "system 12"]]
    (judged,) = checked["logs"]
    assert {row["verdict"] for row in judged["verdicts"]} == {"unsigned"}
    assert sum(row["frames"] for row in judged["verdicts"]) == 16301


def test_simulations(monkeypatch):
    played = PlaybackCounts(packets={1: 5, 11: 7}, frames=3, frames_skipped=0, start_us=17)
    monkeypatch.setattr("gcs.cli.sim.play", lambda *_, **__: played)
    assert printed("sim", "run", "curved-road", "--live") == {
        "packets": {"1": 5, "11": 7},
        "frames": 3,
        "frames_skipped": 0,
        "start_us": 17,
    }
    assert documented("sim run") == {"packets", "frames", "frames_skipped", "start_us"}


def test_the_demo(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.cli.demo.BUNDLED", swarm_session(tmp_path, frames=3))
    monkeypatch.setattr("gcs.cli.demo.identify_into", lambda session, out, detect: identify_into(session, out))
    told = printed("demo")
    assert set(told) == documented("demo")
    assert set(told["score"]) == documented("score")


@pytest.mark.slow
def test_the_demo_of_a_flight(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = printed("demo", "--live")
    assert set(told) == documented("fly")
    assert sum(vehicle["boxes"] > 0 for vehicle in told["vehicles"]) >= 4
    assert (tmp_path / "mission.toml").is_file()


def test_a_flight(tmp_path):
    (tmp_path / "m.toml").write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n")
    words = (
        "-l",
        f"udpin:127.0.0.1:{free_port()}",
        "--headless",
        "--duration",
        "0.1",
        "--sessions",
        tmp_path / "sessions",
    )
    told = printed("fly", tmp_path / "m.toml", *words)
    assert set(told) == documented("fly")
    (vehicle,) = told["vehicles"]
    assert 0.0 <= vehicle.pop("longest_silence_s") < 60.0
    assert vehicle == {
        "system_id": 2,
        "name": "UGV-2",
        "first_named_s": None,
        "boxes": 0,
        "frames_in_view": 0,
        "frames_unknown": 0,
        "share": None,
        "confidence": None,
        "outcome": "never heard",
        "why": "",
        "silence_frozen": False,
    }


def test_a_camera_and_a_detector(tmp_path):
    size, rng = (640, 360), np.random.default_rng(1)
    K, lens = np.array([[452.4, 0.0, 327.4], [0.0, 451.0, 174.4], [0.0, 0.0, 1.0]]), np.zeros(5)
    camera = BoardCamera(size, K, lens)
    write_video(tmp_path / "b.mp4", [camera.draw(R, t, rng) for R, t in poses(14, rng, K, lens, size)], size)
    told = printed("calibrate", tmp_path / "b.mp4", "-o", tmp_path / "lens.toml")
    assert set(told) == documented("calibrate")
    assert told["doubts"] == []
    judged = evaluate([], [])
    beside = Comparison(against="bundled", other=judged, differences=compare([], [], [], 0.3))
    assert set(json.loads(as_json(judged, {}, beside))) == documented("eval-detector")
