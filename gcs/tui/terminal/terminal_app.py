"""An app on our driver: what it draws goes out as the terminal takes it, and pictures wait for their turn."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rich.console import RenderableType
from textual._compositor import CompositorUpdate
from textual.app import App
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.drivers.web_driver import WebDriver
from textual.filter import ANSIToTruecolor, LineFilter
from textual.screen import UPDATE_PERIOD, Screen

from gcs.tui import palette
from gcs.tui.draw.pixels import depth_of
from gcs.tui.draw.terminal_kind import has_terminal
from gcs.tui.kept_lines import KeptLines
from gcs.tui.terminal.driver import TerminalDriver
from gcs.tui.themes import THEMES, ThemeName, next_theme, textual_theme

MAX_FPS = 12.0
"""Pictures a second that are drawn at most, on any terminal."""


class _BrowserDriver(WebDriver):
    """Writes one message after the other, where Textual's lets them cross once one is larger than a pipe takes."""

    def __init__(self, app: App[Any], **options: Any) -> None:  # noqa: ANN401  (Textual's own)
        super().__init__(app, **options)
        self._writing = threading.Lock()
        self._write = partial(self._write_whole)

    def _write_whole(self, data: bytes) -> int:
        size = len(data)
        with self._writing:
            while data:
                data = data[os.write(self.fileno, data) :]
        return size


class EagerScreen(KeptLines, Screen[None]):
    """Draws as soon as all who changed have said so, at most as often as Textual does.

    Textual waits for the next tick of a clock of 60 Hz: 8 ms of the time from a key to the screen, and more than the
    drawing itself.
    """

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._drawn_s = 0.0

    def on_idle(self) -> None:
        """Draw at once after a rest, for which the clock need not be waited for; Textual's own handler, which starts
        it, comes after this."""
        now_s = time.monotonic()
        if now_s - self._drawn_s >= UPDATE_PERIOD and (self._dirty_widgets or self._layout_required):
            self._drawn_s = now_s
            self._on_timer_update()


class TerminalApp(App[None]):
    """Base of both apps: how they reach the terminal, and in which colours."""

    def __init__(self, fps: float = MAX_FPS, theme: ThemeName = "dark") -> None:
        super().__init__()
        palette.use_depth(depth_of(self.colours))
        for each in THEMES.values():
            self.register_theme(textual_theme(each))
        self.theme = theme
        self._fps = fps
        self._picture_due_s = 0.0
        self.to_end: Callable[[], bool] = lambda: False
        """Asked by the app's own polls whether to end as if the operator had quit."""
        self.hung_up: Callable[[], bool] = lambda: False
        """Asked by the driver's thread whether to end as if the terminal were gone."""

    @property
    def colours(self) -> str | None:
        """Rich's word for how many colours the terminal has."""
        return self.console.color_system if has_terminal() else "truecolor"

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return the filters without the one for the palette: all colours here are the terminal's own, and it costs
        more than the video."""
        return [each for each in super().get_line_filters() if not isinstance(each, ANSIToTruecolor)]

    def action_next_theme(self) -> None:
        """Change to the next theme."""
        self.theme = next_theme(self.theme)
        self.notify(f"theme: {self.theme}", timeout=2, markup=False)

    def watch_theme(self, theme: str) -> None:
        """Change all colours to those of a theme."""
        palette.use_theme(theme)
        for widget in self.screen_stack[0].query("*") if self.screen_stack else ():
            getattr(widget, "redraw", widget.refresh)()

    def get_default_screen(self) -> Screen[None]:
        """Return a screen that does not wait for a clock."""
        return EagerScreen(id="_default")

    def get_driver_class(self) -> type[Driver]:
        """Ours instead of Textual's for terminals and browsers."""
        usual = super().get_driver_class()
        return {LinuxDriver: TerminalDriver, WebDriver: _BrowserDriver}.get(usual, usual)

    def picture_waits(self) -> bool:
        """Tell whether the terminal does not have the last pictures yet, or has had as many as ``fps`` allows.

        To be asked ``MAX_FPS`` times a second; a picture may be drawn whenever the answer is no.
        """
        now_s = time.monotonic()
        if now_s < self._picture_due_s or (isinstance(self._driver, TerminalDriver) and self._driver.has_picture):
            return True
        # who asks is not punctual to the millisecond
        self._picture_due_s = now_s + 1 / self._fps - 0.5 / MAX_FPS if self._fps < MAX_FPS else now_s
        return False

    def _display(self, screen: Screen[object], renderable: RenderableType | None) -> None:
        """Hand what was drawn to our driver, instead of writing all of it."""
        if not isinstance(self._driver, TerminalDriver) or not isinstance(renderable, CompositorUpdate):
            super()._display(screen, renderable)
        elif self._running and not self._closed and not self._batch_count:
            self._driver.show(renderable, self.screen.outer_size.clamp_offset(self.cursor_position))
