"""The boxes of one flight of a batch: its ``identity.jsonl`` in, a Parquet file out."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import msgspec

from gcs.errors import BatchError
from gcs.export.tables.identity_table import IdentityTable

__all__ = ["write_identity_table"]


def write_identity_table(evidence: Path, path: Path, about: Mapping[str, str]) -> None:
    """Write a flight's boxes as a Parquet file.

    Args:
        evidence: an ``identity.jsonl``.
        path: of the file, which is replaced.
        about: what the file tells of itself, such as the version of the program.

    Raises:
        GcsError: pyarrow is not installed.
        BatchError: the evidence is none.
    """
    with closing(IdentityTable(str(path), about)) as table, evidence.open("rb") as lines:
        for line in lines:
            try:
                table.add(line)
            except msgspec.DecodeError as error:
                raise BatchError(f"{evidence}: {error}") from error
