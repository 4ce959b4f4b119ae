"""The examples in the documents are true."""

import doctest
from pathlib import Path


def test_worked_example_of_the_identity_document():
    result = doctest.testfile(str(Path("docs/identity.md").resolve()), module_relative=False)
    assert result.attempted >= 9
    assert result.failed == 0
