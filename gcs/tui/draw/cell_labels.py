"""Labels in a grid of cells: how wide texts are, which can be shown, and how they are written. Pure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rich.cells import cell_len

from gcs.report.labels import Labelling, Place, leader_of
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid


def measure_cells(text: str) -> tuple[int, int]:
    """Width and height."""
    return len(text), 1


def shows_in_cells(text: str) -> bool:
    """Tell whether every letter takes just one cell."""
    return text.isascii() or all(cell_len(letter) == 1 for letter in text)


def draw_leaders(dots: BrailleCanvas, labelling: Labelling, ink_of: Callable[[Place], int]) -> None:
    """A line from each label that is away from its mark."""
    for place in (*labelling.places, *labelling.counts):
        if place.leader:
            x, y, end_x, end_y = leader_of(place)
            # 2 × 4 dots a cell
            dots.line(np.array([2 * x, 4 * y]), np.array([2 * end_x, 4 * end_y]), ink_of(place))


def write_labels(cells: CellGrid, labelling: Labelling, look_of: Callable[[Place], tuple[int, int | None]]) -> None:
    """Every text in its place, in the ink and on the paper that it is to have."""
    for place in labelling.texts:
        left, top, *_ = place.rect
        cells.text(left, top, place.text, *look_of(place))
