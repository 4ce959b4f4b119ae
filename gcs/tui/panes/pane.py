"""What all panes share: a heading row, a body of strips, and redraw of only those rows that changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.style import Style
from textual import events
from textual.geometry import Region
from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from gcs.snapshot import Snapshot
from gcs.tui.draw.strips import Part, blank, split_line
from gcs.tui.palette import ACCENT, HEAD, INK, ink

__all__ = ["Pane"]


class Pane(Widget, can_focus=True):
    """A panel of the screen; the app binds ``snapshot`` and what is picked to every pane."""

    ALLOW_SELECT: ClassVar[bool] = False
    label: ClassVar[str] = ""

    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True, repaint=False)
    selected: reactive[int] = reactive(0, repaint=False)
    picked_track: reactive[int] = reactive(0, repaint=False)
    """Track id of the picked box while it has no name, 0 none."""

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._rows: list[Strip] = []

    def note(self) -> Sequence[Part]:
        """The heading's right end."""
        return ()

    def body(self, width: int, height: int) -> list[Strip]:
        """Rows below the heading, at most ``height`` of exactly ``width`` cells."""
        return []

    def heading(self, width: int) -> Strip:
        """The first row; a mark and a brighter name show the focus."""
        name: Style = ink(ACCENT, HEAD, bold=True) if self.has_focus else ink(INK, HEAD)
        mark = "▌" if self.has_focus else " "
        return split_line([(mark, ink(ACCENT, HEAD)), (self.label, name), (" ", name)], self.note(), width)

    def redraw(self) -> None:
        """Build all rows again and repaint those that differ."""
        width, height = self.size
        if width <= 0 or height <= 0 or not self.display:
            return
        body = self.body(width, height - 1)  # the heading may tell what of it is on screen
        rows = [self.heading(width), *body][:height]
        rows += [blank(width)] * (height - len(rows))
        same = len(rows) == len(self._rows)
        changed = [y for y, row in enumerate(rows) if not same or row != self._rows[y]]
        for y in changed:
            if same:
                self._rows[y] = rows[y]
        if not same:
            self._rows = rows
        if changed:
            self.refresh(*(Region(0, y, width, 1) for y in changed))

    def render_line(self, y: int) -> Strip:
        """One row as it was last built."""
        return self._rows[y] if y < len(self._rows) else blank(self.size.width)

    def watch_snapshot(self) -> None:
        """Something new to show."""
        self.redraw()

    def watch_selected(self) -> None:
        """Another vehicle is stressed."""
        self.redraw()

    def watch_picked_track(self) -> None:
        """Another box is stressed."""
        self.redraw()

    def on_resize(self, event: events.Resize) -> None:
        """All rows have another width."""
        self._rows = []
        self.redraw()

    def watch_has_focus(self, value: bool) -> None:
        """The heading shows the focus."""
        super().watch_has_focus(value)
        self.redraw()
