"""Setting up says what it does and how far it is, and shows what a program wrote that failed."""

from __future__ import annotations

import doctest
import importlib.util
import sys

import pytest

from tests.support.bundled import ROOT

SPEC = importlib.util.spec_from_file_location("set_up", ROOT / ".ci" / "set_up.py")
set_up = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(set_up)


@pytest.mark.parametrize("screen", [False, True])
def test_it_is_never_silent_for_long(screen, capsys, monkeypatch):
    monkeypatch.setattr(set_up, "LOGGED_S", 0.2)
    monkeypatch.setattr(set_up, "TOLD_S", 0.2)
    monkeypatch.setattr("sys.stdout.isatty", lambda: screen)
    code = "import time; print('Collecting numpy==2', flush=True); time.sleep(1.5)"
    assert set_up.run_step("1 of 1: installs", [sys.executable, "-c", code], 7) == 0
    told = capsys.readouterr().out
    assert told.lstrip("\r\x1b[K").startswith("1 of 1: installs") and "done in" in told
    assert "1 of 7 packages found" in told


def test_what_a_failed_step_wrote_is_shown(capsys):
    assert set_up.run_step("1 of 1: installs", [sys.executable, "-c", "raise SystemExit('no space left')"]) == 1
    assert "installs: failed\nno space left" in capsys.readouterr().out


def test_the_examples_are_true():
    assert doctest.testmod(set_up).failed == 0
