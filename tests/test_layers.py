"""What import-linter cannot say: assoc stands on an allow-list, and every folder says what it is for."""

import ast
import sys
from pathlib import Path

ALLOWED = {"assoc", "numpy", "scipy"}


def test_association_imports_numpy_and_scipy_alone():
    files = list(Path("assoc").rglob("*.py"))
    assert len(files) > 30
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: import by the full name"
                names = [node.module or ""]
            foreign = {name.partition(".")[0] for name in names} - ALLOWED - sys.stdlib_module_names
            assert not foreign, f"{path}: {foreign}"


def test_every_package_says_what_it_is_for():
    for room in ("gcs", "mavlink", "vision", "assoc", "sim", "infra"):
        for path in Path(room).rglob("__init__.py"):
            words = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            assert len(words) > 30, path
        crowded = {p.parent for p in Path(room).rglob("*.py") if len(list(p.parent.glob("*.py"))) > 20}
        assert not crowded
