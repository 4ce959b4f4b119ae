"""What is told or refused before a flight begins, since it would fail in the air."""

import resource

import pytest

from gcs.cli import fly
from gcs.cli.output.console import check_terminal
from gcs.errors import GcsError
from tests.support.command_line import run_gcs
from tests.support.ports import free_port

MISSION = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[[ugv]]\nsystem_id = 12\n"


def test_vehicles_without_a_key_are_named_with_the_folder(tmp_path):
    keys, path = tmp_path / "keys", tmp_path / "mission.toml"
    path.write_text(MISSION + '[signing]\nkeys = "keys"\n')
    assert run_gcs("keys", "new", "11", "--keys", keys)[0] == 0
    words = ("fly", path, "-l", f"udpin:127.0.0.1:{free_port()}", "--headless", "--duration", 0.1)
    code, _, told = run_gcs(*words, "--sessions", tmp_path / "sessions")
    assert code == 0 and f"{keys} has no key for UAV (1), UGV-12 (12)" in told


@pytest.mark.parametrize(("hard", "flies"), [(36, False), (4096, True), (resource.RLIM_INFINITY, True)])
def test_few_files_are_raised_or_refused(hard, flies, monkeypatch):
    asked = []
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (36, hard))
    monkeypatch.setattr(resource, "setrlimit", lambda kind, limits: asked.append(limits))
    if flies:
        fly._check(None, screen=False)
        assert asked == [(fly.MIN_FILES, hard)]
    else:
        with pytest.raises(GcsError, match="only 36 files may be open, and a flight needs 128"):
            fly._check(None, screen=False)


def test_a_terminal_that_cannot_show_screens_is_refused(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    check_terminal("fly without")
    monkeypatch.setenv("TERM", "dumb")
    with pytest.raises(GcsError, match=r"TERM=dumb.*fly without"):
        check_terminal("fly without")
