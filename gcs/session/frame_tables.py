"""The tables about frames: when each was taken, what was found in it, how the camera moved, and what was truly there.

Units and frames: Unix µs by frame index; boxes in pixels, x right and y down, angles clockwise on screen in radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from gcs.session.tables import Table, read_table
from infra.files.segment import segments
from infra.session_format import DETECTIONS, FRAMES, LOOKS, MOTION, TRUTH
from mavlink.tlog.timestamps import times_ok
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion

MAX_MISSING, ROOMY = 100_000, 64
"""Frames that may lack their row, at once and for each row that there is: bounds the memory of a frame index."""
NOWHERE = [-1.0, -1.0, -1.0, -1.0]
"""Part of a frame in which nothing was looked at: one without a row was looked at as a whole."""


def frame_row(index: int, t_us: int) -> str:
    """A line of ``frames.csv``."""
    return f"{index},{t_us}\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTimes:
    """The content of ``frames.csv``."""

    times_us: NDArray[np.int64]
    """(n,) Unix µs by frame index."""
    skipped: int
    """Rows that could not be used."""
    unordered: int
    """Rows whose frame is earlier than that of the row before."""


def read_times(path: Path) -> FrameTimes:
    """Read ``frames.csv``.

    A frame whose row is damaged gets the time between its neighbours, so that later frames keep their places. So does
    one whose time is not between theirs or far from all others: else all telemetry until then would come before it.

    Raises:
        SessionError: no table, or no row in it that can be used.
    """
    table = read_table(path, FRAMES)
    if not len(table):
        raise SessionError(f"{path}: no frame in it; delete the file if the video has its own time stamps")
    unordered = int(np.count_nonzero(np.diff(table["frame"]) < 0))
    frame, first = np.unique(table["frame"].astype(np.int64), return_index=True)
    time_us = table["time_us"][first].astype(np.int64)
    keep = frame < ROOMY * len(frame) + MAX_MISSING
    frame, time_us = frame[keep], time_us[keep]
    if not len(frame):
        raise SessionError(
            f"{path}: no frame in it that could be; delete the file if the video has its own time stamps"
        )
    good = _times_between(time_us) & times_ok(time_us, np.ones(len(time_us), dtype=np.bool_))
    if good.any():
        frame, time_us = frame[good], time_us[good]
    # relative to the first: a Unix time in µs and a fraction are more than a float holds
    dense = np.interp(np.arange(frame[-1] + 1), frame, time_us - time_us[0])
    return FrameTimes(
        times_us=np.round(dense).astype(np.int64) + time_us[0],
        skipped=table.skipped + len(table) - len(frame),
        unordered=unordered,
    )


def detection_rows(frame: int, detections: Detections) -> str:
    """Lines of ``detections.csv``, to the last digit: a replay folds the very same numbers."""
    cells = [["" if math.isnan(value) else repr(value) for value in box] for box in detections.table.T.tolist()]
    return "".join(f"{frame},{','.join(box)}\n" for box in cells)


def look_rows(frame: int, detections: Detections) -> str:
    """Lines of ``looks.csv``, to the last digit: the parts of a frame that were looked at; none where all of it was."""
    parts = () if detections.looked is None else detections.looked.tolist() or [NOWHERE]
    return "".join(f"{frame},{','.join(map(repr, part))}\n" for part in parts)


class FrameDetections:
    """The rows of ``detections.csv`` by frame, in the order of the file.

    Args:
        looks: the rows of ``looks.csv``; None: all frames were looked at as a whole.
    """

    def __init__(self, table: Table, looks: Table | None = None) -> None:
        order = np.argsort(table["frame"], kind="stable")
        self._frame = table["frame"][order].astype(np.int64)
        self._columns = {k: v[order] for k, v in table.columns.items() if k != "frame"}
        self.skipped, self.looks_skipped = table.skipped, looks.skipped if looks else 0
        rows = np.array([looks[name] for name in LOOKS.columns]) if looks else np.zeros((len(LOOKS.columns), 0))
        rows = rows[:, np.argsort(rows[0], kind="stable")]
        self._looked_frame, self._looked = rows[0].astype(np.int64), rows[1:].T

    def at(self, frame: int) -> Detections:
        """Boxes seen in a frame, perhaps nothing."""
        start, stop = np.searchsorted(self._frame, (frame, frame + 1))
        first, end = np.searchsorted(self._looked_frame, (frame, frame + 1))
        looked = self._looked[first:end].copy() if first < end else None
        return Detections(**{name: column[start:stop] for name, column in self._columns.items()}, looked=looked)

    @property
    def extent(self) -> tuple[float, float]:
        """Largest coordinates of the centres of boxes, px; 0 without any."""
        columns = self._columns
        return float(columns["cx"].max(initial=0.0)), float(columns["cy"].max(initial=0.0))


def read_detections(path: Path) -> FrameDetections:
    """Read ``detections.csv``: oriented boxes in pixels and radians, heading empty where the front is unknown.

    ``looks.csv`` beside it, where there is one, has which parts of frames were looked at.
    """
    looks = path.with_name(LOOKS.name)
    return FrameDetections(read_table(path, DETECTIONS), read_table(looks, LOOKS) if segments(looks) else None)


def motion_row(frame: int, motion: ImageMotion) -> str:
    """A line of ``motion.csv``, to the last digit; the homography's last entry is 1."""
    numbers = [*motion.H.ravel().tolist()[:8], motion.std_px, motion.inliers, motion.share]
    return f"{frame},{','.join(map(repr, numbers))}\n"


class FrameMotions:
    """The rows of ``motion.csv`` by frame."""

    def __init__(self, table: Table) -> None:
        self._rows = {
            int(row[0]): row[1:] for row in zip(*(table[name].tolist() for name in MOTION.columns), strict=True)
        }
        self.skipped = table.skipped

    def at(self, frame: int) -> ImageMotion | None:
        """Motion of the camera from the last frame that was looked at to this one; None where that is not known."""
        row = self._rows.get(frame)
        if row is None:
            return None
        *entries, std_px, inliers, share = row
        H = np.array([*entries, 1.0]).reshape(3, 3)
        return ImageMotion(H=H, std_px=std_px, inliers=int(inliers), share=share)


def read_motions(path: Path) -> FrameMotions:
    """Read ``motion.csv``: homographies in pixels.

    Raises:
        SessionError: no such table.
    """
    return FrameMotions(read_table(path, MOTION))


def read_truth(path: Path) -> Table:
    """Read ``truth.csv``: the true boxes, with system id 0 for what is not one of ours.

    Raises:
        SessionError: no such file, or no such table.
    """
    return read_table(path, TRUTH)


def _times_between(time_us: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) which times lie between those before and after; all where those two are not in order themselves."""
    between = np.ones(len(time_us), dtype=np.bool_)
    before, here, after = time_us[:-2], time_us[1:-1], time_us[2:]
    between[1:-1] = (before > after) | ((before <= here) & (here <= after))
    return between
