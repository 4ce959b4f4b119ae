"""The video pane in cells: the image as half blocks, braille outlines of the boxes, names as text. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.report.overlay import (
    box_bounds,
    box_corners,
    drawable,
    front_mark,
    is_picked,
    label_of,
    place_labels,
    standing_of,
)
from gcs.snapshot import Box, Snapshot
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.format import plain
from gcs.tui.draw.halfblock import fit, shrink
from gcs.tui.palette import BRIGHT, FAINT, PANEL, pack, standing_colour
from gcs.tui.themes import DARK

__all__ = ["box_at", "video_cells"]

SMALLEST_DOTS = 5.0
"""A box is drawn at least this long, else it is a speck on a small screen."""

_packed = partial(pack, theme=DARK)
"""Whatever the theme, the picture has the colours of the exported video: light ones on dark labels."""


def video_cells(snapshot: Snapshot, selected: int, columns: int, rows: int, track: int = 0) -> CellGrid:
    """Draw one snapshot in a field of cells.

    Args:
        snapshot: Image and boxes; without an image the boxes are on a dark field.
        selected: System id whose label is inverted, 0 none.
        columns: Cells, above 0.
        rows: Cells, above 0.
        track: Track id of a box without a name whose label is inverted, 0 none.
    """
    cells = CellGrid(columns, rows, _packed(PANEL))
    if snapshot.width <= 0 or snapshot.height <= 0:
        cells.text(max(0, columns // 2 - 4), rows // 2, "no video", _packed(FAINT))
        return cells
    left, top, used_columns, used_rows = fit(snapshot.width, snapshot.height, columns, rows)
    if snapshot.image is not None:
        cells.image(shrink(snapshot.image, used_columns, used_rows), left, top)
    else:
        cells.text(left + max(0, used_columns // 2 - 4), top + used_rows // 2, "no video", _packed(FAINT))
    boxes = sorted(
        filter(drawable, snapshot.boxes),
        key=lambda box: (not is_picked(box, selected, track), box.system_id == 0, -box.cy),
    )
    _outlines(cells, snapshot, boxes, (left, top), used_columns / snapshot.width)
    _labels(cells, snapshot, boxes, (selected, track), (left, top, used_columns, used_rows))
    return cells


def box_at(snapshot: Snapshot, x: int, y: int, columns: int, rows: int, reach: float = 4.0) -> Box | None:
    """The box nearest to a cell of the field, None when none is within ``reach`` cells."""
    if snapshot.width <= 0 or snapshot.height <= 0:
        return None
    left, top, used_columns, _ = fit(snapshot.width, snapshot.height, columns, rows)
    scale = used_columns / snapshot.width
    near: list[tuple[float, Box]] = []
    for box in filter(drawable, snapshot.boxes):
        away = math.hypot(left + box.cx * scale - x - 0.5, 2 * (top + box.cy * scale / 2 - y - 0.5))
        near.append((away - box.w * scale / 2, box))
    distance, found = min(near, key=lambda pair: pair[0], default=(math.inf, None))
    return found if distance <= reach else None


def _outlines(
    cells: CellGrid, snapshot: Snapshot, boxes: Sequence[Box], corner: tuple[int, int], columns_per_px: float
) -> None:
    dots = BrailleCanvas(cells.columns, cells.rows)
    origin = np.array([2.0 * corner[0], 4.0 * corner[1]])
    scale = 2 * columns_per_px
    for box in reversed(boxes):
        ink = _packed(standing_colour(standing_of(snapshot, box)))
        grow = max(1.0, SMALLEST_DOTS / max(scale * max(box.w, box.h), 1e-6))
        middle = np.array([box.cx, box.cy])
        every = 2.0 if box.coasting or snapshot.held_s else 1.0
        dots.polygon(_grown(box_corners(box), middle, grow) * scale + origin, ink, every)
        tick = _grown(front_mark(box, reach=0.6), middle, grow) * scale + origin
        dots.line(tick[0], tick[1], ink)
    cells.dots(dots)


def _grown(points: NDArray[np.float64], middle: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    return np.asarray(middle + (points - middle) * factor, dtype=np.float64)


def _labels(
    cells: CellGrid, snapshot: Snapshot, boxes: Sequence[Box], pick: tuple[int, int], field: tuple[int, int, int, int]
) -> None:
    left, top, columns, rows = field
    across, down = columns / snapshot.width, rows / snapshot.height
    texts = [plain(label_of(snapshot, box)) for box in boxes]
    anchors = []
    for box in boxes:
        x, y, w, h = box_bounds(box)
        first, last = math.floor(left + x * across), math.ceil(left + (x + w) * across)
        upper, lower = math.floor(top + y * down), math.ceil(top + (y + h) * down)
        anchors.append((float(first), float(upper), float(last - first), float(lower - upper)))
    bounds = (float(left), float(top), float(columns), float(rows))
    places = place_labels(anchors, [(float(len(text)), 1.0) for text in texts], bounds)
    for box, text, place in reversed(list(zip(boxes, texts, places, strict=True))):
        colour = standing_colour(standing_of(snapshot, box))
        stressed = is_picked(box, *pick)
        ink, paper = (PANEL, colour) if stressed else (colour, PANEL)
        if box.system_id and not stressed and not box.coasting:
            ink = BRIGHT if standing_of(snapshot, box) == "confirmed" else colour
        if snapshot.held_s and not stressed:
            ink = FAINT
        cells.text(round(place[0]), round(place[1]), text, _packed(ink), _packed(paper))
