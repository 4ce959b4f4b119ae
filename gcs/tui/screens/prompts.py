"""Modal prompts: an answer typed in one line, such as a time or a file name, and a question to confirm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from gcs.snapshot import Snapshot
from gcs.station import Station
from gcs.tui.palette import ACCENT, ALARM, FAINT, HEAD, ink
from infra.plain_text import plain

Answer = TypeVar("Answer")

NO_RIVAL = "only one sender's video comes"


class Prompt(ModalScreen[Answer | None]):
    """Asks for one line until it can be parsed; None after escape."""

    AUTO_FOCUS: ClassVar[str | None] = "Input"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "cancel", "Cancel", id="ask.cancel", tooltip="Close without an answer"),
    ]

    def __init__(self, question: str, hint: str, parse: Callable[[str], Answer], *, value: str = "") -> None:
        """Make a prompt."""
        super().__init__()
        self._question, self._hint, self._parse, self._value = question, hint, parse, value

    def compose(self) -> ComposeResult:
        """Question, answer, hint."""
        with Vertical(id="ask"):
            yield Static(Text(self._question, ink(ACCENT, HEAD, bold=True)), markup=False)
            yield Input(self._value, id="answer", select_on_focus=False, compact=True)
            yield Static(Text(self._hint, ink(FAINT, HEAD)), id="hint", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the parsed answer, or show why it was refused."""
        try:
            answer = self._parse(event.value)
        except (ValueError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            self.query_one("#hint", Static).update(Text(plain(reason), ink(ALARM, HEAD)))
            return
        self.dismiss(answer)

    def action_cancel(self) -> None:
        """Close without an answer."""
        self.dismiss(None)


class Confirm(ModalScreen[bool]):
    """Asks yes or no. Only y confirms: the key that opened the question must not answer it too."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)", "Yes", id="confirm.yes", tooltip="Do it"),
        Binding("n,escape,q", "answer(False)", "No", id="confirm.no", tooltip="Leave it"),
    ]
    DEFAULT_CSS = """
    Confirm { align: center middle; background: $background 60%; }
    Confirm > Vertical { width: 64; max-width: 100%; height: auto; padding: 1 2; background: $panel; }
    Confirm Static { background: $panel; }
    """

    def __init__(self, question: str) -> None:
        """Make a question.

        Args:
            question: One line, plain text.
        """
        super().__init__()
        self._question = question

    def compose(self) -> ComposeResult:
        """Question and keys."""
        with Vertical():
            yield Static(Text(f"{plain(self._question)}?", ink(ACCENT, HEAD, bold=True)), markup=False)
            yield Static(Text("y yes   n no", ink(FAINT, HEAD)), markup=False)

    def action_answer(self, yes: bool) -> None:
        """Close with the answer."""
        self.dismiss(yes)


def ask_for_rival_video(app: App[Any], station: Station, snapshot: Snapshot | None) -> None:
    """Let the operator take the other video where two senders contest its port; both addresses are asked about."""
    health = snapshot.health if snapshot else None
    if health is None or not health.video_rival:
        app.notify(NO_RIVAL, severity="warning", timeout=6, markup=False)
        return

    def take(yes: bool | None) -> None:
        if yes:
            station.take_rival_video()

    app.push_screen(Confirm(f"Take the video of {health.video_rival} instead of {health.video_sender}"), take)
