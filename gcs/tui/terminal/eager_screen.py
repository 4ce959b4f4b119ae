"""A screen that draws at once what a key changed."""

from __future__ import annotations

from time import monotonic

from textual.screen import UPDATE_PERIOD, Screen


class EagerScreen(Screen[None]):
    """Draws as soon as all who changed have said so, at most as often as Textual does.

    Textual waits for the next tick of a clock of 60 Hz: 8 ms of the time from a key to the screen, and more than the
    drawing itself.
    """

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._drawn_s = 0.0

    def on_idle(self) -> None:
        """After a rest the clock need not be waited for; Textual's own handler, which starts it, comes after this."""
        now_s = monotonic()
        if now_s - self._drawn_s >= UPDATE_PERIOD and (self._dirty_widgets or self._layout_required):
            self._drawn_s = now_s
            self._on_timer_update()
