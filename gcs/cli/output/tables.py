"""Tables of the command line: drawn for a terminal, plain text in columns for a file or a pipe."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from infra.plain_text import plain

_UNLIMITED = 10_000_000
"""Columns of a line that no terminal limits: nothing is wrapped or cut in a file."""


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[str]], *, right: Collection[str] = (), head: bool = True
) -> None:
    """Print a table on stdout. Cells are plain text, never markup.

    Args:
        right: names of the columns that are aligned right: numbers.
        head: print the names above the columns.
    """
    terminal = sys.stdout.isatty()
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
