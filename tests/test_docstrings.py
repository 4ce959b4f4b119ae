"""Docstrings read alone, as in a tool-tip: first the thing, then the unit, then why."""

import re
from pathlib import Path

import pytest

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training")
NO_BEGINNING = re.compile(r'^ *r?"""(?:Of|So|And|Between|As|What|Whether)\b.*', re.MULTILINE)


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_goes_on_with_the_name_above_it(room):
    texts = {path: path.read_text(encoding="utf-8") for path in Path(room).rglob("*.py")}
    assert not {str(path): found for path, text in texts.items() if (found := NO_BEGINNING.findall(text))}
