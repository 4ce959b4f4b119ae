"""Oriented boxes found in one image, as a struct of arrays.

Pixels: x right, y down. ``angle`` turns image +x into the box's width axis, clockwise on screen. A box whose front is
known has its width along the vehicle and pointing to the front, so ``heading = angle + π/2`` (mod 2π), clockwise from
image up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.detect.boxes import corners

MAX_WEAK = 60
"""Most boxes below the score that counts in one image: all are recorded, but beyond these only the best are tracked."""
FIELDS = ("cx", "cy", "w", "h", "angle", "score", "heading")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Detections:
    """The m detections of one image; every array is float64, of shape (m,) and read-only.

    Raises:
        ValueError: arrays of unequal length or not one-dimensional, or a box that is not finite.

    Example:
        >>> boxes = Detections(cx=[10.0], cy=[20.0], w=[4.0], h=[2.0], angle=[0.0], score=[0.9], heading=[np.nan])
        >>> len(boxes), boxes.centre.tolist()
        (1, [[10.0, 20.0]])
    """

    cx: NDArray[np.float64]
    """Centre, px."""
    cy: NDArray[np.float64]
    w: NDArray[np.float64]
    """Side along ``angle``, px, not negative."""
    h: NDArray[np.float64]
    """Side across, px, not negative."""
    angle: NDArray[np.float64]
    """Image +x to width axis, clockwise on screen, rad."""
    score: NDArray[np.float64]
    """Detector's confidence, 0..1."""
    heading: NDArray[np.float64]
    """Clockwise from image up, rad, NaN when the front is unknown."""
    looked: NDArray[np.float64] | None = None
    """(r, 4) left, top, right, bottom, px, of the parts of the image in which a vehicle would have been found; None: in
    all of it. Where nobody looked no box means nothing."""
    table: NDArray[np.float64] = field(init=False, repr=False)
    """Columns in one array (7, m), in this order; the arrays above are its rows."""

    def __post_init__(self) -> None:
        columns = [getattr(self, name) for name in FIELDS]
        try:
            table = np.array(columns, dtype=np.float64)
        except ValueError:
            table = np.empty(0)
        if table.ndim != 2:
            raise ValueError(_misfit(columns))
        finite = np.isfinite(table[:-1])
        if not finite.all():
            name = FIELDS[int(np.argmin(finite.all(axis=1)))]
            raise ValueError(f"detections need finite numbers, got NaN or infinity in {name}")
        if (table[2:4] < 0).any():
            raise ValueError("detections need sides of zero or more, got a negative w or h")
        self._fill(table)

    @classmethod
    def empty(cls) -> Detections:
        """No detections."""
        return cls(**dict.fromkeys(FIELDS, np.empty(0)))

    def __len__(self) -> int:
        return len(self.cx)

    def select(self, index: ArrayLike) -> Detections:
        """Return the detections at ``index``: integers (k,), in that order, or a mask (m,) bool."""
        chosen = np.asarray(index)
        if chosen.dtype == np.bool_ and chosen.all():
            return self
        if chosen.size == 0:
            chosen = chosen.astype(np.intp)
        # columns of a checked table need no second check
        taken = object.__new__(Detections)
        object.__setattr__(taken, "looked", self.looked)
        taken._fill(self.table[:, chosen])
        return taken

    def at_least(self, score: float) -> Detections:
        """Return the detections of this score and more."""
        return self.select(self.score >= score)

    def useful(self, score: float) -> Detections:
        """All of this score and more, and the best ``MAX_WEAK`` of the others."""
        weak = np.flatnonzero(self.score < score)
        if len(weak) <= MAX_WEAK:
            return self
        keep = self.score >= score
        keep[weak[np.argsort(-self.score[weak], kind="stable")[:MAX_WEAK]]] = True
        return self.select(keep)

    def looked_at(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """(k,) which of some points (k, 2), px, lie where a vehicle would have been found."""
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        if self.looked is None:
            return np.ones(len(points), dtype=bool)
        low, high = self.looked[:, :2], self.looked[:, 2:]
        inside = np.all((points[:, None] >= low) & (points[:, None] <= high), axis=2)
        return np.asarray(np.any(inside, axis=1))

    def looked_share(self, size: tuple[int, int]) -> float:
        """Return the share of an image of (width, height) px that was looked at, about; where parts overlap it is
        less."""
        if self.looked is None:
            return 1.0
        sides = self.looked[:, 2:] - self.looked[:, :2]
        return min(float(np.sum(sides[:, 0] * sides[:, 1])) / (size[0] * size[1]), 1.0)

    def corners(self) -> NDArray[np.float64]:
        """Corners (m, 4, 2) px, clockwise on screen from the one that is top left at angle 0."""
        return corners(self.boxes)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centres (m, 2) px."""
        return self.table[:2].T

    @property
    def boxes(self) -> NDArray[np.float64]:
        """Rows ``cx cy w h angle``, (m, 5), the form that ``vision.detect.boxes`` takes."""
        return self.table[:5].T

    def _fill(self, table: NDArray[np.float64]) -> None:
        """Take over a checked table (7, m)."""
        table.setflags(write=False)
        for name, row in zip(FIELDS, table, strict=True):
            object.__setattr__(self, name, row)
        object.__setattr__(self, "table", table)


def _misfit(columns: list[ArrayLike]) -> str:
    """Fault of columns that make no table."""
    arrays = [np.asarray(column, dtype=np.float64) for column in columns]
    for name, array in zip(FIELDS, arrays, strict=True):
        if array.ndim != 1:
            return f"detections need {name} of shape (m,), got {array.shape}"
    found = ", ".join(f"{name} {len(array)}" for name, array in zip(FIELDS, arrays, strict=True))
    return f"detections need arrays of one length, got {found}"
