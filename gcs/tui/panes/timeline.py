"""The timeline of a replay: play state, position, total, UTC, speed, and a bar with the marks of events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual import events
from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from gcs.snapshot import Event
from gcs.station import Timeline
from gcs.tui.draw.format import clock, duration
from gcs.tui.draw.strips import Part, line, width_of
from gcs.tui.messages import SeekTo
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, HEAD, INK, LINE, Colour, ink, level_colour

__all__ = ["TimelineBar"]

State = tuple[int, int, int, bool, float]
"""Start, stop, now, playing, speed."""
Spans = tuple[tuple[int, int], ...]
"""First and last moment of each part of a recording."""
NOT_ANALYSED = "┄"


class TimelineBar(Widget):
    """One row; a click seeks."""

    ALLOW_SELECT: ClassVar[bool] = False
    state: reactive[State] = reactive((0, 0, 0, False, 1.0))
    analysed: reactive[Spans] = reactive(())
    marks: reactive[tuple[Event, ...]] = reactive((), always_update=True)

    def show(self, timeline: Timeline, events: Sequence[Event]) -> None:
        """Take the timeline's state; repaints only when something differs."""
        self.state = (timeline.start_us, timeline.stop_us, timeline.now_us, timeline.playing, timeline.speed)
        self.analysed = tuple(timeline.analysed)
        if len(events) != len(self.marks) or (events and events[-1] is not self.marks[-1]):
            self.marks = tuple(events)

    def render_line(self, y: int) -> Strip:
        """The bar between clock and speed."""
        left, right = self._left(), self._right()
        width = self.size.width
        length = width - width_of(left) - width_of(right)
        track = self._track(length) if length >= 8 else []
        return line([*left, *track, *right], width, HEAD)

    def _left(self) -> list[Part]:
        start_us, stop_us, now_us, playing, _ = self.state
        total = duration((stop_us - start_us) / 1e6)
        now = duration((now_us - start_us) / 1e6)
        mark = ("► play ", ink(ACCENT, HEAD, bold=True)) if playing else ("║ pause", ink(INK, HEAD, bold=True))
        return [(" ", ink(INK, HEAD)), mark, (f" {now}", ink(BRIGHT, HEAD)), (f"/{total} ", ink(FAINT, HEAD))]

    def _right(self) -> list[Part]:
        _, _, now_us, _, speed = self.state
        return [
            (f" {clock(now_us, tenths=self.size.width >= 100)}", ink(INK, HEAD)),
            (f" ×{speed:g} ", ink(ACCENT, HEAD)),
        ]

    def _track(self, length: int) -> list[Part]:
        start_us, stop_us, now_us, _, _ = self.state
        at = _column(now_us, start_us, stop_us, length)
        letters = [("━", ACCENT) if column < at else ("─", LINE) for column in range(length)]
        for column in self._columns_not_analysed(length):
            letters[column] = (NOT_ANALYSED, FAINT)
        for event in sorted(self.marks, key=lambda event: event.level == "alarm"):
            if start_us <= event.t_us <= stop_us and event.level != "info":
                letters[_column(event.t_us, start_us, stop_us, length)] = ("╹", level_colour(event.level))
        letters[at] = ("●", BRIGHT)
        return [(letter, ink(colour, HEAD)) for letter, colour in _joined(letters)]

    def _columns_not_analysed(self, length: int) -> set[int]:
        start_us, stop_us, *_ = self.state
        columns = set(range(length))
        for first_us, last_us in self.analysed:
            first, last = (_column(t_us, start_us, stop_us, length) for t_us in (first_us, last_us))
            columns -= set(range(first, last + 1))
        return columns

    def on_click(self, event: events.Click) -> None:
        """Seek to the time under the pointer."""
        start_us, stop_us, *_ = self.state
        first, last = width_of(self._left()), self.size.width - width_of(self._right())
        if first <= event.x < last:
            share = (event.x - first) / max(1, last - first - 1)
            self.post_message(SeekTo(start_us + round(share * (stop_us - start_us))))


def _column(t_us: int, start_us: int, stop_us: int, length: int) -> int:
    share = (t_us - start_us) / max(1, stop_us - start_us)
    return round(min(max(share, 0.0), 1.0) * (length - 1))


def _joined(letters: Sequence[tuple[str, Colour]]) -> list[tuple[str, Colour]]:
    joined: list[tuple[str, Colour]] = []
    for letter, colour in letters:
        if joined and joined[-1][1] == colour:
            joined[-1] = (joined[-1][0] + letter, colour)
        else:
            joined.append((letter, colour))
    return joined
