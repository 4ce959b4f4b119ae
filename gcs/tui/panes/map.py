"""The map pane: the ground from above, north up, fitted to the fleet, following a vehicle, or panned."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from textual import events
from textual.binding import Binding, BindingType
from textual.strip import Strip

from gcs.errors import ConfigError
from gcs.mission.tile_file import TileFile
from gcs.report.labels import Labelling
from gcs.snapshot import Event, Snapshot
from gcs.station import Station
from gcs.trails import Trail, Trails
from gcs.tui.draw.basemap import Basemap
from gcs.tui.draw.format import age
from gcs.tui.draw.ground_view import HOME_ENU, MapView, map_view_of, points_of, step_scale
from gcs.tui.draw.map_canvas import MapExtras, chart_cells, map_labels, marked_at
from gcs.tui.draw.map_lines import Ruler
from gcs.tui.draw.strips import Part, line
from gcs.tui.messages import VehiclePicked
from gcs.tui.palette import FAINT, HEAD, PANEL, ink, pack
from gcs.tui.panes.pane import Pane
from mavlink.geodesy import LocalFrame

FOLLOW: Final = ("all", "UAV", "selected")
ZOOM_LIMIT: Final = 14
TRAILS_S: Final = (30.0, 120.0, 600.0, 0.0, 10.0)
"""Lengths of trails in turn, the first one at the start."""
PAN_STEP: Final = (8, 4)
"""Columns and rows of one key; as far on the screen both ways."""

FARTHEST_ORIGIN_M: Final = 10_000.0
"""Greatest distance of two origins about which east and north are the same directions."""

TrailSource = Callable[[int, float, LocalFrame | None], Sequence[Trail]]
"""Trails before a moment, this many seconds long, about an origin."""


def _key(key: str, action: str, tooltip: str) -> Binding:
    return Binding(key, action, key, id=f"map.{key}", show=False, tooltip=tooltip)


class MapPane(Pane):
    """The map."""

    label: ClassVar[str] = "MAP"
    is_picture: ClassVar[bool] = True
    rest_s = 0.15
    """A vehicle of 5 m/s moves by a cell or less meanwhile, and half of a video's rate is half of the cost."""
    BINDINGS: ClassVar[list[BindingType]] = [
        _key("up", "pan(0,-1)", "Pan north, or move the cursor"),
        _key("down", "pan(0,1)", "Pan south, or move the cursor"),
        _key("left", "pan(-1,0)", "Pan west, or move the cursor"),
        _key("right", "pan(1,0)", "Pan east, or move the cursor"),
        _key("h", "home", "Home: where the UAV was first"),
        _key("T", "trails", "Trails: 30 s, 2 min, 10 min, none, 10 s"),
        _key("r", "ruler", "Ruler: a cursor with its coordinates, and off again"),
        _key("enter", "pick_place", "Ruler: measure from here, then to here"),
    ]
    """Keys that count while the map has the focus; ``j`` and ``k`` still choose a vehicle."""

    def __init__(self, *, id: str, trails: TrailSource | None = None, basemap: Basemap | None = None) -> None:
        """A map.

        Args:
            id: Of the widget.
            trails: Where a replay's trails come from; those of a flight are what this pane was shown.
            basemap: What is under it all.
        """
        super().__init__(id=id)
        self.zoom = 0
        """Steps closer than what fits everything."""
        self._follow = 0
        self._scale = 0.0
        self._labelling = Labelling()
        self._free: MapView | None = None
        """Place that the operator looks at, None: what fits or is followed."""
        self.view: MapView | None = None
        """View of what is on the screen."""
        self._origin: LocalFrame | None = None
        self.ruler = Ruler()
        """Ruler with what the operator points at."""
        self._span = 0
        self._shown = Trails()
        self._trails: TrailSource = trails or self._shown.before
        self._basemap = basemap
        self._dragged_from: tuple[int, int] | None = None
        self._moved = False

    @property
    def follow(self) -> str:
        """Vehicle that stays in the middle: ``all``, ``UAV`` or ``selected``; empty after the operator panned."""
        return "" if self._free else FOLLOW[self._follow]

    def zoom_by(self, steps: int) -> None:
        """Zoom closer (positive) or farther; 0 fits everything again."""
        if steps and self._free:
            self._look(replace(self._free, metres_per_dot=step_scale(self._free.metres_per_dot, -steps)))
            return
        self.zoom = min(max(self.zoom + steps, -ZOOM_LIMIT), ZOOM_LIMIT) if steps else 0
        self._look(None)

    def follow_next(self) -> None:
        """Hold the next thing in the middle."""
        self._follow = 0 if self._free else (self._follow + 1) % len(FOLLOW)
        self._look(None)

    def action_pan(self, columns: int, rows: int) -> None:
        """Move the cursor by a cell, else the ground by some."""
        if self.view is None:
            return
        if self.ruler.cursor is None:
            self._look(self.view.moved(columns * PAN_STEP[0], rows * PAN_STEP[1]))
            return
        step = self.view.metres_per_dot
        east, north = self.ruler.cursor
        self.ruler = replace(self.ruler, cursor=(east + 2 * columns * step, north - 4 * rows * step))
        if self.view.cell(np.array(self.ruler.cursor)) is None:
            self._look(self.view.moved(columns * PAN_STEP[0], rows * PAN_STEP[1]))
        self.redraw()

    def action_home(self) -> None:
        """Look where the UAV was first; nobody knows where before the analysis of a recording came by."""
        if self.view is not None and self.snapshot is not None and not self.snapshot.provisional:
            self._look(replace(self.view, east=float(HOME_ENU[0]), north=float(HOME_ENU[1])))

    def action_trails(self) -> None:
        """Go on to the next length of trails."""
        self._span = (self._span + 1) % len(TRAILS_S)
        self.redraw()

    def action_ruler(self) -> None:
        """Put a cursor in the middle, or take it away."""
        if self.view is not None:
            on = self.ruler.cursor is None
            self.ruler = Ruler(cursor=(self.view.east, self.view.north)) if on else Ruler()
            self.redraw()

    def action_pick_place(self) -> None:
        """Measure from the cursor, then to it."""
        self.ruler = self.ruler.picked()
        self.redraw()

    def _look(self, view: MapView | None) -> None:
        """Look somewhere else; labels find their places again."""
        self._free = view
        self._labelling = Labelling()
        self.redraw()

    def note(self) -> Sequence[Part]:
        """Words for what is followed, how far the zoom is from fitting, how long trails are."""
        held = f"follows {self.follow}" if self.follow else "panned, c: follow"
        zoom = f" · zoom {self.zoom:+d}" if self.zoom and not self._free else ""
        span = TRAILS_S[self._span]
        return [(f"{held}{zoom} · trail {age(span) if span else 'off'} ", ink(FAINT, HEAD))]

    def watch_snapshot(self) -> None:
        """Take in a new snapshot, and keep it for trails."""
        if self.snapshot is not None:
            if self.snapshot.origin != self._origin:
                self._follow_origin(self.snapshot.origin)
            self._shown.add(self.snapshot)
        super().watch_snapshot()

    def _follow_origin(self, origin: LocalFrame | None) -> None:
        """The metres are counted from elsewhere: what was pointed at stays where it is, or goes where that is far."""
        before, self._origin = self._origin, origin
        if before is not None and origin is not None:
            east, north, _ = origin.to_enu_point(before.lat_deg, before.lon_deg, before.alt_m)
            if math.hypot(east, north) < FARTHEST_ORIGIN_M:
                self.ruler = self.ruler.shifted(east, north)
                if self._free is not None:
                    self._free = replace(self._free, east=self._free.east + east, north=self._free.north + north)
                return
        self._free, self.ruler = None, Ruler()

    def on_unmount(self) -> None:
        """Close the tiles."""
        if self._basemap is not None:
            self._basemap.tiles.close()

    def body(self, width: int, height: int) -> list[Strip]:
        """Draw the chart, or a word on what is awaited."""
        if height <= 0:
            return []
        if self.snapshot is None:
            return [line([(" waiting for positions …", ink(FAINT))], width)]
        if not self.snapshot.analysed:
            return []
        view = self.view = self._view_of(self.snapshot, width, max(1, height - 1))
        span = TRAILS_S[self._span]
        trails = tuple(self._trails(self.snapshot.t_us, span, self.snapshot.origin)) if span else ()
        ground = self._basemap.picture(view, self.snapshot.origin, pack(PANEL)) if self._basemap else None
        credit = self._basemap.tiles.credit if self._basemap and ground is not None else ""
        extras = MapExtras(track=self.picked_track, trails=trails, ruler=self.ruler, ground=ground, credit=credit)
        self._labelling = map_labels(self.snapshot, self.selected, view, self._labelling, extras)
        return chart_cells(self.snapshot, self.selected, view, self._labelling, extras).strips()[:height]

    def _view_of(self, snapshot: Snapshot, width: int, rows: int) -> MapView:
        """View of the rows above the one with north and scale."""
        if self._free is not None:
            self._free = replace(self._free, columns=width, rows=rows)
            return self._free
        centre = self._centre(snapshot)
        points = points_of(snapshot)
        self._scale = map_view_of(points, width, rows, before=self._scale, centre=centre).metres_per_dot
        return map_view_of(points, width, rows, before=self._scale, zoom=self.zoom, centre=centre)

    def _centre(self, snapshot: Snapshot) -> NDArray[np.float64] | None:
        if self.follow == "UAV":
            return snapshot.uav_enu[:2]
        if self.follow == "selected":
            return next((row.p_enu[:2] for row in snapshot.vehicles if row.system_id == self.selected), None)
        return None

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Zoom closer to what is under the pointer."""
        self._zoom_at(event, 1)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Zoom farther from what is under the pointer."""
        self._zoom_at(event, -1)

    def _zoom_at(self, event: events.MouseEvent, steps: int) -> None:
        event.stop()
        if self.view is not None:
            self._look(self.view.zoomed(steps, event.x, event.y - 1))

    def on_mouse_down(self, event: events.MouseDown) -> None:
        """Take hold of the ground; the heading has keys to click on."""
        self._moved = False
        if event.y < 1:
            return
        self._dragged_from = (event.x, event.y)
        self.capture_mouse()

    def on_mouse_move(self, event: events.MouseMove) -> None:
        """Move the ground with the pointer."""
        if self._dragged_from is None or self.view is None:
            return
        columns, rows = self._dragged_from[0] - event.x, self._dragged_from[1] - event.y
        if columns or rows:
            self._dragged_from, self._moved = (event.x, event.y), True
            self._look(self.view.moved(columns, rows))

    def on_mouse_up(self, event: events.MouseUp) -> None:
        """Let go."""
        self._dragged_from = None
        self.release_mouse()

    def on_click(self, event: events.Click) -> None:
        """Pick the vehicle or the box under the pointer, or measure there with the ruler."""
        if self._moved or self.snapshot is None or self.view is None or event.y < 1:
            return
        if self.ruler.cursor is not None:
            east, north = self.view.ground(event.x, event.y - 1).tolist()
            self.ruler = replace(self.ruler, cursor=(east, north)).picked()
            self.redraw()
        else:
            self.post_message(VehiclePicked(*marked_at(self.snapshot, self.view, event.x, event.y - 1)))


def map_pane(station: Station, trails: TrailSource) -> MapPane:
    """The map of a station, with what the mission has to be under it; tiles that cannot be used are an event."""
    basemap = None
    if station.tiles is not None:
        try:
            basemap = Basemap(TileFile(station.tiles))
        except ConfigError as error:
            start_us = station.timeline.start_us if station.timeline else time.time_ns() // 1000
            station.add_event(Event(t_us=start_us, level="warning", kind="program", text=f"no basemap: {error}"))
    return MapPane(id="map", trails=trails if station.timeline else None, basemap=basemap)
