"""The line in which a vehicle is found by its name or id; it takes the place of the key hints meanwhile."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widget import Widget
from textual.widgets import Input, Static

from gcs.tui.messages import VehiclePicked
from gcs.tui.palette import ACCENT, FAINT, PANEL, WARN, ink
from gcs.tui.panes.fleet import FleetPane
from gcs.tui.picking import Pick, found

HINT = "a vehicle's name or id; enter keeps it, esc goes back"
NONE_FOUND = "no vehicle of that name or id"


class FindLine(Horizontal):
    """Line that picks a vehicle while its name is typed, at every letter; it closes when it loses the focus.

    It is gone with the focus.

    Args:
        fleet: the table whose vehicles it finds.
        hints: hidden meanwhile.
        before: what was picked; escape, and a name that nobody has, go back to it.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "leave", "Back", id="find.back", tooltip="Close, and pick what was picked before"),
    ]
    DEFAULT_CSS = """
    FindLine { height: 1; width: 100%; background: $surface; }
    FindLine Static { width: auto; background: $surface; }
    FindLine Input { width: 1fr; background: $surface; }
    """

    def __init__(self, fleet: FleetPane, hints: Widget, before: Pick) -> None:
        super().__init__(id="find")
        self._fleet, self._hints, self._before = fleet, hints, before
        self._focused: Widget | None = None
        self._hint = Static(Text(HINT, ink(FAINT, PANEL)), markup=False)

    def compose(self) -> ComposeResult:
        """Key, what is typed, and what that is."""
        yield Static(Text(" / ", ink(ACCENT, PANEL, bold=True)), markup=False)
        yield Input(select_on_focus=False, compact=True)
        yield self._hint

    def on_mount(self) -> None:
        """Take the keys from the hints."""
        self._focused = self.screen.focused
        self._hints.display = False
        self.query_one(Input).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Pick whom this means."""
        words, snapshot = event.value.strip(), self._fleet.snapshot
        row = found(self._fleet.in_order(snapshot), words) if words and snapshot is not None else None
        nobody = bool(words) and row is None
        self._hint.update(Text(NONE_FOUND if nobody else HINT, ink(WARN if nobody else FAINT, PANEL)))
        self.post_message(VehiclePicked(*(self._before if row is None else (row.system_id, 0))))

    def on_input_submitted(self) -> None:
        """Keep what was found picked."""
        self.screen.set_focus(self._focused)

    def action_leave(self) -> None:
        """Go back to what was picked before."""
        self.post_message(VehiclePicked(*self._before))
        self.screen.set_focus(self._focused)

    def on_descendant_blur(self) -> None:
        """Give the keys back to the panes."""
        self._hints.display = True
        self.remove()
