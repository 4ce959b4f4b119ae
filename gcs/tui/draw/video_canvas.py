"""The video pane in cells: the image as half blocks, braille outlines of the boxes, names as text. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.report.box_shapes import box_bounds, drawable, front_mark
from gcs.report.inset import Inset, crop, inset_for, moved_boxes, title_of
from gcs.report.label_grid import Cells, Grid
from gcs.report.labels import Labelling, Place, place_labels
from gcs.report.overlay import (
    box_keys,
    box_labels,
    boxes_in_order,
    inset_label,
    is_doubted,
    is_picked,
    standing_of,
)
from gcs.snapshot import Box, Snapshot
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.cell_labels import draw_leaders, measure_cells, shows_in_cells, write_labels
from gcs.tui.draw.mosaic import HALF_BLOCKS, PictureMode, fit, mosaic_of
from gcs.tui.palette import ALARM, BRIGHT, FAINT, HEAD, INK, PANEL, pack, standing_colour
from gcs.tui.themes import DARK, Colour
from infra.plain_text import plain

NO_VIDEO = "no video"

SMALLEST_DOTS = 3.0
"""Least size of a box, dots: smaller ones would be specks on a small screen."""
CLEAR_DOTS = 1.5
"""Gap between a box and the frame round it."""
FRONT_DOTS = 3.5
"""Length of the line ahead of its front."""
BRACKET = 0.34
"""Share of each side that a frame's corners take."""
CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
"""Corners of a box in its own sides, clockwise from its top left."""
DOTS = np.array([2, 4])
"""Across and down a cell."""

MIN_FIELD = (24, 8)
"""Columns and rows of a field that has room for an inset."""

_packed = partial(pack, theme=DARK)
"""Pack a colour of the exported video, whatever the theme: light ones on dark labels."""


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
    """Area where ``video_cells`` enlarges the picked vehicle, None where that is not known or there is no room."""
    if snapshot.width <= 0 or snapshot.height <= 0 or columns < MIN_FIELD[0] or rows < MIN_FIELD[1]:
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
    """Cells that ``video_cells`` writes; ``former`` is that of the frame before, so that labels stay where they are."""
    if snapshot.width <= 0 or snapshot.height <= 0:
        return Labelling()
    boxes = boxes_in_order(snapshot, selected, track)
    blocked = (*_notice(snapshot, columns, rows), *([inset.rect] if inset else []))
    grid = Grid(columns=columns, rows=rows, measure=measure_cells, blocked=blocked, covered=True)
    anchors = _anchors(snapshot, boxes, columns, rows)
    labels = box_labels(snapshot, boxes, anchors, shows_in_cells, (selected, track))
    return place_labels(labels, grid, former)


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
    """Cells in which it is written that there is no video."""
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
    colours = [_packed(colour_of(snapshot, box)) for box in boxes]
    if boxes:  # the most wanted on top
        origin = np.array([2.0 * corner[0], 4.0 * corner[1]])
        placed, inks = boxes[::-1], np.array(colours[::-1])
        middle, size, turn = _in_dots(placed, 2 * columns_per_px, origin)
        _frames(
            dots,
            middle,
            np.maximum(size, SMALLEST_DOTS) + 2 * CLEAR_DOTS,
            turn,
            inks,
            [box.coasting or snapshot.held_s > 0 for box in placed],
        )
        # what a box marks is not hidden by it
        dots.bits[_inner_cells(middle, size, turn, dots.bits.shape)] = 0
        _fronts(dots, placed, 2 * columns_per_px, origin, inks)
    owners = dict(zip(box_keys(boxes), colours, strict=True))
    draw_leaders(dots, labelling, lambda place: owners.get(place.key, _packed(INK)))
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


def colour_of(snapshot: Snapshot, box: Box) -> Colour:
    """The colour of a box's standing, as in the exported film; of a name on which nobody is to act an alarm's."""
    if is_doubted(snapshot, box):
        return ALARM
    return standing_colour(standing_of(snapshot, box))


def _in_dots(
    boxes: Sequence[Box], scale: float, origin: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(k, 2) middles and (k, 2) sizes of boxes, and (k, 2, 2) what turns a place in a box into one on the field."""
    of_image = np.array([(box.cx, box.cy, box.w, box.h) for box in boxes]) * scale
    angle = np.array([box.angle for box in boxes])
    c, s = np.cos(angle), np.sin(angle)
    # R(angle), transposed: for rows from the left
    turn = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
    return of_image[:, :2] + origin, of_image[:, 2:], turn


def _frames(
    dots: BrailleCanvas,
    middle: NDArray[np.float64],
    size: NDArray[np.float64],
    turn: NDArray[np.float64],
    inks: NDArray[np.int64],
    dotted: Sequence[bool],
) -> None:
    """Draw the corners of frames alone; all of the sides, in dots, of those of which nothing new is known."""
    corners = middle[:, None] + (CORNERS * size[:, None]) @ turn
    reach, every = np.where(dotted, 0.5, BRACKET)[:, None, None], np.where(dotted, 2.0, 1.0)
    # from each corner towards the one before and the one after
    ends = [corners + reach * (np.roll(corners, step, axis=1) - corners) for step in (1, -1)]
    start, end = np.concatenate([corners, corners], axis=1), np.concatenate(ends, axis=1)
    sides = start.shape[1]
    dots.lines(start.reshape(-1, 2), end.reshape(-1, 2), np.repeat(inks, sides), np.repeat(every, sides))


def _fronts(
    dots: BrailleCanvas, boxes: Sequence[Box], scale: float, origin: NDArray[np.float64], inks: NDArray[np.int64]
) -> None:
    """Draw a line ahead of each front that is known."""
    ticks = np.array([front_mark(box, reach=1.0) for box in boxes])
    way = ticks[:, 1] - ticks[:, 0]
    ahead = way / np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-6)[:, None]
    start = ticks[:, 0] * scale + origin + CLEAR_DOTS * ahead
    dots.lines(start, start + FRONT_DOTS * ahead, inks)


def _inner_cells(
    middle: NDArray[np.float64], size: NDArray[np.float64], turn: NDArray[np.float64], shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the cells whose middle is on a box, and of those that boxes' own middles are in."""
    field = np.array(shape[::-1])
    reach = np.hypot(size[:, 0], size[:, 1])[:, None] / 2
    first = np.clip(np.floor((middle - reach) / DOTS), 0, field).astype(np.int64)
    most = np.minimum(np.ceil(2 * reach.max() / DOTS) + 1, field).astype(np.int64)
    window = np.stack(np.meshgrid(*map(np.arange, most), indexing="ij"), axis=-1).reshape(1, -1, 2)
    cells = first[:, None] + window
    # back into the box: the inverse of a turn is its transpose
    away = np.abs((cells * DOTS + DOTS / 2 - middle[:, None]) @ turn.transpose(0, 2, 1))
    on = (away <= size[:, None] / 2).all(axis=2) | (cells == middle[:, None] // DOTS).all(axis=2)
    column, row = cells[on & (cells < field).all(axis=2)].T
    return row, column


def _write(
    cells: CellGrid, snapshot: Snapshot, boxes: Sequence[Box], pick: tuple[int, int], labelling: Labelling
) -> None:
    owners = dict(zip(box_keys(boxes), boxes, strict=True))

    def look_of(place: Place) -> tuple[int, int]:
        box = owners.get(place.key)
        if box is None:
            return _packed(INK), _packed(PANEL)
        look = _packed(FAINT if snapshot.held_s else colour_of(snapshot, box)), _packed(PANEL)
        return look[::-1] if is_picked(box, *pick) else look

    write_labels(cells, labelling, look_of)
