"""The timeline of a replay: play state, position, UTC, speed, a bar of what happened, and how sure a name was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from textual import events
from textual.reactive import reactive
from textual.strip import Strip

from gcs.certainty import CONFIRMED
from gcs.snapshot import Event
from gcs.station import Gap, Timeline
from gcs.tui.draw.format import clock, duration
from gcs.tui.draw.moments import NOT_ANALYSED, SIGNS, Moment, cell_of, cells_of
from gcs.tui.draw.strips import Part, blank, clickable, fitted, line, width_of
from gcs.tui.kept_lines import KeptLines, PlainLines
from gcs.tui.messages import SeekTo
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, GOOD, HEAD, INK, LINE, WARN, ink
from gcs.tui.themes import Colour
from infra.plain_text import plain

State = tuple[int, int, int, bool, float]
"""Start, stop, now, playing, speed."""
Spans = tuple[tuple[int, int], ...]
"""First and last moment of each part of a recording."""
SHORTEST: Final = 8
"""Least length of a bar, cells; a shorter one is left out."""
ROOMY_ROWS: Final = 30
"""Rows of a screen that has one to spare for the confidence of the picked vehicle."""
LEVELS: Final = "▁▂▃▄▅▆▇█"
MAX_BEHIND_US: Final = 2_000_000
"""Most that the screen may be away from the time that is told, at normal speed, before that is marked."""


class TimelineBar(KeptLines, PlainLines):
    """Bar of a replay's time in one row, with a second row while a vehicle is picked; a click seeks."""

    ALLOW_SELECT: ClassVar[bool] = False
    state: reactive[State] = reactive((0, 0, 0, False, 1.0))
    analysed: reactive[Spans] = reactive(())
    marks: reactive[tuple[Event, ...]] = reactive((), always_update=True)
    gaps: reactive[tuple[Gap, ...]] = reactive(())
    is_behind: reactive[bool] = reactive(False)
    """True while the screen shows another moment than the one told: so it is after a jump that takes its time."""
    jumps: reactive[str] = reactive("")
    """Events that the keys jump between, empty for the events of the log."""
    picked: reactive[tuple[str, bytes]] = reactive(("", b""))
    """Name of the picked vehicle and its confidence over the recording, as float32; both empty without one."""

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._look: tuple[int, int, int] | None = None
        """Inputs that the cells were worked out for, None: other events or gaps came."""
        self._cells: list[Moment | None] = []

    def show(
        self,
        timeline: Timeline,
        events: Sequence[Event],
        system_id: int = 0,
        name: str = "",
        shown_us: int | None = None,
    ) -> None:
        """Take the timeline's state; repaints only when something differs.

        Args:
            timeline: of the replay.
            events: of all of it, as far as it is analysed.
            system_id: of the picked vehicle, 0 none.
            name: its name.
            shown_us: Moment that the panes show, Unix µs, None for none.
        """
        away_us = 0 if shown_us is None else abs(timeline.now_us - shown_us)
        self.is_behind = away_us > MAX_BEHIND_US * max(1.0, timeline.speed)
        self.state = (timeline.start_us, timeline.stop_us, timeline.now_us, timeline.playing, timeline.speed)
        self.analysed = tuple(timeline.analysed)
        self.gaps = tuple(timeline.gaps)
        if (marks := tuple(events)) != self.marks:
            self.marks = marks
        strip = bool(system_id) and self.app.size.height >= ROOMY_ROWS
        self.picked = (plain(name), timeline.confidence(system_id).tobytes()) if strip else ("", b"")

    def watch_marks(self) -> None:
        """Draw again when something happened."""
        self._look = None

    def watch_gaps(self) -> None:
        """Draw again when gaps were found."""
        self._look = None

    def watch_picked(self, before: tuple[str, bytes], picked: tuple[str, bytes]) -> None:
        """Show a second row while a vehicle is picked."""
        if bool(before[1]) != bool(picked[1]):
            self.styles.height = 2 if picked[1] else 1

    def render_line(self, y: int) -> Strip:
        """The bar between clock and speed; below it the confidence over the same cells."""
        left, right = self._left(), self._right()
        width = self.size.width
        length = width - width_of(left) - width_of(right)
        if y == 0:
            return line([*left, *(self._track(length) if length >= SHORTEST else []), *right], width, HEAD)
        if length < SHORTEST or not self.picked[1]:
            return blank(width, HEAD)
        name = fitted(f" {self.picked[0]}", width_of(left) - 1)
        confidence = np.frombuffer(self.picked[1], dtype=np.float32)
        return line([(f"{name} ", ink(BRIGHT, HEAD)), *_confidence_parts(confidence, length)], width, HEAD)

    def _left(self) -> list[Part]:
        start_us, stop_us, now_us, playing, _ = self.state
        total = duration((stop_us - start_us) / 1e6)
        now = duration((now_us - start_us) / 1e6)
        mark = ("► play ", ink(ACCENT, HEAD, bold=True)) if playing else ("║ pause", ink(INK, HEAD, bold=True))
        mark = clickable(mark, "app.toggle_play")
        return [(" ", ink(INK, HEAD)), mark, (f" {now}", ink(BRIGHT, HEAD)), (f"/{total} ", ink(FAINT, HEAD))]

    def _right(self) -> list[Part]:
        _, _, now_us, _, speed = self.state
        parts = [
            (
                f"{'…' if self.is_behind else ' '}{clock(now_us, tenths=self.size.width >= 100)}",
                ink(WARN if self.is_behind else INK, HEAD),
            ),
            clickable((f" ×{speed:g} ", ink(ACCENT, HEAD)), "app.speed(1)"),
        ]
        return [*parts, (f"np {self.jumps} ", ink(FAINT, HEAD))] if self.jumps else parts

    def _track(self, length: int) -> list[Part]:
        start_us, stop_us, now_us, _, _ = self.state
        at = cell_of(now_us, start_us, stop_us, length)
        letters = [("━", ACCENT) if column < at else ("─", LINE) for column in range(length)]
        for column in self._columns_not_analysed(length):
            letters[column] = (NOT_ANALYSED, FAINT)
        moments = self._moments(length)
        for column, moment in enumerate(moments):
            if moment is not None:
                letters[column] = (SIGNS[moment], _colour(moment))
        here = moments[at]
        letters[at] = ("●", BRIGHT if here is None else _colour(here))
        return [(letter, ink(colour, HEAD)) for letter, colour in _joined(letters)]

    def _moments(self, length: int) -> list[Moment | None]:
        """Moments that cells mark; kept while nothing new happened, for a long recording has thousands of events."""
        look = (*self.state[:2], length)
        if look != self._look:
            self._look, self._cells = look, cells_of(self.marks, self.gaps, *look)
        return self._cells

    def _columns_not_analysed(self, length: int) -> set[int]:
        start_us, stop_us, *_ = self.state
        columns = set(range(length))
        for first_us, last_us in self.analysed:
            first, last = (cell_of(t_us, start_us, stop_us, length) for t_us in (first_us, last_us))
            columns -= set(range(first, last + 1))
        return columns

    def on_click(self, event: events.Click) -> None:
        """Seek to the time under the pointer."""
        start_us, stop_us, *_ = self.state
        first, last = width_of(self._left()), self.size.width - width_of(self._right())
        if first <= event.x < last:
            share = (event.x - first) / max(1, last - first - 1)
            self.post_message(SeekTo(start_us + round(share * (stop_us - start_us))))


def _colour(moment: Moment) -> Colour:
    return {"identity": INK, "warning": WARN, "gap": WARN, "mark": ACCENT, "alarm": ALARM}[moment]


def _confidence_parts(confidence: NDArray[np.float32], length: int) -> list[Part]:
    """A cell is as high as the least confidence in it: a space without a name, dotted where nothing is known yet."""
    starts = np.linspace(0, len(confidence), length, endpoint=False).astype(int)
    cells = np.fmin.reduceat(confidence, starts).tolist()
    letters: list[tuple[str, Colour]] = []
    for least in cells:
        if least != least:
            letters.append((NOT_ANALYSED, FAINT))
        elif least <= 0.0:
            letters.append((" ", FAINT))
        else:
            level = LEVELS[min(int(least * len(LEVELS)), len(LEVELS) - 1)]
            letters.append((level, GOOD if least >= CONFIRMED else WARN))
    return [(letter, ink(colour, HEAD)) for letter, colour in _joined(letters)]


def _joined(letters: Sequence[tuple[str, Colour]]) -> list[tuple[str, Colour]]:
    joined: list[tuple[str, Colour]] = []
    for letter, colour in letters:
        if joined and joined[-1][1] == colour:
            joined[-1] = (joined[-1][0] + letter, colour)
        else:
            joined.append((letter, colour))
    return joined
