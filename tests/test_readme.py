"""Every command of the README and of the docs' start page is one that there is, with its options."""

from __future__ import annotations

import re
import shlex

import pytest
import typer

from gcs.cli.app import app
from tests.support.bundled import ROOT

PAGES = (ROOT / "README.md", ROOT / "docs" / "index.md")
COMMANDS = [
    line.partition(" #")[0].strip()
    for page in PAGES
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.splitlines()
]
TARGETS = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def test_there_are_commands_and_the_first_two_are_for_newcomers():
    assert COMMANDS[:2] == ["make demo", ".venv/bin/gcs fly"]
    assert len(COMMANDS) > 30


@pytest.mark.parametrize("line", sorted(set(COMMANDS)))
def test_a_command_is_one_that_there_is(line):
    program, *words = shlex.split(line)
    if program == "make":
        assert set(words) <= set(TARGETS)
    elif program == "python":
        module = ROOT / words[1].replace(".", "/")
        assert words[0] == "-m" and (module.with_suffix(".py").is_file() or (module / "__main__.py").is_file())
    else:
        assert program in ("gcs", ".venv/bin/gcs")
        command, name = typer.main.get_command(app), program
        while hasattr(command, "list_commands"):
            context = command.make_context(name, list(words), resilient_parsing=True)
            name = max((n for n in command.list_commands(context) if f" {n} " in f" {' '.join(words)} "), key=len)
            words = words[words.index(name.split()[0]) + len(name.split()) :]
            command = command.get_command(context, name)
        command.make_context(name, list(words))


def test_pictures_are_there_and_load_fast():
    for page in PAGES:
        pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
        assert pictures and sum((page.parent / picture).stat().st_size for picture in pictures) < 1_200_000
