"""Docstrings read alone, as in a tool-tip: first the thing, then the unit, then why."""

import re
from pathlib import Path

import pytest

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training")
NO_BEGINNING = (
    "Of|So|And|Between|As|What|Whether|Where|Which|How|When|By|Who|Whom|Whose|Whoever|That|Its|Since|Until|Under|Unless"
)


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_goes_on_with_the_name_above_it(room):
    found = {}
    for path in Path(room).rglob("*.py"):
        if lines := re.findall(rf'^ *r?"""(?:{NO_BEGINNING})\b.*', path.read_text(encoding="utf-8"), re.MULTILINE):
            found[str(path)] = lines
    assert not found
