"""The area of all panes: which are shown, and where, as the operator wants it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from textual import events
from textual.app import ComposeResult
from textual.geometry import NULL_OFFSET, NULL_SPACING, Region, Size
from textual.layout import Layout, WidgetPlacement
from textual.widget import Widget

from gcs.snapshot import Snapshot
from gcs.tui.draw.pane_layout import LayoutState, Rect, arranged
from gcs.tui.kept_lines import KeptLines
from gcs.tui.panes.pane import Pane


class _PaneAreaLayout(Layout):
    """Puts each pane on the rectangle that its area has for it."""

    name = "panes"

    def arrange(self, parent: Widget, children: list[Widget], size: Size, greedy: bool = True) -> list[WidgetPlacement]:
        rects: Mapping[str, Rect] = parent.rects_in(size) if isinstance(parent, PaneArea) else {}
        return [
            WidgetPlacement(Region(*rects[child.id]), NULL_OFFSET, NULL_SPACING, child)
            for child in children
            if child.id is not None and child.id in rects
        ]


class PaneArea(KeptLines):
    """All panes; those without room are not displayed."""

    def __init__(self, panes: Iterable[Pane], *, id: str) -> None:
        super().__init__(id=id)
        self.panes = tuple(panes)
        self._layout_of_panes = _PaneAreaLayout()
        self.state = LayoutState()

    @property
    def layout(self) -> Layout:
        """Layout of the area itself."""
        return self._layout_of_panes

    def compose(self) -> ComposeResult:
        """Yield the panes."""
        yield from self.panes

    def rects_in(self, size: Size) -> Mapping[str, Rect]:
        """Rectangle of every pane that finds room, by id."""
        return arranged(size.width, size.height, self.state)

    def has_room(self, pane_id: str) -> bool:
        """Tell whether a pane is on screen."""
        return pane_id in self.rects_in(self.size)

    def change(self, state: LayoutState) -> None:
        """Lay out again if anything differs."""
        if state != self.state:
            self.state = state
            self._show()

    def fit_to(self, snapshot: Snapshot) -> None:
        """Follow the number of vehicles, whether there is a camera, and the shape of its frame."""
        aspect = snapshot.width / snapshot.height if snapshot.width > 0 and snapshot.height > 0 else self.state.aspect
        fleet_rows = max(1, len(snapshot.vehicles)) if snapshot.analysed else self.state.fleet_rows
        aspect = min(max(aspect, 0.3), 4.0)
        layout = self.state.layout
        if not self.state.chosen:
            layout = 2 if snapshot.image is None and snapshot.health.video in ("none", "stalled") else 1
        self.change(replace(self.state, layout=layout, fleet_rows=fleet_rows, aspect=aspect))

    def hold_pictures(self, held: bool) -> None:
        """Keep the video and the map as they are for now, or let them go on."""
        for pane in self.panes:
            if pane.is_picture:
                pane.hold(held)

    def choose(self, layout: int) -> None:
        """Choose one of the three layouts, as it comes."""
        self.change(replace(self.state, layout=layout, chosen=True, toggled=frozenset(), maximised=""))

    def maximise(self, pane_id: str) -> None:
        """Show one pane over everything; the same again, or none, brings the layout back."""
        self.change(replace(self.state, maximised="" if self.state.maximised == pane_id else pane_id))

    def toggle(self, pane_id: str) -> None:
        """Bring a pane to the focus; put it away when it has it."""
        pane = next(pane for pane in self.panes if pane.id == pane_id)
        if self.state.maximised:
            hide = self.state.maximised == pane_id
            self.change(replace(self.state, maximised="" if hide else pane_id))
            self.screen.set_focus(None if hide else pane)
        elif pane.has_focus and self.has_room(pane_id):
            self.change(replace(self.state, toggled=self.state.toggled ^ {pane_id}))
            self.screen.set_focus(None)
        else:
            self._bring(pane_id)
            self.screen.set_focus(pane)

    def _bring(self, pane_id: str) -> None:
        if pane_id not in self.state.shown(*self.size):
            self.change(replace(self.state, toggled=self.state.toggled ^ {pane_id}))
        if not self.has_room(pane_id):
            self.maximise(pane_id)

    def _show(self) -> None:
        rects = self.rects_in(self.size)
        for pane in self.panes:
            pane.display, pane.maximised = pane.id in rects, pane.id == self.state.maximised
            # a child that asks for a layout is what makes its parent forget the arrangement before
            pane.refresh(layout=True)

    def on_resize(self, event: events.Resize) -> None:
        """Panes may find or lose room."""
        self._show()
