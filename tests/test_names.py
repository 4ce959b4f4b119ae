"""A class name stands for one thing in the whole product."""

import re
from collections import defaultdict
from pathlib import Path

ROOMS = ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training", "bench")


def test_no_class_name_stands_in_two_places():
    places = defaultdict(set)
    for path in (path for room in ROOMS for path in Path(room).rglob("*.py")):
        for name in re.findall(r"^ *class _*(\w+)[(:]", path.read_text(encoding="utf-8"), re.MULTILINE):
            places[name].add(str(path))
    assert not {name: found for name, found in places.items() if len(found) > 1}


def test_only_faces_list_their_names():
    paths = (path for room in ROOMS for path in Path(room).rglob("*.py") if path.name != "__init__.py")
    assert not [str(path) for path in paths if re.search(r"^__all__ ", path.read_text(encoding="utf-8"), re.MULTILINE)]
