"""In which order a flight took in telemetry and frames, so that a replay can do the same.

``folds.csv`` has a row for every turn of the fold: the frame that was looked at, or none, and how many telemetry
records had been taken in until then. ``unfolded.csv`` has the records that were never taken in: what the station itself
sent, and what it could not keep up with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.session.tables import read_table
from infra.files.segment import segments
from infra.session_format import FOLDS, UNFOLDED

NO_FRAME = -1
"""Number in place of a frame's where the fleet alone was looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldTurn:
    """One turn of the fold."""

    t_us: int
    """Unix µs that was folded for: when the frame was taken, by the clock of that moment."""
    records: int
    """Number of the first telemetry record that had not been taken in yet."""
    record_us: int
    """Stamp of the one before it, 0 before any: shows whether the log still numbers its records alike."""
    heard_us: int
    """Unix time before which all telemetry had been taken in, µs; 0: not known."""
    frame: int = NO_FRAME
    """Frame of the video, or ``NO_FRAME``."""
    boxes: int | None = None
    """Number of boxes in the frame; None: there was none, or the detector failed."""
    size: tuple[int, int] | None = None
    """Width and height of its image, px; None: there was none."""

    @property
    def row(self) -> str:
        """A line of ``folds.csv``."""
        frame = None if self.frame == NO_FRAME else self.frame
        of_frame = (frame, self.boxes, *(self.size or (None, None)))
        cells = (self.t_us, self.records, self.record_us, self.heard_us, *of_frame)
        return ",".join("" if cell is None else str(cell) for cell in cells) + "\n"


def unfolded_row(record: int, count: int) -> str:
    """A line of ``unfolded.csv``: records that were never taken in, by the number of the first and how many."""
    return f"{record},{count}\n"


class FoldOrder:
    """All turns of a flight, in order.

    Attributes:
        turns: in order; those whose frame does not come after the one before are left out.
        skipped: rows that could not be used.
    """

    def __init__(self, turns: tuple[FoldTurn, ...], unfolded: NDArray[np.int64], skipped: int) -> None:
        self.turns, self.skipped = turns, skipped
        self._unfolded = unfolded

    @classmethod
    def read(cls, folder: Path) -> FoldOrder | None:
        """Read the tables of a session folder; None: there are none.

        Raises:
            SessionError: a file is no such table.
        """
        path, unfolded = folder / FOLDS.name, folder / UNFOLDED.name
        if not segments(path):
            return None
        table = read_table(path, FOLDS)
        turns: list[FoldTurn] = []
        last = NO_FRAME
        for t_us, records, record_us, heard_us, frame, *found in zip(
            *(table[name].tolist() for name in FOLDS.columns), strict=True
        ):
            boxes, width, height = (None if math.isnan(number) else int(number) for number in found)
            turn = FoldTurn(
                t_us=int(t_us),
                records=int(records),
                record_us=int(record_us),
                heard_us=int(heard_us),
                frame=NO_FRAME if math.isnan(frame) else int(frame),
                boxes=boxes,
                size=(width, height) if width and height else None,
            )
            if turn.frame == NO_FRAME or (turn.frame > last and turn.size):
                last = max(turn.frame, last)
                turns.append(turn)
        spans = np.empty((0, 2), dtype=np.int64)
        lost = 0
        if segments(unfolded):
            spare = read_table(unfolded, UNFOLDED)
            spans = np.stack([spare[name].astype(np.int64) for name in UNFOLDED.columns], axis=1)
            lost = spare.skipped
        return cls(tuple(turns), spans, table.skipped + len(table) - len(turns) + lost)

    def __len__(self) -> int:
        return len(self.turns)

    @property
    def sizes(self) -> set[tuple[int, int]]:
        """Width and height of all images, px."""
        return {turn.size for turn in self.turns if turn.size}

    def placed(self, stamped_us: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
        """(n,) how many records of a log come before each turn, and of how many turns the numbers are another log's.

        A log that lost records, on a failing disk, numbers them differently from the flight: then their times decide.
        """
        records = np.array([turn.records for turn in self.turns], dtype=np.int64)
        record_us = np.array([turn.record_us for turn in self.turns], dtype=np.int64)
        inside = (records > 0) & (records <= len(stamped_us))
        agree = records == 0
        agree[inside] = stamped_us[records[inside] - 1] == record_us[inside]
        so_far_us = np.maximum.accumulate(stamped_us) if len(stamped_us) else stamped_us
        by_time = np.searchsorted(so_far_us, record_us, side="right")
        return np.where(agree, records, by_time), int(np.count_nonzero(~agree))

    def taken_in(self, count: int) -> NDArray[np.bool_]:
        """(count,) which records of a log the flight took in."""
        taken = np.ones(count, dtype=np.bool_)
        for first, number in self._unfolded.tolist():
            taken[max(first, 0) : max(first + number, 0)] = False
        return taken
