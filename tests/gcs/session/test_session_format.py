"""The listing of a session in the documents is what is written."""

import re

from infra import session_format
from infra.session_format import TableFormat
from tests.support.bundled import ROOT


def listing():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return text.partition("\n## A session\n")[2].partition("\n## ")[0]


WRITTEN = [value for name, value in vars(session_format).items() if name.isupper()]


def test_it_has_the_columns_of_every_table():
    listed = dict(re.findall(r"^  (\w+\.csv) +([\w,]+)", listing(), flags=re.MULTILINE))
    assert listed == {table.name: table.heading for table in WRITTEN if isinstance(table, TableFormat)}


def test_it_has_every_other_file():
    names = [name.replace("{}", "2/") for name in WRITTEN if isinstance(name, str)]
    assert [name for name in names if f"  {name} " not in listing()] == []
