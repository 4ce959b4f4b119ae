"""Who sent each record of a session, as far as it is noted in ``senders.csv``."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from infra.files.safe_open import open_to_read
from infra.files.segment import segments
from infra.plain_text import from_cell
from infra.session_format import SENDERS

Ints = NDArray[np.int64]
_NUMBERS = SENDERS.columns.index("address")
"""The columns before are numbers, those from there on are words."""
_BOUND = 1 << 62


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSenders:
    """How n records came."""

    link: Ints
    """(n,) index of the link, 0 where it is not known."""
    peer: Ints
    """(n,) number of the sender on that link, 0 where it is not known."""
    names: tuple[str, ...]
    """Names of the links, by index."""
    addresses: Mapping[tuple[int, int], str]
    """Addresses of link and sender, in words."""
    skipped: int
    """Rows that cannot be read."""

    @classmethod
    def unknown(cls, count: int) -> RecordSenders:
        """Senders of a log without that table."""
        link, peer = np.zeros((2, count), dtype=np.int64)
        return cls(link=link, peer=peer, names=(), addresses={}, skipped=0)

    @classmethod
    def read(cls, path: Path, t_us: Ints, system_id: NDArray[np.uint8]) -> RecordSenders:
        """Read ``senders.csv`` and its further segments.

        A row holds from its record on, for one system id. Where numbers and times do not agree, because records were
        lost, it holds from its time on.

        Args:
            t_us: (n,) stamps of all records.
            system_id: (n,) of their senders.
        """
        rows, skipped = _read_rows(path)
        link, peer = np.zeros((2, len(t_us)), dtype=np.int64)
        table = np.array([row[:_NUMBERS] for row, _ in rows], dtype=np.int64).reshape(len(rows), _NUMBERS)
        table = table[np.argsort(table[:, 0], kind="stable")]
        numbered = _match_records(table, t_us, system_id)
        for i in np.unique(table[:, 2]).tolist():
            of_id, mine = table[table[:, 2] == i], np.flatnonzero(system_id == i)
            since, moments = (of_id[:, 0], mine) if numbered else (of_id[:, 1], t_us[mine])
            row = np.searchsorted(since, moments, side="right") - 1
            link[mine], peer[mine] = np.where(row >= 0, of_id[row, 3:5].T, 0)
        last = max((numbers[3] for numbers, _ in rows), default=-1)
        named = {numbers[3]: words[1] for numbers, words in rows}
        return cls(
            link=link,
            peer=peer,
            names=tuple(named.get(k, f"link {k}") for k in range(min(last + 1, 256))),
            addresses={(numbers[3], numbers[4]): words[0] for numbers, words in rows},
            skipped=skipped,
        )

    def address(self, link: int, peer: int) -> str:
        """Address of a sender, in words; empty where it is not known."""
        return self.addresses.get((link, peer), "")


def _match_records(table: Ints, t_us: Ints, system_id: NDArray[np.uint8]) -> bool:
    """Tell whether every row is about the record that has its number."""
    number = table[:, 0]
    if not len(t_us) or (number >= len(t_us)).any():
        return False
    return bool((t_us[number] == table[:, 1]).all() and (system_id[number] == table[:, 2]).all())


def _read_rows(path: Path) -> tuple[list[tuple[tuple[int, ...], tuple[str, str]]], int]:
    """Numbers and words of each row of all segments, and how many cannot be read: they are no reason to do without."""
    rows, skipped = [], 0
    for part in segments(path):
        try:
            with os.fdopen(open_to_read(part), encoding="utf-8", errors="replace", newline="") as lines:
                for cells in filter(None, itertools.islice(csv.reader(lines), 1, None)):
                    row = _parse_row(cells)
                    rows += [row] if row else []
                    skipped += not row
        except (OSError, csv.Error):
            skipped += 1
    return rows, skipped


def _parse_row(cells: list[str]) -> tuple[tuple[int, ...], tuple[str, str]] | None:
    try:
        numbers = tuple(map(int, cells[:_NUMBERS]))
        address, name = map(from_cell, cells[_NUMBERS : len(SENDERS.columns)])
    except ValueError:
        return None
    return (numbers, (address, name)) if all(0 <= number < _BOUND for number in numbers) else None
