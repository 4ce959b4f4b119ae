"""The tree at the top of each package's errors.py is the tree of its classes, and no error is defined elsewhere."""

import importlib
import re

import pytest

from tests.support.bundled import ROOT

PACKAGES = ("gcs", "mavlink", "vision", "assoc", "sim")


def drawn(base, prefix=""):
    """Lines of the tree below a class, subclasses in the order in which they are defined."""
    below = base.__subclasses__()
    for number, kind in enumerate(below, 1):
        last = number == len(below)
        yield f"{prefix}{'└' if last else '├'}── {kind.__name__}"
        yield from drawn(kind, prefix + ("    " if last else "│   "))


def exceptions_defined_in(path):
    for name in re.findall(r"^ *class (\w+)\(.*(?:Error|Exception)\b", path.read_text(), re.MULTILINE):
        yield f"{path.relative_to(ROOT)}: {name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_tree_is_as_drawn(package):
    errors = importlib.import_module(f"{package}.errors")
    (base,) = (kind for kind in vars(errors).values() if isinstance(kind, type) and kind.__base__ is Exception)
    tree = [base.__name__, *drawn(base)]
    lines = (re.match(r"[ │]*(?:[├└]── )?\w+Error", line) for line in errors.__doc__.splitlines())
    assert [line.group().removeprefix("    ") for line in lines if line] == tree


@pytest.mark.parametrize("package", PACKAGES)
def test_no_error_is_defined_elsewhere(package):
    files = [path for path in (ROOT / package).rglob("*.py") if path != ROOT / package / "errors.py"]
    assert [found for path in files for found in exceptions_defined_in(path)] == []
