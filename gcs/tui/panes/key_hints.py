"""The last row: the keys that matter most where the focus is, as many as fit; a click on one presses it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.reactive import reactive
from textual.strip import Strip

from gcs.tui.draw.strips import Part, clickable, line, width_of
from gcs.tui.kept_lines import KeptLines, PlainLines
from gcs.tui.keys import Hint, hints_for, signs_in
from gcs.tui.palette import ACCENT, FAINT, PANEL, ink
from gcs.tui.themes import Colour


def hint_parts(hint: Hint, paper: Colour = PANEL) -> list[Part]:
    """Keys in colour, the word beside them; each key can be clicked, the word is the first."""
    keys, word = hint
    signs = signs_in(keys)
    parts = [(" ", ink(paper=paper))]
    parts += [clickable((sign, ink(ACCENT, paper, bold=True)), _press(key)) for sign, key in signs.items()]
    return [*parts, clickable((f" {word} ", ink(FAINT, paper)), _press(next(iter(signs.values()))))]


def _press(key: str) -> str:
    return f"app.simulate_key({key!r})"


class KeyHints(KeptLines, PlainLines):
    """Keys and words."""

    ALLOW_SELECT: ClassVar[bool] = False
    pane: reactive[str] = reactive("")
    """Id of the focused pane, empty for none."""

    def __init__(self, hints: Sequence[Hint], *, id: str) -> None:
        super().__init__(id=id)
        self._hints = tuple(hints)

    def render_line(self, y: int) -> Strip:
        """Draw the hints, those of the focused pane early."""
        parts: list[Part] = []
        for each in hints_for(self._hints, self.pane):
            hint = hint_parts(each)
            if width_of(parts) + width_of(hint) <= self.size.width:
                parts += hint
        return line(parts, self.size.width)
