"""Tables and progress: drawn on terminals, plain and complete elsewhere; cells are text, whatever they say."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from gcs.cli.output.progress import LINE_PAUSE_S, progress
from gcs.cli.output.tables import print_table

HOSTILE = "[red]x[/] [link=http://a.b]:bomb:\x1b[31m"
SHOWN = "[red]x[/] [link=http://a.b]:bomb:\N{REPLACEMENT CHARACTER}[31m"
SCRIPT = f"""
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
with progress("[b]work[/b]") as report:
    for done in range(1, 1001):
        report(done, 1000)
print_table(("name", "count"), [({HOSTILE!r}, "12")], right=("count",))
"""


def on_a_terminal(script):
    """What a script writes where its output is a terminal."""
    ours, its = pty.openpty()
    environment = {"COLUMNS": "80", **os.environ, "TERM": "xterm-256color", "LINES": "24"}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=its, stderr=its, stdin=its, env=environment
    ) as process:
        os.close(its)
        written = b""
        while True:
            try:
                piece = os.read(ours, 65536)
            except OSError:  # Linux: the other end is closed
                piece = b""
            if not piece:
                break
            written += piece
        os.close(ours)
    assert process.returncode == 0
    return written.decode()


def test_piped_tables_are_columns_of_plain_text(capsys):
    print_table(("name", "count"), [(HOSTILE, "12"), ("Alpha " * 100, "3")], right=("count",))
    head, first, second = capsys.readouterr().out.splitlines()
    assert head.split() == ["name", "count"]
    assert first.startswith(SHOWN)
    assert first.index("12") + 1 == second.index("3", len("Alpha " * 100)) == len(head) - 1
    assert (first + second).isprintable()


def test_a_terminal_gets_one_bar_and_a_table_and_no_orders_from_others():
    written = on_a_terminal(SCRIPT)
    assert "[b]work[/b]" in written and "━" in written and "%" in written
    assert written.count("\n") < 40  # it is drawn over itself
    assert SHOWN in written
    assert "─" in written  # below the names of the columns


REMARK = "no position for 15.1 s; not known whether in view in 51 frames; and more of the same kind besides"
NOTES = f"""
from gcs.cli.output.tables import print_table
print_table(("id", "name", "remark"), [("11", "UGV-11", {REMARK!r}), ("12", "UGV-12", "")], noted="name")
"""


@pytest.mark.parametrize("columns", [80, 160])
def test_sentences_of_rows_are_below_the_table_of_a_narrow_terminal(monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = on_a_terminal(NOTES).splitlines()
    if columns == 80:
        assert not any("remark" in line for line in lines)
        assert " ".join(lines[-2:]).endswith(f"UGV-11: {REMARK}") and all(len(line) <= 80 for line in lines)
    else:
        assert any("UGV-11" in line and REMARK in line for line in lines)


@pytest.mark.parametrize(("took_s", "lines"), [(LINE_PAUSE_S / 2, 0), (2.5 * LINE_PAUSE_S, 2), (1000.0, 10)])
def test_elsewhere_a_line_now_and_then(capsys, took_s, lines):
    now_s = [0.0]
    with progress("identify", lambda: now_s[0]) as report:
        for done in range(1, 1001):
            now_s[0] = took_s * done / 1000
            report(done, 1000)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == lines
    assert all(line.startswith("gcs: identify: ") and line.endswith(" of 1000)") for line in told)
