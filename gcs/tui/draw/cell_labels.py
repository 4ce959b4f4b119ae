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
    away = [place for place in (*labelling.places, *labelling.counts) if place.leader]
    if away:
        # 2 × 4 dots a cell
        ends = np.array([leader_of(place) for place in away]) * (2, 4, 2, 4)
        dots.lines(ends[:, :2], ends[:, 2:], np.array([ink_of(place) for place in away]))


def write_labels(cells: CellGrid, labelling: Labelling, look_of: Callable[[Place], tuple[int, int | None]]) -> None:
    """Every text in its place, in the ink and on the paper that it is to have."""
    for place in labelling.texts:
        left, top, *_ = place.rect
        cells.text(left, top, place.text, *look_of(place))
