"""Ordering something of the UAV: choose from a list, confirm, and what becomes of it is an event."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from textual.app import App
from textual.binding import Binding, BindingType

from gcs.station import Commands
from gcs.tui.screens.choice import ChoiceList
from gcs.tui.screens.prompts import Confirm
from infra.plain_text import plain

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


class OrderList(ChoiceList):
    """The orders, one a line."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,u,q", "cancel", "Cancel", id="orders.cancel", tooltip="Close without an order"),
    ]

    def __init__(self, orders: Sequence[tuple[str, str]]) -> None:
        """Show orders.

        Args:
            orders: Keys and words.
        """
        super().__init__("Command the UAV", orders, "enter chooses, asked once more before it is sent; esc closes")
