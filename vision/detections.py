"""Oriented boxes found in one picture, as a struct of arrays.

Pixels: x right, y down. ``angle`` turns image +x into the box's width axis, clockwise on screen. A box whose front is
known has its width along the vehicle and pointing to the front, so ``heading = angle + π/2`` (mod 2π), clockwise from
image up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.boxes import corners

__all__ = ["Detections"]

FIELDS = ("cx", "cy", "w", "h", "angle", "score", "heading")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Detections:
    """The m detections of one picture; every array is float64, of shape (m,) and read-only.

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

    def __post_init__(self) -> None:
        for name in FIELDS:
            object.__setattr__(self, name, _column(name, getattr(self, name)))
        lengths = {name: len(getattr(self, name)) for name in FIELDS}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"detections need arrays of one length, got {found}")
        for name in FIELDS[:-1]:
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"detections need finite numbers, got NaN or infinity in {name}")
        if (self.w < 0).any() or (self.h < 0).any():
            raise ValueError("detections need sides of zero or more, got a negative w or h")

    @classmethod
    def empty(cls) -> Detections:
        """No detections."""
        return cls(**dict.fromkeys(FIELDS, np.empty(0)))

    def __len__(self) -> int:
        return len(self.cx)

    def take(self, index: ArrayLike) -> Detections:
        """Those at ``index``: integers (k,), in that order, or a mask (m,) bool."""
        chosen = np.asarray(index)
        if chosen.size == 0:
            chosen = chosen.astype(np.intp)
        # rows of checked arrays need no second check, and trackers take rows all the time
        taken = object.__new__(Detections)
        for name in FIELDS:
            column = getattr(self, name)[chosen]
            column.flags.writeable = False
            object.__setattr__(taken, name, column)
        return taken

    def corners(self) -> NDArray[np.float64]:
        """Corners (m, 4, 2) px, clockwise on screen from the one that is top left at angle 0."""
        return corners(self.boxes)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centres (m, 2) px."""
        return np.array([self.cx, self.cy]).T

    @property
    def boxes(self) -> NDArray[np.float64]:
        """Rows ``cx cy w h angle``, (m, 5), the form that ``vision.boxes`` takes."""
        return np.array([self.cx, self.cy, self.w, self.h, self.angle]).T


def _column(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """A read-only float64 copy of a one-dimensional array."""
    column = np.array(values, dtype=np.float64)
    if column.ndim != 1:
        raise ValueError(f"detections need {name} of shape (m,), got {column.shape}")
    column.flags.writeable = False
    return column
