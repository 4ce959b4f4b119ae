"""What the doctor finds is what is there."""

from __future__ import annotations

import json
import socket

import pytest
from typer.testing import CliRunner

from gcs.cli.app import app
from gcs.health import machine
from tests.support.ports import free_port


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(machine, "MEASURED_S", 0.0)
    monkeypatch.setattr(machine, "FRAME_SIZE", (320, 192))


def found(tmp_path, **options):
    return {check.name: check for check in machine.checks(tmp_path / "sessions", **options)}


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


def test_a_disk_that_is_nearly_full_is_told(tmp_path, monkeypatch):
    assert found(tmp_path)["disk"].verdict == "ok"
    monkeypatch.setattr(machine, "LOW_BYTES", 10**18)
    assert found(tmp_path)["disk"].verdict == "short"
    monkeypatch.setattr(machine, "FULL_BYTES", 10**18)
    assert found(tmp_path)["disk"].verdict == "bad"


def test_whatever_falls_short_comes_with_advice_and_programs_get_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "DECODERS", ("h264", "no such decoder"))
    plain = CliRunner().invoke(app, ["doctor", "--sessions", str(tmp_path)])
    told = CliRunner().invoke(app, ["doctor", "--sessions", str(tmp_path), "--json"])
    assert plain.exit_code == told.exit_code == 2
    checks = json.loads(told.output)["checks"]
    assert {"versions", "system", "detector speed", "clock", "receive buffer", "terminal"} <= {
        c["name"] for c in checks
    }
    for check in checks:
        assert check["found"]
        assert check["verdict"] == "ok" or check["advice"], check
        assert check["name"] in plain.output
