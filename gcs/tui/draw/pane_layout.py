"""The place of each pane: three layouts from 80×24 upward, in whole cells. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

Rect = tuple[int, int, int, int]
"""Rectangle of cells: left, top, width, height."""

PANES = ("video", "map", "fleet", "identity", "events")
FLEET_WIDTHS = (35, 40, 50, 59, 69, 78)
"""Widths at which one more column of the fleet table fits."""
TALLER = 1.3
"""The video is this much higher than its frame where there is room: a part of the frame fills it."""
FLEET_SHARE = 0.42
"""Share of the width that the table may take beside a view."""
MIN_IDENTITY_ROWS = 6
IDENTITY_ROWS, MORE_IDENTITY_ROWS = 13, 24
"""Rows for who, how sure, what against, where and what to do; on tall screens for what else is known too."""
TALL = 46
EVENT_ROWS = 4
ALARM_ROWS = 10
"""Two or three alarms with their advice, however many there are: no pane moves when one comes or goes."""
CHART_ROWS = 8
ROWS_OF_NAMES = 3
"""Vehicles whose names a row of the map has room for."""
ROOMY = (120, 36)
USUAL = 80
"""Columns of a usual terminal: from here on the table has its identities in whole words."""
LOW = 22
"""Rows of a field; a narrow one that is lower has room for the fleet and who the picked vehicle is, or for events."""
SMALLEST = 60
"""Columns that screens are made for: from here on the narrowest fleet table is whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutState:
    """Layout that the operator wants to see."""

    layout: int = 1
    """1 video first, 2 map first, 3 both beside each other."""
    chosen: bool = False
    """True once the operator chose; else a flight without a camera begins with the map."""
    toggled: frozenset[str] = field(default=frozenset())
    """Panes switched against the layout's default."""
    maximised: str = ""
    """A pane that takes everything, empty for none."""
    fleet_rows: int = 8
    aspect: float = 16 / 9
    """Width over height of the frame."""

    def shown(self, width: int, height: int) -> frozenset[str]:
        """Panes wanted in a field of this size."""
        return default_panes(self.layout, width, height) ^ self.toggled


def default_panes(layout: int, width: int, height: int) -> frozenset[str]:
    """Panes of a layout before the operator switches any; not all of them fit a small screen."""
    if width >= ROOMY[0] and height >= ROOMY[1]:
        return frozenset(PANES)
    less = {1: {"map"}, 2: {"video"}, 3: {"identity", "events"}}.get(layout, set())
    return frozenset(PANES) - less - ({"events"} if width < USUAL and height < LOW else set())


def arranged(width: int, height: int, state: LayoutState) -> Mapping[str, Rect]:
    """Rectangles of the panes that find room."""
    if width <= 0 or height <= 0:
        return {}
    if state.maximised:
        return {state.maximised: (0, 0, width, height)}
    shown = state.shown(width, height)
    beside = state.layout == 3 and height >= CHART_ROWS + 4 and width >= 2 * CHART_ROWS
    rects = _beside(width, height, state, shown) if beside else _main(width, height, state, shown)
    return {pane: rect for pane, rect in rects.items() if rect[2] > 0 and rect[3] > 0}


def _main(width: int, height: int, state: LayoutState, shown: frozenset[str]) -> dict[str, Rect]:
    """A large view with the log below; table, identity and the other view in a column on the right."""
    views = [pane for pane in (("video", "map") if state.layout == 1 else ("map", "video")) if pane in shown]
    if views[1:] == ["map"] and "map" not in state.toggled and _hides_vehicles(height, state):
        views = views[:1]
    texts = [pane for pane in ("alarms", "events") if pane in shown]
    if width < USUAL and views and texts:  # a column of half the width has no room for their words
        rows = min(ALARM_ROWS if "alarms" in texts else EVENT_ROWS, height // 2)
        above = _main(width, height - rows, state, shown - set(texts))
        return above | _column(texts[:1], (0, height - rows, width, rows), state)
    left = [*views[:1], *texts]
    right = [pane for pane in ("fleet", "identity") if pane in shown] + views[1:]
    if not left or not right:
        return _column(left or right, (0, 0, width, height), state)
    most = max(FLEET_WIDTHS[width >= USUAL], round(FLEET_SHARE * width))
    half = max(width // 2, FLEET_WIDTHS[0]) if width >= SMALLEST else width // 2
    right_width = min(max(size for size in FLEET_WIDTHS if size <= most), half)
    left_width = width - right_width - 1
    return {
        **_column(left, (0, 0, left_width, height), state),
        **_column(right, (left_width + 1, 0, right_width, height), state),
    }


def _hides_vehicles(height: int, state: LayoutState) -> bool:
    """Tell whether a map below the table takes rows of it, or has too few for the names of this many vehicles."""
    return height - (state.fleet_rows + 1) - MIN_IDENTITY_ROWS < max(CHART_ROWS, state.fleet_rows // ROWS_OF_NAMES)


def _beside(width: int, height: int, state: LayoutState, shown: frozenset[str]) -> dict[str, Rect]:
    """Both views beside each other above the whole table."""
    views = [pane for pane in ("video", "map") if pane in shown]
    below = [pane for pane in ("fleet", "alarms", "identity", "events") if pane in shown]
    if not views or not below:
        return _column(views or below, (0, 0, width, height), state)
    table = state.fleet_rows + 1
    spare = EVENT_ROWS + 3 if height >= ROOMY[1] else 0
    view_width = (width - len(views) + 1) // len(views)
    top = max(CHART_ROWS, min(_video_rows(view_width, state), height - table - spare))
    rects: dict[str, Rect] = {}
    for index, pane in enumerate(views):
        left = index * (view_width + 1)
        rects[pane] = (left, 0, width - left if index == len(views) - 1 else view_width, top)
    rest = (0, top, width, height - top)
    if width < ROOMY[0] or below == ["fleet"] or "fleet" not in below:
        return rects | _column(below, rest, state)
    table_width = round(0.62 * width)
    beside = (table_width + 1, top, width - table_width - 1, height - top)
    under = [pane for pane in ("alarms", "events") if pane in below] if "identity" in below else []
    return (
        rects
        | _column(["fleet", *under], (0, top, table_width, height - top), state)
        | _column([pane for pane in below if pane not in ("fleet", *under)], beside, state)
    )


def _column(panes: Sequence[str], field: Rect, state: LayoutState) -> dict[str, Rect]:
    """Stack panes; those that find no room are left out, the least needed first."""
    left, top, width, height = field
    heights = _heights(list(panes), width, height, state)
    rects: dict[str, Rect] = {}
    for pane, rows in heights.items():
        rects[pane] = (left, top, width, rows)
        top += rows
    return rects


def _heights(panes: list[str], width: int, height: int, state: LayoutState) -> dict[str, int]:
    least = {
        "video": CHART_ROWS,
        "map": CHART_ROWS,
        "fleet": min(state.fleet_rows + 1, max(4, height // 2)),
        "identity": MIN_IDENTITY_ROWS,
        "events": EVENT_ROWS,
        "alarms": min(ALARM_ROWS, max(EVENT_ROWS, height // 3)),
    }
    for spare in ("identity", "events", "map", "video"):
        if len(panes) > 1 and spare in panes and sum(least[pane] for pane in panes) > height:
            panes.remove(spare)
    natural = {**least, "video": round(TALLER * _video_rows(width, state)), "fleet": state.fleet_rows + 1}
    natural["identity"] = MORE_IDENTITY_ROWS if height >= TALL else IDENTITY_ROWS
    natural["alarms"] = ALARM_ROWS
    rows = {pane: least[pane] for pane in panes}
    for pane in ("fleet", "alarms", "video", "identity"):
        if pane in rows:
            free = height - sum(rows.values())
            rows[pane] += max(0, min(free, natural[pane] - rows[pane]))
    # what is left goes to the pane that uses it best
    for pane in ("map", "events", "video", "identity", "fleet", "alarms"):
        if pane in rows:
            rows[pane] += height - sum(rows.values())
            break
    return rows


def _video_rows(width: int, state: LayoutState) -> int:
    return max(1, round(width / state.aspect / 2)) + 1
