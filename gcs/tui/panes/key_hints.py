"""The last row: the keys that matter most, as many as fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.strip import Strip
from textual.widget import Widget

from gcs.tui.draw.strips import Part, line, width_of
from gcs.tui.palette import ACCENT, FAINT, ink

__all__ = ["KeyHints"]


class KeyHints(Widget):
    """Keys and words."""

    ALLOW_SELECT: ClassVar[bool] = False

    def __init__(self, hints: Sequence[tuple[str, str]], *, id: str) -> None:
        super().__init__(id=id)
        self._hints = tuple(hints)

    def render_line(self, y: int) -> Strip:
        """Key in colour, word beside it."""
        parts: list[Part] = []
        for key, word in self._hints:
            hint = [(f" {key}", ink(ACCENT, bold=True)), (f" {word} ", ink(FAINT))]
            if width_of(parts) + width_of(hint) <= self.size.width:
                parts += hint
        return line(parts, self.size.width)
