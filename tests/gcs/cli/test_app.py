"""The command itself: its help is quick, its commands exist, shells complete it."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from gcs.cli.app import app, as_spelt_now
from gcs.cli.output.console import print_json
from tests.support.command_line import help_pages, run_gcs

HEAVY = ("numpy", "pyarrow", "fsspec", "distributed", "cv2", "av", "onnxruntime", "textual", "pymavlink", "scipy")


def run_and_list_modules(script, *words):
    """Run a script in a process of its own; its output, and the modules that it has loaded by its end."""
    code = f"import sys\ntry:\n {script}\nexcept SystemExit: pass\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, timeout=60)
    text, _, modules = done.stdout.rstrip().rpartition("\n")
    return text, set(modules.split())


def test_help_names_every_command_and_loads_none():
    text, modules = run_and_list_modules("from gcs.cli.app import main; main()", "--help")
    assert "\n  fly " in text
    assert "\n  keys " in text
    assert not modules & set(HEAVY)


def test_help_on_replay_loads_nothing_that_replays():
    text, modules = run_and_list_modules("from gcs.cli.app import main; main()", "replay", "--help")
    assert "\n  --publish URL" in text
    assert not modules & set(HEAVY)


def test_the_screens_of_a_recording_come_before_all_that_only_its_fold_needs():
    _, modules = run_and_list_modules("import gcs.playback.replay, gcs.tui")
    assert "textual" in modules
    assert not modules & {"scipy", "pyproj", "onnxruntime", "serial", "gcs.flight", "gcs.fold.naming"}


@pytest.mark.parametrize(
    ("words", "new"),
    [
        (["bench"], "bench.NAME"),
        (["bench", "--help"], "bench.NAME"),
        (["bench", "field", "-x"], "bench.field -x"),
    ],
)
def test_a_command_that_moved_answers_with_what_to_type_now(words, new):
    code, _, stderr = run_gcs(*words)
    assert code == 2
    assert stderr == f"gcs: benchmarks are run in a checkout now: python -m {new}\n"


@pytest.mark.parametrize(
    ("old", "new", "answer"),
    [
        (["sim", "x.toml"], ["sim", "run", "x.toml"], "gcs sim is now gcs sim run"),
        (["batch", "-o", "out", "a"], ["batch", "run", "-o", "out", "a"], "gcs batch is now gcs batch run"),
        (["batch", "run", "report"], ["batch", "run", "report"], ""),
        (["sim", "run", "from-tracks"], ["sim", "run", "from-tracks"], ""),
        (["fly", "--out", "udpout:x:1"], ["fly", "--forward", "udpout:x:1"], "--out is now --forward"),
        (["replay", "a", "--tell=json+udp://x:1"], ["replay", "a", "--publish=json+udp://x:1"], "--tell is now"),
        (["fly", "--show", "udp://x:1"], ["fly", "--stream", "udp://x:1"], "--show is now --stream"),
        (["keys", "new", "1", "--show"], ["keys", "new", "1", "--show"], ""),
        (["identify", "a", "--out", "b"], ["identify", "a", "--out", "b"], ""),
    ],
)
def test_an_old_spelling_is_understood_and_answered_with_the_new_one(old, new, answer, capsys):
    assert as_spelt_now(old) == new
    err = capsys.readouterr().err
    assert (answer in err) if answer else not err


def test_help_has_groups_and_words_for_values():
    pages = dict(help_pages())
    assert {"batch run", "batch report", "sim run", "sim from-tracks", "tlog cut", "fly"} <= set(pages)
    assert not [name for name, page in pages.items() if re.search(r"<[^|>]*>|--[a-z-]+ [A-Z] ", page)]
    top = CliRunner().invoke(app, ["--help"]).output
    assert re.findall(r"^(\S.*):$", top, re.MULTILINE) == ["Options", "Fly and replay", "Recordings", "Workshop"]


@pytest.mark.parametrize(
    "command", ["fly", "replay", "identify", "batch", "export", "score", "tlog", "keys", "sim", "demo"]
)
def test_every_command_has_a_page_of_help(command):
    page = CliRunner().invoke(app, [command, "--help"])
    assert page.exit_code == 0
    assert f"gcs {command} [" in page.output


@pytest.mark.slow
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


def test_programs_get_json_without_unknown_numbers(capsys):
    print_json({"speed": math.nan, "rows": [{"age_s": math.inf, "name": "Über\nall"}], "n": 3})
    line = capsys.readouterr().out
    assert line.count("\n") == 1
    assert json.loads(line) == {"speed": None, "rows": [{"age_s": None, "name": "Über\nall"}], "n": 3}


def test_a_log_and_keys_as_json(tmp_path):
    log = CliRunner().invoke(app, ["tlog", "info", "sitl_logs/curved-road/telemetry.tlog", "--json"])
    told = json.loads(log.output)
    assert told["counts"]["records"] == 5112
    assert {row["name"] for row in told["messages"]} >= {"HEARTBEAT", "GLOBAL_POSITION_INT"}
    CliRunner().invoke(app, ["keys", "new", "11", "--keys", str(tmp_path / "keys")])
    keys = CliRunner().invoke(app, ["keys", "list", "--json", "--keys", str(tmp_path / "keys")])
    (key,) = json.loads(keys.output)["keys"]
    assert key["of"] == "system 11"
    assert key["fingerprint"]
