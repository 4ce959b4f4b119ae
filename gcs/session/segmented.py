"""A table of a recording whose disk failed: its segments read as one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gcs.session.tables import Table, read_table
from infra.files.segments import segments

__all__ = ["read_segments"]


def read_segments(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> Table:
    """Read ``path`` and its further segments; rows that a failed sync had written again count once.

    Raises:
        SessionError: as :func:`gcs.session.tables.read_table`.
    """
    first, *rest = segments(path) or [path]
    table = read_table(first, required, optional)
    for later in rest:
        table = _joined(table, read_table(later, required, optional))
    return table


def _joined(table: Table, later: Table) -> Table:
    names = list(table.columns)
    ours = np.column_stack([table[name] for name in names])
    theirs = np.column_stack([later[name] for name in names])
    again = {row.tobytes() for row in theirs}
    whole = np.concatenate([ours[[row.tobytes() not in again for row in ours]], theirs])
    return Table(columns={name: whole[:, k] for k, name in enumerate(names)}, skipped=table.skipped + later.skipped)
