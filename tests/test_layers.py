"""What import-linter cannot say: what assoc and tests may import, and that every folder says what it is for."""

import ast
import sys
from pathlib import Path

ALLOWED = {"assoc", "numpy", "scipy"}


def imported_modules(path):
    """Names of all modules that a file imports, and whether each is named in full."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: import by the full name"
            yield node.module or ""


def test_association_imports_numpy_and_scipy_alone():
    files = list(Path("assoc").rglob("*.py"))
    assert len(files) > 30
    for path in files:
        packages = {name.partition(".")[0] for name in imported_modules(path)}
        assert packages <= ALLOWED | sys.stdlib_module_names, path


def test_tests_stand_on_their_support_alone_and_only_those_of_benches_on_benches():
    files = list(Path("tests").rglob("*.py"))
    assert len(files) > 100
    assert len(list(Path("tests/support").glob("*.py"))) <= 20
    for path in files:
        modules = set(imported_modules(path))
        others = {name for name in modules if name.startswith("tests.") and not name.startswith("tests.support.")}
        assert not others, f"{path}: {others}"
        of_benches = {name for name in modules if name.partition(".")[0] == "bench"}
        assert not of_benches or path.is_relative_to("tests/bench"), f"{path}: {of_benches}"


def test_every_package_says_what_it_is_for():
    for room in ("rollcall", "gcs", "mavlink", "vision", "assoc", "sim", "infra", "training"):
        for path in Path(room).rglob("__init__.py"):
            words = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            assert len(words) > 30, path
        crowded = {p.parent for p in Path(room).rglob("*.py") if len(list(p.parent.glob("*.py"))) > 20}
        assert not crowded
