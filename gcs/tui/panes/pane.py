"""Base of all panes: a heading row, a body of strips, and redraw of only those rows that changed."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import ClassVar

from rich.style import Style
from textual import events
from textual.geometry import Region
from textual.reactive import reactive
from textual.strip import Strip

from gcs.snapshot import Snapshot
from gcs.tui.draw.strips import Part, blank, split_line, width_of
from gcs.tui.kept_lines import PlainLines
from gcs.tui.keys import PANE_HINTS
from gcs.tui.palette import ACCENT, BRIGHT, HEAD, ink
from gcs.tui.panes.key_hints import hint_parts


class Pane(PlainLines, can_focus=True):
    """A panel of the screen; the app binds ``snapshot`` and what is picked to every pane."""

    ALLOW_SELECT: ClassVar[bool] = False
    label: ClassVar[str] = ""
    is_picture: ClassVar[bool] = False
    """True of a pane that takes most of what goes to the terminal, and waits until the terminal has the last one."""
    rest_s: float = 0.0
    """Time for which new snapshots wait after a drawing, which keys do not."""

    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True, repaint=False)
    selected: reactive[int] = reactive(0, repaint=False)
    picked_track: reactive[int] = reactive(0, repaint=False)
    """Track id of the picked box while it has no name, 0 none."""

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._rows: list[Strip] = []
        self._held = False
        self.maximised = False
        """True if it has the whole screen."""
        self._owed = False
        self._behind = False
        """True if the newest snapshot is not drawn yet, since the last drawing was a moment ago."""
        self._drawn_s = -math.inf

    def note(self) -> Sequence[Part]:
        """Return the heading's right end."""
        return ()

    def body(self, width: int, height: int) -> list[Strip]:
        """Rows below the heading, at most ``height`` of exactly ``width`` cells."""
        return []

    def heading(self, width: int) -> Strip:
        """The first row; with the focus a mark, a brighter name, and the keys that act here as far as there is room."""
        name: Style = ink(ACCENT if self.has_focus else BRIGHT, HEAD, bold=True)
        mark = "▌" if self.has_focus else " "
        left, note = [(mark, ink(ACCENT, HEAD)), (self.label, name), (" ", name)], self.note()
        if self.has_focus and self.id is not None:
            for hint in PANE_HINTS.get(self.id, ()):
                parts = hint_parts(hint, HEAD)
                if width_of(left) + width_of(parts) + width_of(note) < width:
                    left += parts
        return split_line(left, note, width, rule=True)

    def redraw(self) -> None:
        """Build all rows again and repaint those that differ."""
        width, height = self.size
        if width <= 0 or height <= 0 or not self.display:
            return
        self._owed = self._held and bool(self._rows)
        if self._owed:
            return
        self._behind, self._drawn_s = False, time.monotonic()
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
            self.refresh(*(Region(0, top, width, count) for top, count in _stretches(changed)))

    def hold(self, held: bool) -> None:
        """Keep what is shown for now; what was to be drawn meanwhile is drawn when that is over."""
        self._held = held
        if not held and (self._owed or (self._behind and not self._rests)):
            self.redraw()

    @property
    def _rests(self) -> bool:
        return time.monotonic() - self._drawn_s < self.rest_s

    def render_line(self, y: int) -> Strip:
        """One row as it was last built."""
        return self._rows[y] if y < len(self._rows) else blank(self.size.width)

    def watch_snapshot(self) -> None:
        """Draw again when there is something new to show, soon or at once."""
        self._behind = self._rests
        if not self._behind:
            self.redraw()

    def watch_selected(self) -> None:
        """Draw again when another vehicle is picked."""
        self.redraw()

    def watch_picked_track(self) -> None:
        """Draw again when another box is picked."""
        self.redraw()

    def on_resize(self, event: events.Resize) -> None:
        """Draw all rows again, in another width."""
        self._rows = []
        self.redraw()

    def watch_has_focus(self, value: bool) -> None:
        """Show the focus in the heading."""
        super().watch_has_focus(value)
        self.redraw()


def _stretches(numbers: Sequence[int]) -> Iterator[tuple[int, int]]:
    """First and count of each stretch of numbers that follow each other, of some in ascending order."""
    for _, stretch in groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0]):
        first, *more = (number for _, number in stretch)
        yield first, 1 + len(more)
