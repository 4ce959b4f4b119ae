"""Tables of the command line: drawn for a terminal, plain text in columns for a file or a pipe."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Collection, Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gcs.cli.output.console import print_lines
from infra.plain_text import plain

NARROW = 100
"""Columns of a terminal in which a column of sentences would be some words wide."""
_UNLIMITED = 10_000_000
"""Columns of a line that no terminal limits: nothing is wrapped or cut in a file."""


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    right: Collection[str] = (),
    head: bool = True,
    noted: str = "",
) -> None:
    """Print a table on stdout. Cells are plain text, never markup.

    Args:
        right: names of the columns that are aligned right: numbers.
        head: print the names above the columns.
        noted: column that names the row, where the last one has sentences: narrow terminals have those below the table.
    """
    terminal = sys.stdout.isatty()
    if noted and terminal and Console(file=sys.stdout).width < NARROW:
        rows, whose = list(rows), columns.index(noted)
        print_table(columns[:-1], [row[:-1] for row in rows], right=right, head=head)
        print_sentences(*(f"{row[whose]}: {row[-1]}" for row in rows if row[-1]))
        return
    table = Table(box=SIMPLE_HEAD if terminal and head else None, show_header=head, pad_edge=False, padding=(0, 1))
    for name in columns:
        table.add_column(Text(name), justify="right" if name in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(plain(cell)) for cell in row))
    console = Console(file=sys.stdout) if terminal else Console(file=sys.stdout, width=_UNLIMITED, color_system=None)
    with console.capture() as drawn:
        console.print(table)
    sys.stdout.write("".join(f"{line.rstrip()}\n" for line in drawn.get().splitlines()))
    sys.stdout.flush()


def print_sentences(*sentences: str) -> None:
    """Print a line for each, on a terminal as many as it takes, broken between words."""
    width = Console(file=sys.stdout).width if sys.stdout.isatty() else _UNLIMITED
    print_lines(*(line for each in sentences for line in textwrap.wrap(each, width) or [""]))
