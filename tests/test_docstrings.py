"""Docstrings read alone, as in a tool-tip: first the thing, then the unit, then why."""

import re
from pathlib import Path

import pytest

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training")
NO_BEGINNING = "Of|So|And|Between|As|What|Whether"
NO_NOUN = "Where|Which|How|When|By|Who|Whom|Whose|Whoever"
STILL = ("assoc", "vision/detect", "vision/stream", "gcs/mission", "gcs/flight/frame_loop.py", "gcs/flight/views.py")
"""Where these still are."""


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_goes_on_with_the_name_above_it(room):
    found = {}
    for path in Path(room).rglob("*.py"):
        words = NO_BEGINNING if path.as_posix().startswith(STILL) else f"{NO_BEGINNING}|{NO_NOUN}"
        if lines := re.findall(rf'^ *r?"""(?:{words})\b.*', path.read_text(encoding="utf-8"), re.MULTILINE):
            found[str(path)] = lines
    assert not found
