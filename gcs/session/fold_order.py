"""In which order a flight took in telemetry and pictures, so that a replay can do the same.

``folds.csv`` has a row for every turn of the fold: the picture that was looked at, or none, and how many telemetry
records had been taken in until then. ``unfolded.csv`` has the records that were never taken in: what the station itself
sent, and what it could not keep up with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.session.segmented import read_segments
from infra.files.segments import segments

__all__ = ["FOLD_COLUMNS", "NO_PICTURE", "UNFOLDED_COLUMNS", "Fold", "Folds"]

_ALWAYS, _OF_PICTURES = ("time_us", "records", "record_us", "heard_us"), ("frame", "boxes", "width", "height")
FOLD_COLUMNS = (*_ALWAYS, *_OF_PICTURES)
UNFOLDED_COLUMNS = ("record", "count")
NO_PICTURE = -1
"""In place of a frame: the fleet alone was looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """One turn of the fold."""

    t_us: int
    """Unix µs that was folded for: when the picture was taken, by the clock of that moment."""
    records: int
    """Number of the first telemetry record that had not been taken in yet."""
    record_us: int
    """Stamp of the one before it, 0 before any: tells whether the log still numbers its records alike."""
    heard_us: int
    """Whatever came before this Unix time had been taken in; 0: not known."""
    frame: int = NO_PICTURE
    """Of the video, or ``NO_PICTURE``."""
    boxes: int | None = None
    """Found in the picture; None: there was none, or the detector failed."""
    size: tuple[int, int] | None = None
    """Width and height of the picture, px; None: there was none."""

    @property
    def row(self) -> str:
        """A line of ``folds.csv``."""
        frame = None if self.frame == NO_PICTURE else self.frame
        cells = (
            self.t_us,
            self.records,
            self.record_us,
            self.heard_us,
            frame,
            self.boxes,
            *(self.size or (None, None)),
        )
        return ",".join("" if cell is None else str(cell) for cell in cells) + "\n"


class Folds:
    """All turns of a flight, in order.

    Attributes:
        turns: as they were made; those whose frame does not come after the one before are left out.
        skipped: rows that could not be used.
    """

    def __init__(self, turns: tuple[Fold, ...], unfolded: NDArray[np.int64], skipped: int) -> None:
        self.turns, self.skipped = turns, skipped
        self._unfolded = unfolded

    @classmethod
    def read(cls, folder: Path) -> Folds | None:
        """Read the tables of a session folder; None: there are none.

        Raises:
            SessionError: a file is no such table.
        """
        path, unfolded = folder / "folds.csv", folder / "unfolded.csv"
        if not segments(path):
            return None
        table = read_segments(path, _ALWAYS, _OF_PICTURES)
        turns: list[Fold] = []
        last = NO_PICTURE
        for t_us, records, record_us, heard_us, frame, *found in zip(
            *(table[name].tolist() for name in FOLD_COLUMNS), strict=True
        ):
            boxes, width, height = (None if math.isnan(number) else int(number) for number in found)
            turn = Fold(
                t_us=int(t_us),
                records=int(records),
                record_us=int(record_us),
                heard_us=int(heard_us),
                frame=NO_PICTURE if math.isnan(frame) else int(frame),
                boxes=boxes,
                size=(width, height) if width and height else None,
            )
            if turn.frame == NO_PICTURE or (turn.frame > last and turn.size):
                last = max(turn.frame, last)
                turns.append(turn)
        spans = np.empty((0, 2), dtype=np.int64)
        lost = 0
        if segments(unfolded):
            spare = read_segments(unfolded, UNFOLDED_COLUMNS)
            spans = np.stack([spare[name].astype(np.int64) for name in UNFOLDED_COLUMNS], axis=1)
            lost = spare.skipped
        return cls(tuple(turns), spans, table.skipped + len(table) - len(turns) + lost)

    def __len__(self) -> int:
        return len(self.turns)

    @property
    def sizes(self) -> set[tuple[int, int]]:
        """Width and height of all pictures, px."""
        return {turn.size for turn in self.turns if turn.size}

    def placed(self, stamped_us: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
        """(n,) how many records of a log come before each turn, and of how many turns the numbers are another log's.

        A log that lost records, on a failing disk, numbers them differently from the flight: then their times tell.

        Args:
            stamped_us: of the log's records.
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
