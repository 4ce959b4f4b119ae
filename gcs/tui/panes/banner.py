"""One loud row, there only when something is wrong: the station stopped, nothing new comes, an alarm came in."""

from __future__ import annotations

from typing import ClassVar

from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from gcs.tui.draw.format import plain
from gcs.tui.draw.strips import fitted, line
from gcs.tui.palette import ALARM, PANEL, ink

__all__ = ["Banner"]


class Banner(Widget):
    """Shown while ``text`` is not empty."""

    ALLOW_SELECT: ClassVar[bool] = False
    text: reactive[str] = reactive("")

    def watch_text(self, text: str) -> None:
        """There only while there is something to show."""
        self.display = bool(text)

    def render_line(self, y: int) -> Strip:
        """Dark on red; the words alone are enough."""
        width = self.size.width
        return line([(fitted(f" !! {plain(self.text)}", width), ink(PANEL, ALARM, bold=True))], width, ALARM)
