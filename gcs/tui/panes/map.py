"""The map pane: the ground from above, north up, fitted to the fleet or following one vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual.strip import Strip

from gcs.report.labels import Labelling
from gcs.snapshot import Snapshot
from gcs.tui.draw.format import NOT_ANALYSED
from gcs.tui.draw.ground_view import map_view_of, points_of
from gcs.tui.draw.map_canvas import chart_cells, map_labels
from gcs.tui.draw.strips import Part, line
from gcs.tui.palette import FAINT, HEAD, ink
from gcs.tui.panes.pane import Pane

__all__ = ["MapPane"]

FOLLOW = ("all", "UAV", "selected")
ZOOM_LIMIT = 14


class MapPane(Pane):
    """The map."""

    label: ClassVar[str] = "MAP"

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._zoom = 0
        self._follow = 0
        self._scale = 0.0
        self._labelling = Labelling()

    @property
    def follow(self) -> str:
        """What stays in the middle: ``all``, ``UAV`` or ``selected``."""
        return FOLLOW[self._follow]

    @property
    def zoom(self) -> int:
        """Steps closer than what fits everything."""
        return self._zoom

    def zoom_by(self, steps: int) -> None:
        """Closer (positive) or farther; 0 fits everything again."""
        self._zoom = min(max(self._zoom + steps, -ZOOM_LIMIT), ZOOM_LIMIT) if steps else 0
        self._labelling = Labelling()
        self.redraw()

    def follow_next(self) -> None:
        """Hold the next thing in the middle."""
        self._follow = (self._follow + 1) % len(FOLLOW)
        self._labelling = Labelling()
        self.redraw()

    def note(self) -> Sequence[Part]:
        """What is followed and how far the zoom is from fitting."""
        zoom = f" zoom {self._zoom:+d}" if self._zoom else ""
        return [(f"follow {self.follow}{zoom} ", ink(FAINT, HEAD))]

    def body(self, width: int, height: int) -> list[Strip]:
        """The chart, or a word on what is awaited."""
        if height <= 0:
            return []
        if self.snapshot is None:
            return [line([(" waiting for positions …", ink(FAINT))], width)]
        if not self.snapshot.analysed:
            return [line([(f" {NOT_ANALYSED}", ink(FAINT))], width)]
        centre = self._centre(self.snapshot)
        points = points_of(self.snapshot)
        # the last row is north and scale
        rows = max(1, height - 1)
        self._scale = map_view_of(points, width, rows, before=self._scale, centre=centre).metres_per_dot
        view = map_view_of(points, width, rows, before=self._scale, zoom=self._zoom, centre=centre)
        self._labelling = map_labels(self.snapshot, self.selected, view, self._labelling)
        return chart_cells(self.snapshot, self.selected, view, self._labelling).strips()[:height]

    def _centre(self, snapshot: Snapshot) -> NDArray[np.float64] | None:
        if self.follow == "UAV":
            return snapshot.uav_enu[:2]
        if self.follow == "selected":
            return next((row.p_enu[:2] for row in snapshot.vehicles if row.system_id == self.selected), None)
        return None
