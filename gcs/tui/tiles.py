"""The pictures of all cameras beside each other, each with its boxes and names, in one field of cells. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gcs.report.labels import Labelling
from gcs.station import CameraPicture
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.mosaic import HALF_BLOCKS, PictureMode, fit
from gcs.tui.draw.video_canvas import video_cells, video_labels
from gcs.tui.palette import ACCENT, FAINT, HEAD, PANEL, pack
from gcs.tui.themes import DARK
from infra.plain_text import plain

Rect = tuple[int, int, int, int]
_MIN_COLUMNS, _MIN_ROWS = 8, 3
_USUAL_SIZE = 16, 9


def tile_rects(tiles: Sequence[CameraPicture], columns: int, rows: int) -> list[Rect]:
    """Return left, top, columns and rows of each tile, a line for its name among them; as many in a row as makes them
    largest.

    Tiles for which the field is too small are left out, from the last.
    """
    best = max(range(1, len(tiles) + 1), key=lambda across: _area(tiles, columns, rows, across), default=1)
    width, height = columns // best, rows // math.ceil(len(tiles) / best) if tiles else 0
    if width < _MIN_COLUMNS or height < _MIN_ROWS:
        return [(0, 0, columns, rows)] if tiles and columns > 0 and rows > 1 else []
    return [((k % best) * width, (k // best) * height, width, height) for k in range(len(tiles))]


def _area(tiles: Sequence[CameraPicture], columns: int, rows: int, across: int) -> int:
    """Cells of the first picture with this many beside each other."""
    width, height = columns // across, rows // math.ceil(len(tiles) / across) - 1
    if width < 1 or height < 1:
        return 0
    first = next(
        (tile.snapshot for tile in tiles if tile.snapshot and tile.snapshot.width and tile.snapshot.height), None
    )
    size = (first.width, first.height) if first else _USUAL_SIZE
    return math.prod(fit(*size, width, height)[2:])


def tile_at(
    tiles: Sequence[CameraPicture], x: int, y: int, columns: int, rows: int
) -> tuple[CameraPicture, Rect] | None:
    """The tile at a cell, and where its picture is; None: none."""
    for tile, (left, top, width, height) in zip(tiles, tile_rects(tiles, columns, rows), strict=False):
        if left <= x < left + width and top < y < top + height:
            return tile, (left, top + 1, width, height - 1)
    return None


def tiled_cells(
    tiles: Sequence[CameraPicture],
    selected: int,
    columns: int,
    rows: int,
    track: int = 0,
    former: Mapping[int, Labelling] | None = None,
    mode: PictureMode = HALF_BLOCKS,
) -> tuple[CellGrid, dict[int, Labelling]]:
    """Draw the pictures in a field of cells.

    Args:
        tiles: The cameras in the mission's order.
        selected: System id whose label is inverted in all of them, 0 none.
        columns: Cells, above 0.
        rows: Cells, above 0.
        track: Track id of a box without a name in the picture on show, 0 none.
        former: Labels of the cameras before, by place in the mission, so that they stay where they are.
        mode: What the terminal can show.

    Returns:
        The cells, and the labels by place.
    """
    field, labels = CellGrid(columns, rows, pack(PANEL, theme=DARK), depth=mode.depth), dict[int, Labelling]()
    for place, (tile, rect) in enumerate(zip(tiles, tile_rects(tiles, columns, rows), strict=False)):
        left, top, width, height = rect
        ink, paper = pack(ACCENT if tile.on_show else FAINT, theme=DARK), pack(HEAD, theme=DARK)
        title = f"{'▸' if tile.on_show else ' '}{plain(tile.name)}"
        field.text(left, top, title.ljust(width)[:width], ink, paper)
        if tile.snapshot is None:
            field.text(left + 1, top + 1, "waiting for the first frame …"[: width - 1], pack(FAINT, theme=DARK))
            continue
        shown = tile.snapshot, selected, width, height - 1, track if tile.on_show else 0
        labels[place] = video_labels(*shown, (former or {}).get(place))
        field.place(video_cells(*shown, labels[place], mode), left, top + 1)
    return field, labels
