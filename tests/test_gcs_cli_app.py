"""The command itself: its help is quick, its commands exist, shells complete it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from gcs.cli.app import app

HEAVY = ("numpy", "cv2", "av", "onnxruntime", "textual", "pymavlink", "scipy")


def test_help_names_every_command_and_loads_none():
    script = "import sys\nfrom gcs.cli.app import main\ntry: main()\nexcept SystemExit: pass\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script, "--help"], capture_output=True, text=True, check=True, timeout=60
    )
    text, _, modules = done.stdout.rpartition("\n  bench ")
    assert "\n  fly " in text
    assert "\n  keys " in text
    assert not set(HEAVY) & set(modules.split())


@pytest.mark.parametrize("command", ["fly", "replay", "identify", "export", "score", "tlog", "keys", "sim", "demo"])
def test_every_command_has_a_page_of_help(command):
    page = CliRunner().invoke(app, [command, "--help"])
    assert page.exit_code == 0
    assert f"gcs {command} [" in page.output


@pytest.mark.parametrize(
    ("shell", "words"),
    [
        ("bash", {"COMP_WORDS": "gcs re", "COMP_CWORD": "1"}),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "gcs re"}),
        ("fish", {"_TYPER_COMPLETE_ARGS": "gcs re", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}),
    ],
)
def test_shells_complete_commands(shell, words):
    script = "import sys; sys.argv[0] = 'gcs'\nfrom gcs.cli.app import main; main()"
    environment = {**os.environ, **words, "_GCS_COMPLETE": f"complete_{shell}"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=False, timeout=60
    )
    assert "replay" in done.stdout
    assert "fly" not in done.stdout
