"""Folders of what is not whole yet: what a killed job left is removed by the next, what another works in is not."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from infra.files.aside import YOUNG_S, make_aside, remove_aside

MAKES = """
import sys
from pathlib import Path
from infra.files.aside import make_aside
made = make_aside(Path(sys.argv[1]))
(made / "half").write_text("x")
print(made, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """A process with a folder of its own, and that folder, which looks old."""
    command = [sys.executable, "-c", MAKES, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        hidden = tmp_path / process.stdout.readline().strip()
        age(hidden)
        yield process, hidden
        process.kill()


def age(hidden):
    then_s = hidden.stat().st_mtime - 2 * YOUNG_S
    os.utime(hidden, (then_s, then_s))


def test_what_a_killed_job_left_is_removed_by_the_next(tmp_path, other):
    process, hidden = other
    mine = make_aside(tmp_path)
    assert (hidden / "half").exists(), "its job is at work"
    process.kill()
    process.wait()
    age(hidden)
    next_one = make_aside(tmp_path)
    assert not hidden.exists() and mine.exists()
    remove_aside(mine)
    remove_aside(next_one)
    remove_aside(next_one)
    assert list(tmp_path.iterdir()) == []


def test_no_link_in_its_place_is_followed(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "kept").touch()
    (tmp_path / ".aside-x").symlink_to("elsewhere")
    os.utime(tmp_path / ".aside-x", (0, 0), follow_symlinks=False)
    remove_aside(make_aside(tmp_path))
    assert (tmp_path / "elsewhere" / "kept").exists()
