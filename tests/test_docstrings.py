"""Docstrings read alone, as in a tool-tip: first the thing, then the unit, then why."""

import ast
import re
from pathlib import Path

import pytest

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training")
NO_BEGINNING = re.compile(r"(Of|So|And|Between|As|Whether)\b")


def docstrings(path):
    """Line and text of each string that stands alone: docstrings, and those below fields and constants."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text.strip()


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_goes_on_with_the_name_above_it(room):
    assert not [
        f"{path}:{line}: {text[:60]}"
        for path in Path(room).rglob("*.py")
        for line, text in docstrings(path)
        if NO_BEGINNING.match(text)
    ]
