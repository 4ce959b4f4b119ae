"""Docstrings read alone, as in a tool-tip: first the thing, then the unit, then why."""

import ast
import re
from pathlib import Path

import pytest

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training")
NO_BEGINNING = re.compile(r"(Of|So|And|Between|As)\b")
OLD = ("gcs/tui", "gcs/report", "gcs/cli/fly.py", "gcs/cli/doctor.py", "gcs/cli/contact.py", "gcs/fold/pipeline.py")
"""Places with some that begin so."""


def docstrings(path):
    """Line and text of each string that stands alone: docstrings, and those below fields and constants."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for each in getattr(node, "body", None) if isinstance(getattr(node, "body", None), list) else ():
            if (
                isinstance(each, ast.Expr)
                and isinstance(each.value, ast.Constant)
                and isinstance(each.value.value, str)
            ):
                yield each.lineno, each.value.value.strip()


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_goes_on_with_the_name_above_it(room):
    paths = [p for p in Path(room).rglob("*.py") if not p.as_posix().startswith((*OLD, "mavlink/fleet"))]
    found = [
        f"{path}:{line}: {text[:60]}" for path in paths for line, text in docstrings(path) if NO_BEGINNING.match(text)
    ]
    assert not found
