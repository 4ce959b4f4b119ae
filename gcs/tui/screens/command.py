"""Ordering something of the UAV: choose from a list, confirm, and what becomes of it is an event."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from gcs.station import Commands
from gcs.tui.draw.format import plain
from gcs.tui.palette import ACCENT, FAINT, HEAD, INK, ink
from gcs.tui.screens.prompts import Confirm

__all__ = ["OrderList", "ask_for_order"]

LISTENS_ONLY = "this station listens only and sends nothing: start it with gcs fly --command to command the UAV"
RECORDING = "a recording takes no commands"


def ask_for_order(app: App[Any], commands: Commands | None, selected: int, *, live: bool) -> None:
    """Let the operator choose and confirm an order, then give it.

    Args:
        app: To show the questions.
        commands: None where nothing may be sent: then the operator is shown why.
        selected: System id of the selected vehicle, 0 for none; as it is when the list opens.
        live: Whether this is a flight.
    """
    if commands is None:
        app.notify(LISTENS_ONLY if live else RECORDING, severity="warning", timeout=6, markup=False)
        return
    orders = commands.orders(selected)

    def confirm(key: str | None) -> None:
        if key is not None:
            words = dict(orders)[key]
            app.push_screen(Confirm(words), lambda yes: submit(key) if yes else None)

    def submit(key: str) -> None:
        try:
            commands.submit(key, selected)
        except (KeyError, ValueError) as error:
            app.notify(plain(str(error)), severity="error", markup=False)

    app.push_screen(OrderList(orders), confirm)


class OrderList(ModalScreen[str | None]):
    """The orders, one a line; enter or a click chooses."""

    AUTO_FOCUS: ClassVar[str | None] = "OptionList"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,u,q", "cancel", "Cancel", id="orders.cancel", tooltip="Close without an order"),
        Binding("k", "move('up')", "Up", id="orders.up", tooltip="Order above", show=False),
        Binding("j", "move('down')", "Down", id="orders.down", tooltip="Order below", show=False),
    ]
    DEFAULT_CSS = """
    OrderList { align: center middle; background: $background 60%; }
    OrderList > Vertical { width: 72; max-width: 100%; height: auto; max-height: 100%; padding: 0 2; }
    OrderList > Vertical { background: $panel; }
    OrderList Static { background: $panel; }
    OrderList OptionList { height: auto; max-height: 100%; border: none; padding: 0; background: $surface; }
    OrderList OptionList > .option-list--option-highlighted { background: $block-cursor-background; }
    """

    def __init__(self, orders: Sequence[tuple[str, str]]) -> None:
        """Show orders.

        Args:
            orders: Keys and words.
        """
        super().__init__()
        self._orders = tuple(orders)

    def compose(self) -> ComposeResult:
        """A heading over the list."""
        with Vertical():
            yield Static(Text("Command the UAV", ink(ACCENT, HEAD, bold=True)), markup=False)
            yield OptionList(
                *(Option(Text(plain(words), ink(INK)), id=key) for key, words in self._orders), markup=False
            )
            yield Static(
                Text("enter chooses, asked once more before it is sent; esc closes", ink(FAINT, HEAD)), markup=False
            )

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Hand the order over."""
        self.dismiss(event.option.id)

    def action_move(self, way: str) -> None:
        """Move through the list."""
        orders = self.query_one(OptionList)
        orders.action_cursor_up() if way == "up" else orders.action_cursor_down()

    def action_cancel(self) -> None:
        """No order."""
        self.dismiss(None)
