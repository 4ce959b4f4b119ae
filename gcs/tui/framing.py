"""The part of the picture that is shown: the fleet in it, large enough to be seen. Pure; image pixels, x right, y down.

Most of a picture from the air is ground. A part is kept as long as it will do, so that the picture stays calm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.report.box_shapes import Rect, box_bounds, drawable
from gcs.snapshot import Box, Snapshot
from gcs.tui.picking import picked_box

MIN_SHARE: Final = 0.3
"""Least share of the image's width and height that is shown: a vehicle without its surroundings is nowhere."""
AROUND: Final = 0.9
"""Lengths of the longest box that are kept free around what is to be seen; half of it once a part is chosen."""
MIN_AROUND: Final = 0.04
"""Least free space around what is to be seen, as a share of the image's width, where there are small boxes or none."""
STRANGER: Final = 0.5
"""Probability of being none of ours up to which a tracked box without a name is to be seen too."""
LOOSE: Final = 1.5
"""Factor by which a part may be wider than needed before it is given up for a closer one."""
LOOSE_US: Final = 3_000_000
"""Time for which a part must have been that wide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRegion:
    """A part of the image."""

    rect: tuple[int, int, int, int]
    """Rectangle of the region: left, top, width, height, wholly inside the image."""
    shape: float
    """Width over height of the field that it was chosen for."""
    loose_since_us: int = 0
    """Time since which a closer one would do, Unix µs, 0: it would not."""


def frame_for(
    snapshot: Snapshot, pick: tuple[int, int], shape: float, former: PictureRegion | None = None
) -> PictureRegion:
    """The part with the fleet's boxes, the picked one, and where vehicles report to be; without any of these the whole.

    Args:
        snapshot: With an image of at least one pixel.
        pick: System id and track id of what is picked, 0 none.
        shape: Width over height of the field to show it in, both in the image's measure.
        former: Of the frame before: it stays while it will do.
    """
    rects = list(_to_be_seen(snapshot, pick))
    whole = PictureRegion(rect=(0, 0, snapshot.width, snapshot.height), shape=shape)
    if not rects:
        return whole
    sides = np.array(rects)
    low, high = sides[:, :2].min(axis=0), (sides[:, :2] + sides[:, 2:]).max(axis=0)
    longest = float(np.hypot(sides[:, 2], sides[:, 3]).max())
    around = max(AROUND * longest, MIN_AROUND * snapshot.width)
    width, height = high - low + 2 * around
    width = min(max(width, height * shape, MIN_SHARE * snapshot.width), float(snapshot.width))
    height = min(max(height, width / shape), float(snapshot.height))
    if former is not None and former.shape == shape and _holds(former, low, high, around / 2, snapshot):
        if former.rect[2] < LOOSE * width:
            return replace(former, loose_since_us=0)
        since_us = former.loose_since_us or snapshot.t_us
        if 0 <= snapshot.t_us - since_us < LOOSE_US:
            return replace(former, loose_since_us=since_us)
    left, top = (low + high) / 2 - np.array([width, height]) / 2
    left = min(max(left, 0.0), snapshot.width - width)
    top = min(max(top, 0.0), snapshot.height - height)
    return replace(whole, rect=(int(left), int(top), max(1, int(width)), max(1, int(height))))


def _to_be_seen(snapshot: Snapshot, pick: tuple[int, int]) -> Iterator[Rect]:
    picked = picked_box(snapshot, *pick)
    for box in filter(drawable, snapshot.boxes):
        if (box.system_id or box is picked or _may_be_ours(box)) and _inside(snapshot, box.cx, box.cy):
            x, y, w, h = box_bounds(box)
            yield (
                max(x, 0.0),
                max(y, 0.0),
                min(x + w, snapshot.width) - max(x, 0.0),
                min(y + h, snapshot.height) - max(y, 0.0),
            )
    for row in snapshot.vehicles:
        if row.role == "ugv" and row.expected_px is not None and _inside(snapshot, *row.expected_px):
            yield *row.expected_px, 0.0, 0.0


def _may_be_ours(box: Box) -> bool:
    return not box.stated and not box.coasting and box.none_of_ours < STRANGER  # NaN is less than nothing


def _inside(snapshot: Snapshot, x: float, y: float) -> bool:
    return 0 <= x < snapshot.width and 0 <= y < snapshot.height


def _holds(
    frame: PictureRegion, low: NDArray[np.float64], high: NDArray[np.float64], around: float, snapshot: Snapshot
) -> bool:
    """Tell whether a part of this image has all of it with some ground around, as far as the image goes."""
    left, top, width, height = frame.rect
    if left + width > snapshot.width or top + height > snapshot.height:
        return False
    wanted = np.maximum(low - around, 0.0), np.minimum(high + around, (snapshot.width, snapshot.height))
    return bool((wanted[0] >= (left, top)).all() and (wanted[1] <= (left + width, top + height)).all())


def framed(snapshot: Snapshot, frame: PictureRegion) -> Snapshot:
    """The snapshot as if its image were that part: without boxes beyond it, all places counted from its corner."""
    left, top, width, height = frame.rect
    if snapshot.image is None or (width, height) == (snapshot.width, snapshot.height):
        return snapshot
    boxes = []
    for box in snapshot.boxes:
        x, y, reach = box.cx - left, box.cy - top, math.hypot(box.w, box.h) / 2
        if -reach < x < width + reach and -reach < y < height + reach:
            boxes.append(replace(box, cx=x, cy=y))
    rows = tuple(
        replace(row, expected_px=(row.expected_px[0] - left, row.expected_px[1] - top)) if row.expected_px else row
        for row in snapshot.vehicles
    )
    image = snapshot.image[top : top + height, left : left + width]
    return replace(snapshot, image=image, width=width, height=height, boxes=tuple(boxes), vehicles=rows)
