from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.reactive import reactive
from textual.screen import UPDATE_PERIOD, Screen
from textual.strip import Strip
from textual.widget import Widget

from gcs.tui.terminal.terminal_app import EagerScreen


class _Counter(Widget):
    count: reactive[int] = reactive(0)
    shown = -1

    def render_line(self, y: int) -> Strip:
        self.shown = self.count
        return super().render_line(y)


class _Counting(App[None]):
    BINDINGS: ClassVar[list[BindingType]] = [("a", "add", "add")]

    def get_default_screen(self) -> Screen[None]:
        return EagerScreen(id="_default")

    def compose(self) -> ComposeResult:
        yield _Counter()

    def action_add(self) -> None:
        self.query_one(_Counter).count += 1


async def test_a_key_shows_without_a_tick_of_the_clock_but_not_twice_in_one_of_its_periods(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr("gcs.tui.terminal.terminal_app.time", SimpleNamespace(monotonic=lambda: now_s[0]))
    app = _Counting()
    async with app.run_test() as pilot:
        await pilot.pause(2 * UPDATE_PERIOD)
        counter = app.query_one(_Counter)
        assert counter.shown == 0
        monkeypatch.setattr(app.screen._update_timer, "resume", lambda: None)
        now_s[0] += 1.0
        await pilot.press("a")
        assert counter.shown == 1
        await pilot.press("a")
        assert counter.shown == 1  # as soon as that would be drawn by the clock
        now_s[0] += 2 * UPDATE_PERIOD
        await pilot.press("a")
        assert counter.shown >= 2
