"""The help screen: every key in a word, and what the signs on the video mean."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from gcs.tui.draw.format import standing_word
from gcs.tui.draw.map_canvas import BOX_MARK, STANDING_MARKS, UAV_MARK
from gcs.tui.draw.moments import SIGNS as MOMENT_SIGNS
from gcs.tui.keys import GROUPS
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, INK, ink, standing_colour
from gcs.tui.panes.alarms import ALARM_KEYS

__all__ = ["HelpScreen"]

SIGNS = (
    ("UGV-3 97%", "confirmed", "confirmed: the box is this vehicle, with this probability"),
    ("UGV-3? 61%", "tentative", "tentative: best guess, not to be relied on"),
    ("~UGV-3 88%", "coasting", "coasting: predicted, not seen in this frame"),
    ("?", "unidentified", "unknown: a vehicle without a name"),
)


MARKS_EACH = 4
"""Of the map's marks in one row."""


class HelpScreen(ModalScreen[None]):
    """Leave with any of its keys."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,q,enter", "dismiss", "Close", id="help.close", tooltip="Close the help"),
        Binding("down,j", "scroll(2)", "Down", id="help.down", tooltip="Scroll down", show=False),
        Binding("up,k", "scroll(-2)", "Up", id="help.up", tooltip="Scroll up", show=False),
    ]

    def __init__(self, *, live: bool) -> None:
        super().__init__()
        self._live = live

    def compose(self) -> ComposeResult:
        """Two columns of keys over the signs."""
        with VerticalScroll(id="help", can_focus=False):
            yield Static(self._text(), markup=False)

    def action_scroll(self, rows: int) -> None:
        """Move the text."""
        self.query_one("#help").scroll_relative(y=rows, animate=False)

    def _text(self) -> Text:
        text = Text(no_wrap=True)
        for title, bindings in (*GROUPS, ("Alarms", ALARM_KEYS)):
            if title == "Replay" and self._live:
                continue
            text.append(f"{title}\n", ink(ACCENT, bold=True))
            for binding in bindings:
                shown = binding.key_display or binding.key.split(",")[0]
                text.append(f"  {shown:<8}", ink(BRIGHT))
                text.append(f" {binding.tooltip}\n", ink(INK))
        text.append("On the video\n", ink(ACCENT, bold=True))
        for sign, standing, meaning in SIGNS:
            text.append(f"  {sign:<11}", ink(standing_colour(standing)))  # type: ignore[arg-type]
            text.append(f"{meaning}\n", ink(INK))
        signs = "   ".join(f"{sign} {kind}" for kind, sign in MOMENT_SIGNS.items())
        text.append(f"On the time line\n  {signs}\n", ink(FAINT))
        text.append(
            "  The tick on a box is its front; a number alone is a system id, +3 three more without room.\n", ink(FAINT)
        )
        text.append("On the map\n", ink(ACCENT, bold=True))
        marks = [f"{mark} {standing_word(standing)}" for standing, mark in STANDING_MARKS.items()]
        for first in range(0, len(marks), MARKS_EACH):
            text.append("  " + "".join(f"{mark:<16}" for mark in marks[first : first + MARKS_EACH]) + "\n", ink(INK))
        text.append(
            f"  {UAV_MARK} UAV, {BOX_MARK} a box without a name, a line from a mark is its heading,\n", ink(FAINT)
        )
        text.append("  circles are 1σ, dots are the image's footprint.", ink(FAINT))
        return text
