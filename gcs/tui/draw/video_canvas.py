"""The video pane in cells: the image as half blocks, braille outlines of the boxes, names as text. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.report.box_shapes import box_bounds, box_corners, drawable, front_mark
from gcs.report.inset import Inset, crop, inset_for, moved_boxes, title_of
from gcs.report.label_grid import Cells, Grid
from gcs.report.labels import Labelling, Place, place_labels
from gcs.report.overlay import (
    box_keys,
    box_labels,
    boxes_in_order,
    inset_label,
    is_picked,
    standing_of,
)
from gcs.snapshot import Box, Snapshot
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.cell_labels import draw_leaders, measure_cells, shows_in_cells, write_labels
from gcs.tui.draw.format import plain
from gcs.tui.draw.mosaic import HALF_BLOCKS, PictureMode, fit, mosaic_of
from gcs.tui.palette import BRIGHT, FAINT, HEAD, INK, PANEL, pack, standing_colour
from gcs.tui.themes import DARK

__all__ = ["box_at", "video_cells", "video_inset", "video_labels"]

NO_VIDEO = "no video"

SMALLEST_DOTS = 5.0
"""A box is drawn at least this long, else it is a speck on a small screen."""

LEAST_FIELD = (24, 8)
"""Columns and rows of a field that has room for an inset."""

_packed = partial(pack, theme=DARK)
"""Whatever the theme, the picture has the colours of the exported video: light ones on dark labels."""


def video_cells(
    snapshot: Snapshot,
    selected: int,
    columns: int,
    rows: int,
    track: int = 0,
    labelling: Labelling | None = None,
    mode: PictureMode = HALF_BLOCKS,
    inset: Inset | None = None,
) -> CellGrid:
    """Draw one snapshot in a field of cells.

    Args:
        snapshot: Image and boxes; without an image the boxes are on a dark field.
        selected: System id whose label is inverted, 0 none.
        columns: Cells, above 0.
        rows: Cells, above 0.
        track: Track id of a box without a name whose label is inverted, 0 none.
        labelling: Of ``video_labels`` for the same; worked out unless given.
        mode: What the terminal can show.
        inset: Of ``video_inset``, None for none.
    """
    cells = CellGrid(columns, rows, _packed(PANEL), depth=mode.depth)
    if snapshot.width > 0 and snapshot.height > 0:
        left, top, used_columns, used_rows = fit(snapshot.width, snapshot.height, columns, rows)
        if snapshot.image is not None:
            cells.picture(mosaic_of(snapshot.image, used_columns, used_rows, mode), left, top)
        boxes = boxes_in_order(snapshot, selected, track)
        labelling = labelling or video_labels(snapshot, selected, columns, rows, track, inset=inset)
        _outlines(cells, snapshot, boxes, (left, top), used_columns / snapshot.width, labelling)
        if inset is not None:
            _enlarge(cells, snapshot, boxes, selected, inset, mode)
        _write(cells, snapshot, boxes, (selected, track), labelling)
    for x, y, width, _ in _notice(snapshot, columns, rows):
        cells.text(x, y, NO_VIDEO[:width], _packed(FAINT))
    return cells


def video_inset(
    snapshot: Snapshot, selected: int, columns: int, rows: int, track: int = 0, former: Inset | None = None
) -> Inset | None:
    """Where ``video_cells`` shows the picked vehicle enlarged, None where that is not known or there is no room."""
    if snapshot.width <= 0 or snapshot.height <= 0 or columns < LEAST_FIELD[0] or rows < LEAST_FIELD[1]:
        return None
    boxes = boxes_in_order(snapshot, selected, track)
    marks = list(zip(boxes, _anchors(snapshot, boxes, columns, rows), strict=True))
    picked = next((box for box in boxes if is_picked(box, selected, track)), None)
    return inset_for(snapshot, selected, (0, 0, columns, rows), marks, picked, tall=2.0, former=former)


def video_labels(
    snapshot: Snapshot,
    selected: int,
    columns: int,
    rows: int,
    track: int = 0,
    former: Labelling | None = None,
    inset: Inset | None = None,
) -> Labelling:
    """Where ``video_cells`` writes; ``former`` is that of the frame before, so that labels stay where they are."""
    if snapshot.width <= 0 or snapshot.height <= 0:
        return Labelling()
    boxes = boxes_in_order(snapshot, selected, track)
    blocked = (*_notice(snapshot, columns, rows), *([inset.rect] if inset else []))
    grid = Grid(columns=columns, rows=rows, measure=measure_cells, blocked=blocked, covered=True)
    anchors = _anchors(snapshot, boxes, columns, rows)
    return place_labels(box_labels(snapshot, boxes, anchors, shows_in_cells, (selected, track)), grid, former)


def _anchors(snapshot: Snapshot, boxes: Sequence[Box], columns: int, rows: int) -> list[Cells]:
    """Cells of each box in the field."""
    left, top, used_columns, used_rows = fit(snapshot.width, snapshot.height, columns, rows)
    across, down = used_columns / snapshot.width, used_rows / snapshot.height
    anchors = []
    for box in boxes:
        x, y, w, h = box_bounds(box)
        first, last = math.floor(left + x * across), math.ceil(left + (x + w) * across)
        upper, lower = math.floor(top + y * down), math.ceil(top + (y + h) * down)
        anchors.append((first, upper, last - first, lower - upper))
    return anchors


def _notice(snapshot: Snapshot, columns: int, rows: int) -> tuple[Cells, ...]:
    """Where it is written that there is no video."""
    if snapshot.image is not None and snapshot.width > 0 and snapshot.height > 0:
        return ()
    width = min(len(NO_VIDEO), columns)
    return (((columns - width) // 2, rows // 2, width, 1),)


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
    cells: CellGrid,
    snapshot: Snapshot,
    boxes: Sequence[Box],
    corner: tuple[int, int],
    columns_per_px: float,
    labelling: Labelling,
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
    colours = [_packed(standing_colour(standing_of(snapshot, box))) for box in boxes]
    inks = dict(zip(box_keys(boxes), colours, strict=True))
    draw_leaders(dots, labelling, lambda place: inks.get(place.key, _packed(INK)))
    cells.dots(dots)


def _enlarge(
    cells: CellGrid, snapshot: Snapshot, boxes: Sequence[Box], selected: int, inset: Inset, mode: PictureMode
) -> None:
    """The picked vehicle in the inset's cells, below a row that names it."""
    x, y, width, height = inset.rect
    window = CellGrid(width, height, _packed(PANEL), depth=mode.depth)
    part = crop(snapshot, inset)
    if part is not None:
        window.picture(mosaic_of(part, width, height, mode), 0, 0)
    columns_per_px = width / inset.part[2]
    _outlines(window, snapshot, moved_boxes(boxes, inset), (0, 0), columns_per_px, Labelling())
    whole = fit(snapshot.width, snapshot.height, cells.columns, cells.rows)[2] / snapshot.width
    title = title_of(
        plain(inset_label(snapshot, boxes, inset, selected)),
        columns_per_px / whole,
        seen=inset.seen,
        shows=lambda text: shows_in_cells(text) and measure_cells(text)[0] <= width,
    )
    window.text(0, 0, " " * width, _packed(INK), _packed(HEAD))
    window.text(0, 0, title, _packed(BRIGHT), _packed(HEAD))
    cells.place(window, x, y)


def _grown(points: NDArray[np.float64], middle: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    return np.asarray(middle + (points - middle) * factor, dtype=np.float64)


def _write(
    cells: CellGrid, snapshot: Snapshot, boxes: Sequence[Box], pick: tuple[int, int], labelling: Labelling
) -> None:
    owners = dict(zip(box_keys(boxes), boxes, strict=True))

    def look_of(place: Place) -> tuple[int, int]:
        box = owners.get(place.key)
        if box is None:
            return _packed(INK), _packed(PANEL)
        standing = standing_of(snapshot, box)
        colour = standing_colour(standing)
        if is_picked(box, *pick):
            return _packed(PANEL), _packed(colour)
        if snapshot.held_s:
            return _packed(FAINT), _packed(PANEL)
        return _packed(BRIGHT if standing == "confirmed" else colour), _packed(PANEL)

    write_labels(cells, labelling, look_of)
