"""Leaving the screens of a flight: asked first, since it ends the flight."""

from __future__ import annotations

from typing import ClassVar, Literal

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

from gcs.tui.palette import ACCENT, FAINT, HEAD, INK, ink

Leave = Literal["end", "screen", "stay"]
"""End the flight, leave its screen only, or neither."""


class LeaveFlight(ModalScreen[Leave]):
    """Asks what ``q`` is to end; a second ``q`` ends the flight."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y,q,ctrl+q", "answer('end')", "End", id="leave.end", tooltip="End the flight and seal the recording"),
        Binding("l", "answer('screen')", "Leave", id="leave.screen", tooltip="Leave the screen; the flight goes on"),
        Binding("n,escape", "answer('stay')", "Stay", id="leave.stay", tooltip="Stay"),
    ]
    DEFAULT_CSS = """
    LeaveFlight { align: center middle; background: $background 60%; }
    LeaveFlight > Vertical { width: 64; max-width: 100%; height: auto; padding: 1 2; background: $panel; }
    LeaveFlight Static { background: $panel; }
    """

    def compose(self) -> ComposeResult:
        """Question and keys."""
        with Vertical():
            yield Static(Text("End the flight and seal the recording?", ink(ACCENT, HEAD, bold=True)), markup=False)
            yield Static(Text("y or q   end the flight and seal the recording", ink(INK, HEAD)), markup=False)
            yield Static(
                Text(
                    "l        leave the screen: the flight goes on, and\n         gcs fly --attach shows it again",
                    ink(INK, HEAD),
                ),
                markup=False,
            )
            yield Static(Text("n        stay", ink(FAINT, HEAD)), markup=False)

    def action_answer(self, answer: Leave) -> None:
        """Close with the answer."""
        self.dismiss(answer)
