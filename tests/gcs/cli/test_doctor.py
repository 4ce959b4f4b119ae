"""What the doctor finds is what is there."""

from __future__ import annotations

import json
import socket
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from gcs.cli import doctor
from gcs.cli.app import app
from gcs.cli.doctor import _of_all_cameras
from gcs.health import detector_speed, machine
from mavlink.protocol.encoder import COPTER, ROVER
from tests.support.fake_station import FakeStation
from tests.support.fake_vehicles import FakeVehicle
from tests.support.ports import free_port
from vision.detect.detections import Detections


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(detector_speed, "MEASURED_S", 0.0)


def found(tmp_path, **options):
    """By name, with a detector that sees nothing: loading and measuring one takes a second."""
    blind = SimpleNamespace(detect=lambda image, *, gsd_m=None: Detections.empty())
    checks = machine.checks(tmp_path / "sessions", gsd_m=0.05, open_detector=lambda: blind, **options)
    return {check.name: check for check in checks}


def test_a_port_in_use_is_told_with_its_owner(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("0.0.0.0", 0))
        port, free = other.getsockname()[1], free_port()
        checks = found(tmp_path, ports=(port, free))
    assert checks[f"UDP port {port}"].verdict == "short"
    assert "in use by process" in checks[f"UDP port {port}"].found
    assert checks[f"UDP port {free}"].verdict == "ok"


def test_a_missing_codec_is_told_with_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "ENCODERS", ("libx264", "no such encoder"))
    checks = found(tmp_path)
    assert checks["video decoders"].verdict == "ok"
    assert checks["video encoders"].verdict == "bad"
    assert "no such encoder" in checks["video encoders"].found
    assert checks["video encoders"].advice


@pytest.mark.parametrize(
    ("fps", "cameras", "most", "verdict"), [(3, 1, 1, "ok"), (8.9, 2, 2, "ok"), (8.9, 3, 2, "short")]
)
def test_how_many_cameras_this_machine_carries(fps, cameras, most, verdict):
    check = machine.carried(fps, cameras)
    assert (check.verdict, check.found.split()[0], bool(check.advice)) == (verdict, str(most), verdict == "short")


def test_a_disk_that_is_nearly_full_is_told(tmp_path, monkeypatch):
    assert found(tmp_path)["disk"].verdict == "ok"
    monkeypatch.setattr(machine, "LOW_BYTES", 10**18)
    assert found(tmp_path)["disk"].verdict == "short"
    monkeypatch.setattr(machine, "FULL_BYTES", 10**18)
    assert found(tmp_path)["disk"].verdict == "bad"


def test_whatever_falls_short_comes_with_advice_and_programs_get_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "DECODERS", ("h264", "no such decoder"))
    once = cache(lambda sessions, **about: tuple(machine.checks(sessions, **about)))  # the detector takes a second
    monkeypatch.setattr(doctor, "checks", once)
    plain = CliRunner().invoke(app, ["doctor", "--sessions", str(tmp_path)])
    told = CliRunner().invoke(app, ["doctor", "--sessions", str(tmp_path), "--json"])
    assert plain.exit_code == told.exit_code == 2
    checks = json.loads(told.output)["checks"]
    assert {"versions", "system", "detector speed", "clock", "receive buffer", "terminal"} <= {
        c["name"] for c in checks
    }
    speed = next(check["found"] for check in checks if check["name"] == "detector speed")
    assert [word in speed for word in ("30 m up (", "60 m up (", "120 m up in turns (")] == [True] * 3
    for check in checks:
        assert check["found"]
        assert check["verdict"] == "ok" or check["advice"], check
        assert check["name"] in plain.output


MISSION = """
uav = {{system_id = 1}}
ugv = [{{system_id = 11}}, {{system_id = 12}}]
links = {{telemetry = ["udpin:127.0.0.1:{port}"]}}
"""


def test_with_a_mission_every_vehicle_is_listened_to_and_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    port = free_port()
    (tmp_path / "m.toml").write_text(MISSION.format(port=port))
    vehicles = [FakeVehicle(("127.0.0.1", port), i, kind=COPTER if i == 1 else ROVER) for i in (1, 11)]
    words = ["doctor", "--mission", "m.toml", "--listen", "4", "--height", "120", "--json"]
    try:
        told = CliRunner().invoke(app, words)
    finally:
        for each in vehicles:
            each.close()
    checks = json.loads(told.stdout)["checks"]
    by_name = {check["name"]: check for check in checks}
    assert told.exit_code == 2 and "with the mission's detector" in by_name["detector speed"]["found"]
    assert by_name["UGV-12"]["found"] == "system id 12 is not heard" and by_name["video"]["verdict"] == "short"
    assert by_name["UGV-11"]["found"] != "system id 11 is not heard"
    assert [each.name for each in tmp_path.iterdir()] == ["m.toml"]


def test_each_camera_is_checked_and_the_fleet_once():
    first, second = FakeStation(live=True), FakeStation(live=True)
    first.other_view, second.other_view = second, first
    uav, *rest = second.snapshot.vehicles
    second.snapshot = replace(second.snapshot, vehicles=(replace(uav, name="North"), *rest))
    alone, both = _of_all_cameras(first, 1), _of_all_cameras(first, 2)
    assert both[: len(alone)] == alone
    assert {check.name for check in both[len(alone) :]} <= {"North: video", "North: video delay", "North: camera"}
    assert len(both) > len(alone)
    second.snapshot = None
    assert _of_all_cameras(first, 2) == ()


def test_what_is_about_a_flight_needs_a_mission():
    assert CliRunner().invoke(app, ["doctor", "--command"]).exit_code != 0
