"""Rows of widgets: taken as they are, and drawn again only when something has changed."""

from __future__ import annotations

from typing import Self

from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class PlainLines(Widget):
    """A widget without a border, padding and tints, for which Textual would look in each row."""

    def render_lines(self, crop: Region) -> list[Strip]:
        """Rows as they are."""
        if self.get_line_filters():
            return super().render_lines(crop)
        left, right = crop.column_span
        return [self.render_line(y).crop(left, right) for y in crop.line_range]


class KeptLines(Widget):
    """A widget that keeps its rows until it is refreshed: with each update Textual asks all widgets for theirs."""

    _kept: tuple[Region, list[Strip]] | None = None

    def refresh(self, *regions: Region, repaint: bool = True, layout: bool = False, recompose: bool = False) -> Self:
        """Drop the rows, and draw again."""
        self._kept = None
        return super().refresh(*regions, repaint=repaint, layout=layout, recompose=recompose)

    def render_lines(self, crop: Region) -> list[Strip]:
        """Rows as they were, or new ones."""
        if self._kept is None or self._kept[0] != crop:
            self._kept = crop, super().render_lines(crop)
        return self._kept[1]
