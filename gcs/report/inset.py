"""The picked vehicle enlarged in a corner of the picture: which part of the image, and in which corner. Pure.

A field is counted in whole units, x right, y down: cells of a terminal, or pixels. Parts of the image are in pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.report.label_grid import Cells
from gcs.snapshot import Box, Snapshot

SHARE: Final = 0.42
"""Width as a share of the field's: enough to see what it is, and the rest of the picture stays."""
SHARE_HIGH: Final = 0.55
"""Greatest height, as a share of the field's."""
SHAPE: Final = 4 / 3
"""Width over height, as far as there is room."""
AROUND: Final = 2.4
"""Lengths of the vehicle that are shown: itself and what is beside it."""
MIN_PX: Final = 32.0
"""Smallest piece of the image, px: less shows blurs only."""
UNSEEN_PX: Final = 120.0
"""Shown around where a vehicle without a box should be: its position is a few metres off."""
CALMER: Final = 1
"""Number of boxes, at least, that another corner must uncover for the inset to move there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inset:
    """An enlarged part of the image in a corner of the field."""

    rect: Cells
    """Place in the field."""
    part: tuple[float, float, float, float]
    """Part of the image that is enlarged: left, top, width, height in px; wholly inside it."""
    seen: bool
    """True if the vehicle has a box; else this is where it should be."""


def inset_for(
    snapshot: Snapshot,
    system_id: int,
    field: Cells,
    marks: Sequence[tuple[Box, Cells]],
    picked: Box | None,
    *,
    tall: float = 1.0,
    former: Inset | None = None,
) -> Inset | None:
    """Inset with the picked vehicle enlarged, None where nothing is known of its place, or it is out of the image.

    Args:
        snapshot: Boxes and where vehicles are expected.
        system_id: The picked vehicle's, 0 for a box without a name.
        field: In whose corners it may be, units.
        marks: Boxes and where they are in the field; the picked one is not covered, others if they must.
        picked: The picked vehicle's box, None without one.
        tall: Height of a unit over its width.
        former: Of the frame before: the corner stays while it is as good.
    """
    centre, around_px = _place(snapshot, system_id, picked)
    if centre is None or snapshot.width <= 0 or snapshot.height <= 0:
        return None
    width = round(SHARE * field[2])
    height = min(round(width / SHAPE / tall), round(SHARE_HIGH * field[3]))
    if width < 1 or height < 1:
        return None
    part = _part(snapshot, centre, around_px, width / (tall * height))
    hidden = [rect for box, rect in marks if box is not picked]
    own = next((rect for box, rect in marks if box is picked), None)
    rect = _corner(field, (width, height), own, hidden, former.rect if former else None)
    return Inset(rect=rect, part=part, seen=picked is not None)


def _place(snapshot: Snapshot, system_id: int, box: Box | None) -> tuple[tuple[float, float] | None, float]:
    """Centre of what is shown, px, and how much around it."""
    if box is not None:
        return (box.cx, box.cy), max(AROUND * max(box.w, box.h), MIN_PX)
    row = next((row for row in snapshot.vehicles if row.system_id == system_id and system_id), None)
    x, y = row.expected_px if row is not None and row.expected_px is not None else (math.nan, math.nan)
    inside = 0 <= x < snapshot.width and 0 <= y < snapshot.height
    return ((x, y) if inside else None), UNSEEN_PX


def _part(
    snapshot: Snapshot, centre: tuple[float, float], around_px: float, shape: float
) -> tuple[float, float, float, float]:
    """A part of the image of a shape (width over height) that has ``around_px`` on its shorter side, moved inside."""
    width, height = around_px * max(shape, 1.0), around_px * max(1.0 / shape, 1.0)
    less = min(1.0, snapshot.width / width, snapshot.height / height)
    width, height = width * less, height * less
    left = min(max(centre[0] - width / 2, 0.0), snapshot.width - width)
    top = min(max(centre[1] - height / 2, 0.0), snapshot.height - height)
    return left, top, width, height


def _corner(
    field: Cells, size: tuple[int, int], picked: Cells | None, hidden: Sequence[Cells], former: Cells | None
) -> Cells:
    """The corner that covers the fewest boxes, and the picked one least of all."""
    left, top = field[:2]
    right, bottom = left + field[2] - size[0], top + field[3] - size[1]
    corners = [(x, y, *size) for x, y in ((right, top), (left, top), (right, bottom), (left, bottom))]

    def cost(rect: Cells) -> int:
        own = 0 if picked is None else (len(hidden) + CALMER + 1) * _meet(rect, picked)
        return own + sum(_meet(rect, each) for each in hidden) - CALMER * (rect == former)

    return min(corners, key=cost)


def _meet(a: Cells, b: Cells) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def crop(snapshot: Snapshot, inset: Inset) -> NDArray[np.uint8] | None:
    """The part of the image at full resolution, None without an image; at least one pixel."""
    if snapshot.image is None:
        return None
    left, top, width, height = inset.part
    x, y = int(left), int(top)
    return snapshot.image[y : max(y + 1, round(top + height)), x : max(x + 1, round(left + width))]


def moved_boxes(boxes: Sequence[Box], inset: Inset) -> list[Box]:
    """Boxes in pixels of the inset's part of the image; those beyond it are left out."""
    left, top, width, height = inset.part
    inside = []
    for box in boxes:
        x, y, reach = box.cx - left, box.cy - top, max(box.w, box.h)
        if -reach < x < width + reach and -reach < y < height + reach:
            inside.append(replace(box, cx=x, cy=y))
    return inside


def title_of(label: str, magnification: float, *, seen: bool, shows: Callable[[str], bool]) -> str:
    """Text over an inset: as much as finds room, never a part of a name.

    Args:
        label: as beside the box; of a vehicle without one, its name.
        seen: whether there is a box; else nothing that is shown is called by that name.
        shows: whether there is room for a text, and letters.
    """
    times = f"x{magnification:.1f}"
    texts = (f"{label} {times}", label, times) if seen else (f"{label} expected", "expected")
    return next((text for text in texts if shows(text)), "")
