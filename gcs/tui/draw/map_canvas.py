"""The map in cells: UAV, footprint, reported positions with error circles, boxes without a name. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.report.label_grid import Grid
from gcs.report.labels import Label, Labelling, Place, place_labels
from gcs.report.vehicle_names import shown_names
from gcs.snapshot import Snapshot, Standing, VehicleRow
from gcs.trails import Trail
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.cell_labels import draw_leaders, measure_cells, shows_in_cells, write_labels
from gcs.tui.draw.format import position_of
from gcs.tui.draw.freshness import USABLE_M, freshness
from gcs.tui.draw.ground_view import HOME_ENU, MapView, scale_bar
from gcs.tui.draw.map_lines import (
    CURSOR_MARK,
    HOME_MARK,
    PICK_MARKS,
    Ruler,
    draw_fences,
    draw_ruler,
    draw_trails,
    ruler_texts,
)
from gcs.tui.draw.mosaic import HALF
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, INK, LINE, PANEL, pack, standing_colour, vehicle_colours
from gcs.tui.themes import Colour
from infra.plain_text import plain

STANDING_MARKS: Final[Mapping[Standing, str]] = MappingProxyType(
    {
        "confirmed": "●",
        "tentative": "◐",
        "coasting": "◌",
        "unidentified": "○",
        "out of view": "□",
        "no position": "×",
        "misplaced": "≠",
        "no new frame": "◎",
    }
)
"""One for each, so that a standing is known without its colour."""
UAV_MARK: Final = "◆"
BOX_MARK: Final = "?"
NOSE_DOTS: Final = 7.0
"""Length of the line that shows a heading; the first two or three dots are under the mark."""
UAV_NOSE_DOTS: Final = 11.0
REACH: Final = 4.0
"""Distance from a mark at which a click still picks it, cells."""
LONGEST_UAV_NAME: Final = 16
GAP: Final = 2
"""Cells between texts of the last row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapExtras:
    """Extras that are on the map beside the snapshot."""

    track: int = 0
    """Track id of the picked box without a name, 0 none."""
    trails: tuple[Trail, ...] = ()
    ruler: Ruler = field(default_factory=Ruler)
    ground: NDArray[np.int64] | None = None
    """(2 · rows, columns) 0xRRGGBB under everything, None: the background."""
    credit: str = ""
    """Attribution of that picture."""


def chart_cells(
    snapshot: Snapshot,
    selected: int,
    view: MapView,
    labelling: Labelling | None = None,
    extras: MapExtras | None = None,
) -> CellGrid:
    """Draw the ground as the view shows it, and below it a row with north and scale; what is selected is inverted.

    Args:
        snapshot: What is drawn.
        selected: System id, 0 none.
        view: Which ground, and how many cells.
        labelling: Of ``map_labels`` for the same; worked out unless given.
        extras: What else is drawn.

    Returns:
        One row more than the view has.
    """
    extras = extras or MapExtras()
    cells = CellGrid(view.columns, view.rows + 1, pack(PANEL))
    dots = BrailleCanvas(view.columns, view.rows + 1)
    if extras.ground is not None:
        cells.letter[: view.rows] = HALF
        cells.ink[: view.rows], cells.paper[: view.rows] = extras.ground[0::2], extras.ground[1::2]
    rows = _placed_rows(snapshot, selected)
    marks = _marks(snapshot, rows, view, extras)
    labelling = labelling or map_labels(snapshot, selected, view, extras=extras)
    colours = {mark.system_id: mark.colour for mark in marks if mark.system_id}
    draw_trails(dots, extras.trails, view, _inks(snapshot))
    draw_fences(dots, snapshot, view)
    if snapshot.footprint_enu is not None:
        dots.polygon(view.dots(snapshot.footprint_enu), pack(LINE), every=2.0)
    for footprint in snapshot.footprints_elsewhere:
        dots.polygon(view.dots(footprint), pack(LINE), every=4.0)
    around = [row for row in rows if not _is_old(row) and row.std_m <= USABLE_M]
    spread = np.array([row.std_m for row in around]) / view.metres_per_dot
    dots.circles(view.dots(_places([row.p_enu for row in around])), spread, pack(LINE))
    _residuals(dots, snapshot, rows, view)
    _noses(dots, snapshot, rows, view)
    draw_ruler(dots, extras.ruler, view)
    draw_leaders(dots, labelling, lambda place: pack(colours.get(place.key, INK)))
    dots.bits[view.rows :] = 0
    cells.dots(dots)
    for mark in reversed(marks):
        picked = bool(selected) and mark.system_id == selected
        cells.text(mark.x, mark.y, mark.glyph, pack(BRIGHT if picked else mark.colour), pack(PANEL))

    def look_of(place: Place) -> tuple[int, int]:
        colour = colours.get(place.key, INK)
        picked = bool(selected) and place.key == selected
        return (pack(PANEL), pack(colour)) if picked else (pack(colour), pack(PANEL))

    write_labels(cells, labelling, look_of)
    _write_scale(cells, snapshot, view, extras)
    return cells


def _inks(snapshot: Snapshot) -> dict[int, int]:
    return {system_id: pack(colour) for system_id, colour in vehicle_colours(snapshot).items()}


def _write_scale(cells: CellGrid, snapshot: Snapshot, view: MapView, extras: MapExtras) -> None:
    """North and scale, then of the ruler and the credit what there is room for."""
    texts = ruler_texts(extras.ruler, snapshot)
    bar, _ = scale_bar(view.metres_per_dot, view.columns // (6 if texts else 3))
    scale = f" N↑  {bar}"
    cells.text(0, view.rows, scale[: view.columns], pack(FAINT))
    left = len(scale) + GAP
    for text in texts:
        if left + len(text) <= view.columns:
            cells.text(left, view.rows, text, pack(BRIGHT))
            left += len(text) + GAP
    if extras.credit and left + len(extras.credit) < view.columns:
        cells.text(view.columns - len(extras.credit) - 1, view.rows, extras.credit, pack(FAINT))


def map_labels(
    snapshot: Snapshot,
    selected: int,
    view: MapView,
    former: Labelling | None = None,
    extras: MapExtras | None = None,
) -> Labelling:
    """Cells of ``chart_cells``' names; ``former`` is of the frame before, so that labels stay where they are."""
    extras = extras or MapExtras()
    rows = _placed_rows(snapshot, selected)
    state = {
        row.system_id: f" {position_of(row)}"
        for row in snapshot.vehicles
        if row.position_state != "ok" and (row.role == "ugv" or _is_old(row))
    }
    names = shown_names(snapshot, shows_in_cells)
    uav_name, doubted = _uav_name(snapshot), snapshot.doubted
    labels, others = [], []
    for mark in _marks(snapshot, rows, view, extras):
        anchor = (mark.x, mark.y, 1, 1)
        if not mark.system_id:
            others.append(anchor)
            continue
        shown, word = names[mark.system_id], state.get(mark.system_id, "")
        own = uav_name if mark.system_id == snapshot.vehicles[0].system_id and mark.glyph == UAV_MARK else shown.name
        before = "!" if mark.system_id in doubted else ""
        texts = tuple(dict.fromkeys(f"{before}{name}{word}" for name in (own, shown.short)))
        highlighted = bool(selected) and mark.system_id == selected
        labels.append(
            Label(
                key=mark.system_id,
                anchor=anchor,
                texts=texts,
                legend=shown.legend,
                short=len(texts) - 1,
                highlighted=highlighted,
            )
        )
    grid = Grid(columns=view.columns, rows=view.rows, measure=measure_cells)
    return place_labels(labels, grid, former, others)


def _uav_name(snapshot: Snapshot) -> str:
    """UAV's name in the mission, where that can be shown and is nobody else's name or number; else ``UAV``."""
    name = next((plain(row.name).strip() for row in snapshot.vehicles if row.role == "uav"), "")
    others = {each for row in snapshot.vehicles if row.role != "uav" for each in (row.name, str(row.system_id))}
    usable = (
        0 < len(name) <= LONGEST_UAV_NAME and shows_in_cells(name) and name not in others and name.strip("~?") == name
    )
    return name if usable and "\N{REPLACEMENT CHARACTER}" not in name else "UAV"


def _placed_rows(snapshot: Snapshot, selected: int) -> list[VehicleRow]:
    """Ground vehicles with a place, those first whose label is most wanted."""
    rows = [row for row in snapshot.vehicles if row.role == "ugv" and np.isfinite(row.p_enu[:2]).all()]
    return sorted(rows, key=lambda row: (row.system_id != selected, row.standing != "confirmed"))


def marked_at(snapshot: Snapshot, view: MapView, column: int, row: int) -> tuple[int, int]:
    """System id of the vehicle nearest to a cell, else track id of the box without a name; both 0 out of reach."""
    places = [(each.system_id, 0, each.p_enu) for each in snapshot.vehicles]
    places += [(0, box.track_id, box.p_enu) for box in snapshot.boxes if not box.system_id]
    near = []
    for system_id, track_id, p_enu in places:
        if (cell := view.cell(p_enu)) is not None:
            # cells are twice as high as wide
            near.append((math.hypot(cell[0] - column, 2 * (cell[1] - row)), system_id, track_id))
    away, system_id, track_id = min(near, default=(math.inf, 0, 0))
    return (system_id, track_id) if away <= REACH else (0, 0)


class _Mark(NamedTuple):
    x: int
    y: int
    glyph: str
    colour: Colour
    system_id: int = 0


def _marks(snapshot: Snapshot, rows: Sequence[VehicleRow], view: MapView, extras: MapExtras) -> list[_Mark]:
    """Marks in view: cursor, UAV, ground vehicles, boxes without a name, home; earlier ones over later ones."""
    pointers = zip((extras.ruler.cursor, *extras.ruler.picks), (CURSOR_MARK, *PICK_MARKS), strict=False)
    cells = [(place and view.cell(np.array(place)), glyph) for place, glyph in pointers]
    marks = [_Mark(*cell, glyph, BRIGHT) for cell, glyph in cells if cell]
    aircraft = [row for row in snapshot.vehicles if row.role == "uav"]
    uav = aircraft[0] if aircraft else None
    if (cell := view.cell(snapshot.uav_enu)) is not None:
        marks.append(_Mark(*cell, UAV_MARK, _dated(ACCENT, uav), uav.system_id if uav else 0))
    colours = vehicle_colours(snapshot)
    for row in (*aircraft[1:], *rows):
        if (cell := view.cell(row.p_enu)) is not None:
            glyph = UAV_MARK if row.role == "uav" else STANDING_MARKS.get(row.standing, BOX_MARK)
            marks.append(_Mark(*cell, glyph, _dated(colours[row.system_id], row), row.system_id))
    for box in snapshot.boxes:
        if not box.system_id and (cell := view.cell(box.p_enu)) is not None:
            picked = bool(extras.track) and box.track_id == extras.track
            marks.append(_Mark(*cell, BOX_MARK, BRIGHT if picked else standing_colour("unidentified")))
    # a provisional origin is where the UAV was some seconds ago
    home = view.cell(HOME_ENU) if snapshot.origin is not None and not snapshot.provisional else None
    return marks if home is None else [*marks, _Mark(*home, HOME_MARK, FAINT)]


def _dated(colour: Colour, row: VehicleRow | None) -> Colour:
    """Faint where the place is old: it is the last one that the vehicle reported, and its label says when."""
    return FAINT if row is not None and _is_old(row) else colour


def _is_old(row: VehicleRow) -> bool:
    return row.position_state in ("stale", "lost") and freshness(row.position_age_s) != "fresh"


def _places(p_enu: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(k, 2) east and north."""
    return np.array([place[:2] for place in p_enu], dtype=np.float64).reshape(-1, 2)


def _residuals(dots: BrailleCanvas, snapshot: Snapshot, rows: Sequence[VehicleRow], view: MapView) -> None:
    """A line from where a vehicle reports to be to where its box is."""
    box_enu = {box.system_id: box.p_enu for box in snapshot.boxes if box.system_id}
    seen = [row for row in rows if row.system_id in box_enu]
    start, end = _places([row.p_enu for row in seen]), _places([box_enu[row.system_id] for row in seen])
    colours = _inks(snapshot)
    inks = np.array([colours[row.system_id] for row in seen], dtype=np.int64)
    dots.lines(view.dots(start), view.dots(end), inks)


def _noses(dots: BrailleCanvas, snapshot: Snapshot, rows: Sequence[VehicleRow], view: MapView) -> None:
    """A line ahead of each vehicle, the UAV's on top; none where place or heading is unknown."""
    of_vehicles = vehicle_colours(snapshot)
    noses = [(row.p_enu, row.heading, NOSE_DOTS, of_vehicles[row.system_id]) for row in rows if not _is_old(row)]
    noses.append((snapshot.uav_enu, snapshot.uav_heading, UAV_NOSE_DOTS, ACCENT))
    noses = [nose for nose in noses if math.isfinite(nose[1])]
    if not noses:
        return
    places, headings, lengths, colours = zip(*noses, strict=True)
    # clockwise from north, y down
    ahead = np.array([np.sin(headings), -np.cos(headings)]) * lengths
    start = view.dots(_places(places))
    dots.lines(start, start + ahead.T, np.array([pack(colour) for colour in colours]))
