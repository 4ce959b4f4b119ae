"""The examples in the documents are true."""

import doctest
import re
from pathlib import Path

from infra.session_format import TABLES


def test_worked_example_of_the_identity_document():
    result = doctest.testfile(str(Path("docs/identity.md").resolve()), module_relative=False)
    assert result.attempted >= 9
    assert result.failed == 0


def test_the_listing_of_a_session_has_the_columns_that_are_written():
    listing = Path("docs/architecture.md").read_text().partition("\n## A session\n")[2].partition("\n## ")[0]
    listed = dict(re.findall(r"^  (\w+\.csv) +([\w,]+)", listing, flags=re.MULTILINE))
    assert listed == {table.name: table.heading for table in TABLES}
