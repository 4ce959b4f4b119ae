"""The map in cells: UAV, footprint, reported positions with error circles, boxes without a name. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.report.label_grid import Grid
from gcs.report.labels import Label, Labelling, Place, place_labels
from gcs.report.vehicle_names import shown_names
from gcs.snapshot import Snapshot, Standing, VehicleRow
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.cell_labels import draw_leaders, measure_cells, shows_in_cells, write_labels
from gcs.tui.draw.format import plain
from gcs.tui.draw.ground_view import MapView, scale_bar
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, INK, LINE, PANEL, Colour, pack, standing_colour

__all__ = ["BOX_MARK", "STANDING_MARKS", "UAV_MARK", "chart_cells", "map_labels"]

STANDING_MARKS: Final[Mapping[Standing, str]] = MappingProxyType(
    {
        "confirmed": "●",
        "tentative": "◐",
        "coasting": "◌",
        "unidentified": "○",
        "out of view": "□",
        "no position": "×",
        "no new frame": "◎",
    }
)
"""One for each, so that a standing is told without its colour."""
UAV_MARK: Final = "◆"
BOX_MARK: Final = "?"
NOSE_DOTS: Final = 7.0
"""Length of the line that shows a heading; the first two or three dots are under the mark."""
UAV_NOSE_DOTS: Final = 11.0


def chart_cells(snapshot: Snapshot, selected: int, view: MapView, labelling: Labelling | None = None) -> CellGrid:
    """Draw the ground as the view shows it, and below it a row with north and scale; what is selected is inverted.

    Args:
        snapshot: What is drawn.
        selected: System id, 0 none.
        view: Which ground, and how many cells.
        labelling: Of ``map_labels`` for the same; worked out unless given.

    Returns:
        One row more than the view has.
    """
    cells = CellGrid(view.columns, view.rows + 1, pack(PANEL))
    dots = BrailleCanvas(view.columns, view.rows + 1)
    rows = _placed_rows(snapshot, selected)
    marks = _marks(snapshot, rows, view)
    labelling = labelling or map_labels(snapshot, selected, view)
    if snapshot.footprint_enu is not None:
        dots.polygon(view.dots(snapshot.footprint_enu), pack(LINE), every=2.0)
    for row in rows:
        dots.circle(_dot(view, row.p_enu), row.std_m / view.metres_per_dot, pack(LINE))
    _residuals(dots, snapshot, rows, view)
    for row in rows:
        _nose(dots, _dot(view, row.p_enu), row.heading, NOSE_DOTS, standing_colour(row.standing))
    _nose(dots, _dot(view, snapshot.uav_enu), snapshot.uav_heading, UAV_NOSE_DOTS, ACCENT)
    colours = {mark.system_id: mark.colour for mark in marks if mark.system_id}
    draw_leaders(dots, labelling, lambda place: pack(colours.get(place.key, INK)))
    dots.bits[view.rows :] = 0
    cells.dots(dots)
    for mark in reversed(marks):
        picked = bool(selected) and mark.system_id == selected
        cells.text(mark.x, mark.y, mark.glyph, pack(BRIGHT if picked else mark.colour))

    def look_of(place: Place) -> tuple[int, int | None]:
        colour = colours.get(place.key, INK)
        picked = bool(selected) and place.key == selected
        return (pack(PANEL), pack(colour)) if picked else (pack(colour), None)

    write_labels(cells, labelling, look_of)
    bar, _ = scale_bar(view.metres_per_dot, view.columns // 3)
    cells.text(1, view.rows, f"N↑  {bar}"[: view.columns - 1], pack(FAINT))
    return cells


def map_labels(snapshot: Snapshot, selected: int, view: MapView, former: Labelling | None = None) -> Labelling:
    """Where ``chart_cells`` writes names; ``former`` is of the frame before, so that labels stay where they are."""
    rows = _placed_rows(snapshot, selected)
    state = {row.system_id: "" if row.position_state == "ok" else f" {plain(row.position_state)}" for row in rows}
    names = shown_names(snapshot, shows_in_cells)
    labels, others = [], []
    for mark in _marks(snapshot, rows, view):
        anchor = (mark.x, mark.y, 1, 1)
        if not mark.system_id:
            others.append(anchor)
            continue
        shown, word = names[mark.system_id], state.get(mark.system_id, "")
        texts = tuple(dict.fromkeys((shown.name + word, shown.short + word)))
        stressed = bool(selected) and mark.system_id == selected
        labels.append(
            Label(
                key=mark.system_id,
                anchor=anchor,
                texts=texts,
                legend=shown.legend,
                short=len(texts) - 1,
                stressed=stressed,
            )
        )
    grid = Grid(columns=view.columns, rows=view.rows, measure=measure_cells)
    return place_labels(labels, grid, former, others)


def _placed_rows(snapshot: Snapshot, selected: int) -> list[VehicleRow]:
    """Ground vehicles with a place, those first whose label is most wanted."""
    rows = [row for row in snapshot.vehicles if row.role == "ugv" and np.isfinite(row.p_enu[:2]).all()]
    return sorted(rows, key=lambda row: (row.system_id != selected, row.standing != "confirmed"))


class _Mark(NamedTuple):
    x: int
    y: int
    glyph: str
    colour: Colour
    system_id: int = 0


def _marks(snapshot: Snapshot, rows: Sequence[VehicleRow], view: MapView) -> list[_Mark]:
    """What is in view: the UAV, ground vehicles, boxes without a name; earlier ones are drawn over later ones."""
    marks = []
    uav = next((row.system_id for row in snapshot.vehicles if row.role == "uav"), 0)
    if (cell := _cell(view, snapshot.uav_enu)) is not None:
        marks.append(_Mark(*cell, UAV_MARK, ACCENT, uav))
    for row in rows:
        if (cell := _cell(view, row.p_enu)) is not None:
            glyph = STANDING_MARKS.get(row.standing, BOX_MARK)
            marks.append(_Mark(*cell, glyph, standing_colour(row.standing), row.system_id))
    nameless = (_cell(view, box.p_enu) for box in snapshot.boxes if not box.system_id)
    unknown = standing_colour("unidentified")
    return [*marks, *(_Mark(*cell, BOX_MARK, unknown) for cell in nameless if cell is not None)]


def _dot(view: MapView, p_enu: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(view.dots(p_enu[None])[0], dtype=np.float64)


def _cell(view: MapView, p_enu: NDArray[np.float64]) -> tuple[int, int] | None:
    x, y = _dot(view, p_enu)
    # NaN is in no cell
    if not (0 <= x < 2 * view.columns and 0 <= y < 4 * view.rows):
        return None
    return int(x // 2), int(y // 4)


def _residuals(dots: BrailleCanvas, snapshot: Snapshot, rows: Sequence[VehicleRow], view: MapView) -> None:
    """A line from where a vehicle reports to be to where its box is."""
    box_enu = {box.system_id: box.p_enu for box in snapshot.boxes if box.system_id}
    for row in rows:
        if row.system_id in box_enu:
            start, end = _dot(view, row.p_enu), _dot(view, box_enu[row.system_id])
            dots.line(start, end, pack(standing_colour(row.standing)))


def _nose(dots: BrailleCanvas, start: NDArray[np.float64], heading: float, length: float, colour: Colour) -> None:
    """A line ahead; nothing where place or heading is unknown."""
    if math.isfinite(heading):
        # clockwise from north, y down
        ahead = np.array([math.sin(heading), -math.cos(heading)])
        dots.line(start, start + length * ahead, pack(colour))
