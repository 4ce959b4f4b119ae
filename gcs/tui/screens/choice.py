"""A list to choose one from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from gcs.tui.palette import ACCENT, FAINT, HEAD, INK, ink
from infra.plain_text import plain


class ChoiceList(ModalScreen[str | None]):
    """Choices, one a line; enter or a click chooses, None after escape."""

    AUTO_FOCUS: ClassVar[str | None] = "OptionList"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q", "cancel", "Cancel", id="choice.cancel", tooltip="Close without a choice"),
        Binding("k", "move('up')", "Up", id="choice.up", tooltip="Choice above", show=False),
        Binding("j", "move('down')", "Down", id="choice.down", tooltip="Choice below", show=False),
    ]
    DEFAULT_CSS = """
    ChoiceList { align: center middle; background: $background 60%; }
    ChoiceList > Vertical { width: 72; max-width: 100%; height: auto; max-height: 100%; padding: 0 2; }
    ChoiceList > Vertical { background: $panel; }
    ChoiceList Static { background: $panel; }
    ChoiceList OptionList { height: auto; max-height: 90%; border: none; padding: 0; background: $surface; }
    ChoiceList OptionList:focus { border: none; }
    ChoiceList OptionList > .option-list--option-highlighted { background: $block-cursor-background; }
    """

    def __init__(self, title: str, choices: Sequence[tuple[str, str]], hint: str) -> None:
        """Make a list."""
        super().__init__()
        self._title, self._choices, self._hint = title, tuple(choices), hint

    def compose(self) -> ComposeResult:
        """Yield a heading and the list."""
        with Vertical():
            yield Static(Text(plain(self._title), ink(ACCENT, HEAD, bold=True)), markup=False)
            yield OptionList(
                *(Option(Text(plain(words), ink(INK)), id=key) for key, words in self._choices), markup=False
            )
            yield Static(Text(self._hint, ink(FAINT, HEAD)), markup=False)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Hand the choice over."""
        self.dismiss(event.option.id)

    def action_move(self, way: str) -> None:
        """Move through the list."""
        choices = self.query_one(OptionList)
        choices.action_cursor_up() if way == "up" else choices.action_cursor_down()

    def action_cancel(self) -> None:
        """Close without a choice."""
        self.dismiss(None)
