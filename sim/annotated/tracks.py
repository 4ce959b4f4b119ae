"""Labelled vehicles of a film: where each is in each frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HEIGHTS_M = {"car": 1.5, "van": 2.2, "truck": 3.2, "bus": 3.2, "vehicle": 1.5}
"""Height of an ordinary vehicle of each kind, metres; a vehicle of unknown kind is taken for a car."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AnnotatedTracks:
    """m labels, by frame."""

    layout: str
    """Name of the layout they were read as."""
    frame: IntArray
    """(m,) index of the image in the film, from 0."""
    track: IntArray
    """(m,) the vehicle's number in the file."""
    corners: FloatArray
    """(m, 4, 2) px, in order round the box."""
    kind: NDArray[np.str_]
    """(m,) one of ``HEIGHTS_M``."""
    hidden: NDArray[np.bool_]
    """(m,) more than half of the vehicle is covered by something, as far as the labels tell."""
    left_out: dict[str, int] = field(default_factory=dict)
    """Number of rows that were not used, by reason."""

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def centre(self) -> FloatArray:
        """(m, 2) px."""
        return np.asarray(self.corners.mean(axis=1))

    def boxes(self) -> FloatArray:
        """(m, 5) cx, cy, w, h, angle: w along the longer side of an oriented box, angle from image +x, clockwise."""
        first, second = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 1]
        a, b = np.hypot(*first.T), np.hypot(*second.T)
        upright = (np.abs(first[:, 1]) < 1e-9) & (np.abs(second[:, 0]) < 1e-9)
        along = np.where((upright | (a >= b))[:, None], first, second)
        swapped = ~upright & (a < b)
        angle = np.arctan2(along[:, 1], along[:, 0])
        return np.column_stack([self.centre, np.where(swapped, b, a), np.where(swapped, a, b), angle])

    def select(self, chosen: NDArray[np.bool_], reason: str) -> AnnotatedTracks:
        """Return the tracks of a mask (m,); the others count as left out for that reason."""
        dropped = int(np.count_nonzero(~chosen))
        return AnnotatedTracks(
            layout=self.layout,
            frame=self.frame[chosen],
            track=self.track[chosen],
            corners=self.corners[chosen],
            kind=self.kind[chosen],
            hidden=self.hidden[chosen],
            left_out=self.left_out | ({reason: self.left_out.get(reason, 0) + dropped} if dropped else {}),
        )


def upright_corners(left: FloatArray, top: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
    """(m, 4, 2) corners of upright boxes (m,), clockwise from the upper left."""
    right, bottom = left + width, top + height
    x = np.stack([left, right, right, left], axis=1)
    y = np.stack([top, top, bottom, bottom], axis=1)
    return np.stack([x, y], axis=2)
