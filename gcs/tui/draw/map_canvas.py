"""The map in cells: UAV, footprint, reported positions with error circles, boxes without a name. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.report.overlay import place_labels
from gcs.snapshot import Snapshot, VehicleRow
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.format import plain
from gcs.tui.draw.ground_view import MapView, scale_bar
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, LINE, PANEL, Colour, pack, standing_colour

__all__ = ["chart_cells"]

ARROWS = "↑↗→↘↓↙←↖"
UNKNOWN = standing_colour("unidentified")


def chart_cells(snapshot: Snapshot, selected: int, view: MapView) -> CellGrid:
    """Draw the ground as the view shows it; what is selected is inverted."""
    cells = CellGrid(view.columns, view.rows, pack(PANEL))
    dots = BrailleCanvas(view.columns, view.rows)
    rows = [row for row in snapshot.vehicles if row.role == "ugv" and np.isfinite(row.p_enu[:2]).all()]
    rows.sort(key=lambda row: (row.system_id != selected, row.standing != "confirmed"))
    if snapshot.footprint_enu is not None:
        dots.polygon(view.dots(snapshot.footprint_enu), pack(LINE), every=2.0)
    for row in rows:
        dots.circle(_dot(view, row.p_enu), row.std_m / view.metres_per_dot, pack(LINE))
    _residuals(dots, snapshot, rows, view)
    _uav_nose(dots, snapshot, view)
    cells.dots(dots)
    _legend(cells, view)
    _marks(cells, snapshot, rows, selected, view)
    return cells


def _dot(view: MapView, p_enu: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(view.dots(p_enu[None])[0], dtype=np.float64)


def _cell(view: MapView, p_enu: NDArray[np.float64]) -> tuple[int, int] | None:
    x, y = _dot(view, p_enu)
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


def _uav_nose(dots: BrailleCanvas, snapshot: Snapshot, view: MapView) -> None:
    if math.isfinite(snapshot.uav_heading):
        start = _dot(view, snapshot.uav_enu)
        # clockwise from north, y down
        nose = np.array([math.sin(snapshot.uav_heading), -math.cos(snapshot.uav_heading)])
        dots.line(start, start + 11 * nose, pack(ACCENT))


def _legend(cells: CellGrid, view: MapView) -> None:
    text, _ = scale_bar(view.metres_per_dot, view.columns // 3)
    cells.text(1, view.rows - 1, text, pack(FAINT))
    cells.text(view.columns - 3, 0, "N↑", pack(FAINT))


def _marks(cells: CellGrid, snapshot: Snapshot, rows: Sequence[VehicleRow], selected: int, view: MapView) -> None:
    marks: list[tuple[int, int, str, str, Colour, bool]] = []
    for row in rows:
        spot = _cell(view, row.p_enu)
        if spot is not None:
            picked = bool(selected) and row.system_id == selected
            marks.append((*spot, _arrow(row.heading), _name(row), standing_colour(row.standing), picked))
    uav = _cell(view, snapshot.uav_enu)
    if uav is not None:
        marks.insert(
            0,
            (
                *uav,
                "◆",
                "UAV",
                ACCENT,
                bool(selected) and any(row.system_id == selected and row.role == "uav" for row in snapshot.vehicles),
            ),
        )
    for box in snapshot.boxes:
        spot = None if box.system_id else _cell(view, box.p_enu)
        if spot is not None:
            marks.append((*spot, "?", "", UNKNOWN, False))
    places = place_labels(
        [(float(x), float(y), 1.0, 1.0) for x, y, *_ in marks],
        [(float(len(name)), 1.0 if name else 0.0) for *_, name, _, _ in marks],
        (0.0, 0.0, float(view.columns), float(view.rows)),
    )
    for (_, _, _, name, colour, picked), place in reversed(list(zip(marks, places, strict=True))):
        ink, paper = (PANEL, colour) if picked else (colour, None)
        cells.text(round(place[0]), round(place[1]), name, pack(ink), None if paper is None else pack(paper))
    for x, y, mark, _, colour, picked in reversed(marks):
        cells.text(x, y, mark, pack(BRIGHT if picked else colour))


def _name(row: VehicleRow) -> str:
    name = plain(row.name)
    return name if row.position_state == "ok" else f"{name} {plain(row.position_state)}"


def _arrow(heading: float) -> str:
    return ARROWS[round(heading / (math.pi / 4)) % 8] if math.isfinite(heading) else "•"
