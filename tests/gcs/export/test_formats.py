"""The list of formats, and its table in the documents."""

import re
from pathlib import Path

from gcs.export.formats import FORMATS
from tests.support.command_line import run_gcs


def test_the_document_has_the_list():
    table = Path("docs/export.md").read_text(encoding="utf-8").partition("## All formats")[2].partition("##")[0]
    rows = [line.split(" | ")[:5] for line in table.splitlines() if line.startswith("| `")]
    told = {row[0].strip("| `"): [cell.strip(" `|") for cell in row[1:]] for row in rows}
    assert told == {
        form.name: [form.suffix or "folder", form.contents, form.opened_by, form.extra] for form in FORMATS.values()
    }


def test_the_list_names_each_format():
    code, told, _ = run_gcs("export", "--list")
    assert code == 0
    assert set(re.findall(r"^ *│? *([a-z0-9]+) ", told, re.MULTILINE)) >= set(FORMATS)


def test_no_two_formats_have_one_ending():
    endings = [form.suffix for form in FORMATS.values() if form.suffix]
    assert len(endings) == len(set(endings))
