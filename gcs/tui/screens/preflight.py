"""The list before take-off, live: what is well, and what to do about the rest."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from gcs.health.preflight import Check, Verdict, preflight
from gcs.station import Station
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, GOOD, INK, WARN, ink
from gcs.tui.themes import Colour
from infra.plain_text import plain

EVERY_S = 0.5
_MARKS: dict[Verdict, tuple[str, Colour]] = {"ok": ("✓", GOOD), "short": ("!", WARN), "bad": ("✗", ALARM)}


class PreflightScreen(ModalScreen[None]):
    """Goes through what the flight needs, twice a second; any of its keys closes it."""

    AUTO_FOCUS: ClassVar[str | None] = "VerticalScroll"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,p", "close", "Close", id="preflight.close", tooltip="Close the list"),
    ]
    DEFAULT_CSS = """
    PreflightScreen { align: center middle; background: $background 60%; }
    PreflightScreen > VerticalScroll { width: 96; max-width: 100%; height: auto; max-height: 100%; padding: 0 2; }
    PreflightScreen > VerticalScroll { background: $panel; }
    PreflightScreen Static { background: $panel; }
    """

    def __init__(self, station: Station) -> None:
        super().__init__()
        self._station = station
        self._list = Static(markup=False)

    def compose(self) -> ComposeResult:
        """Yield one text, as long as it is."""
        with VerticalScroll():
            yield self._list

    def on_mount(self) -> None:
        """Look again and again."""
        self._look()
        self.set_interval(EVERY_S, self._look)

    def action_close(self) -> None:
        """Back to the flight."""
        self.dismiss()

    def _look(self) -> None:
        now = self._station.latest()
        checks = preflight(now, self._station.rates()) if now is not None else ()
        self._list.update(_text(checks))


def _text(checks: tuple[Check, ...]) -> Text:
    """The worst first of what is not well, then what is."""
    wrong = [check for check in checks if check.verdict != "ok"]
    standing = "ready to fly" if checks and not wrong else f"{len(wrong)} of {len(checks)} need something"
    text = Text()
    text.append(f"Before take-off: {standing if checks else 'nothing is known yet'}\n", ink(ACCENT, bold=True))
    for check in sorted(checks, key=lambda check: ("bad", "short", "ok").index(check.verdict)):
        mark, colour = _MARKS[check.verdict]
        text.append(f"{mark} ", ink(colour, bold=True))
        text.append(f"{plain(check.name)}  ", ink(BRIGHT))
        text.append(f"{plain(check.found)}\n", ink(INK))
        if check.advice:
            text.append(f"    → {plain(check.advice)}\n", ink(INK))
    text.append("p or esc closes", ink(FAINT))
    return text
