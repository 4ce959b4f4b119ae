"""The examples in documents and docstrings are true."""

import doctest
import importlib
from pathlib import Path

import pytest

from tests.support.bundled import CURVED_ROAD

PRODUCT = ("gcs", "mavlink", "vision", "assoc", "sim", "infra")
WITH_EXAMPLES = sorted(
    path for package in PRODUCT for path in Path(package).rglob("*.py") if ">>> " in path.read_text(encoding="utf-8")
)


def test_worked_example_of_the_identity_document():
    result = doctest.testfile(str(Path("docs/identity.md").resolve()), module_relative=False)
    assert result.attempted >= 9
    assert result.failed == 0


@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=str)
def test_examples_in_docstrings_are_true(path, tmp_path, monkeypatch):
    module = importlib.import_module(".".join(path.with_suffix("").parts))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.tlog").write_bytes(CURVED_ROAD.joinpath("telemetry.tlog").read_bytes())
    result = doctest.testmod(module)
    assert result.failed == 0
