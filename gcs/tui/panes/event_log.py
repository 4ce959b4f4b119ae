"""The event log: newest at the bottom, filtered by level and words, bounded, plain text only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Final

from textual import events
from textual.binding import Binding, BindingType
from textual.reactive import reactive
from textual.strip import Strip

from gcs.report.vehicle_names import text_with_sender
from gcs.snapshot import Event, Snapshot
from gcs.tui.draw.event_rows import EventRow, found_events, rows_of
from gcs.tui.draw.format import REPORTED_WORDS, clock
from gcs.tui.draw.strips import Part, cut_between_words, fitted, folded, line, width_of
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, HEAD, WARN, ink, level_colour
from gcs.tui.panes.alarms import is_final
from gcs.tui.panes.pane import Pane
from infra.plain_text import plain
from mavlink.state import Level

FILTERS: Final[tuple[Level, ...]] = ("info", "warning", "alarm")
LEVEL_LABELS: Final = {"info": "all", "warning": "warnings", "alarm": "alarms"}
MARKS: Final = {"info": "  ", "warning": "! ", "alarm": "!!"}
MAX_EVENTS: Final = 2000
GLYPHS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "link": "⇄",
        "vehicle": "▪",
        "camera": "◎",
        "text": "”",
        "identity": "=",
        "video": "▸",
        "recording": "●",
        "operator": "›",
        "mark": "▼",
        "program": "§",
    }
)
"""One for each kind of event, before its word where there is room for that."""
KIND_FROM, HOUR_FROM = 76, 50
"""Narrower logs have no word for the kind, and ``:20:00`` alone of a time: without the colon it would be another."""
LONGEST_ROWS: Final = 2
"""Rows that an event takes at most without the focus."""
ROOMY: Final = 6
"""Rows from which on a log has room for what is routine."""
UNTIL_HERE: Final = " ┄ from here as flown, not analysed"


def events_from(events: Sequence[Event], least: Level) -> list[Event]:
    """Events of at least a level."""
    rank = FILTERS.index(least)
    return [event for event in events if _rank(event.level) >= rank]


def _text(event: Event, snapshot: Snapshot | None) -> str:
    return event.text if snapshot is None else text_with_sender(event, snapshot.name_of)


def _in_rows(text: str, room: int, names: Sequence[str]) -> tuple[str, str]:
    """A text's first row, and what of it goes into a second one, so that what it is about is not cut away."""
    first, *more = folded(text, room, names)
    return first, text.lstrip()[len(first) :].lstrip() if more else ""


def _rank(level: str) -> int:
    return FILTERS.index(level) if level in FILTERS else 0


class EventPane(Pane):
    """Events; scrolls when focused, else follows the newest; in a replay, the newest before the frame."""

    label: ClassVar[str] = "EVENTS"
    FOCUS_ON_CLICK = False  # rows unfold with the focus, and another one would be under the pointer
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "scroll_by(1)", "Older", id="events.up", show=False, tooltip="Scroll the event log up"),
        Binding("down,j", "scroll_by(-1)", "Newer", id="events.down", show=False, tooltip="Scroll the event log down"),
        Binding("pageup", "scroll_by(10)", "Older", id="events.pageup", show=False, tooltip="Scroll ten events up"),
        Binding("pagedown", "scroll_by(-10)", "Newer", id="events.pagedown", show=False, tooltip="Scroll ten down"),
        Binding("slash", "app.search", "Search", id="events.search", show=False, tooltip="Search; esc ends it"),
    ]

    all_events: reactive[tuple[Event, ...]] = reactive((), always_update=True, repaint=False)
    least: reactive[Level] = reactive("info", repaint=False)
    words: reactive[str] = reactive("", repaint=False)
    """Words that all events on screen have."""
    now_us: reactive[int] = reactive(0, repaint=False)
    """Place of a replay, Unix µs, where that is what the screen shows; what happened since its frame is past, too."""

    def __init__(self, *, id: str, live: bool = True) -> None:
        super().__init__(id=id)
        self._live = live
        self._back = 0
        self._look: tuple[list[Event], str, str] = ([], "", "")
        """Source of the rows: events, level, words."""
        self._shown: list[EventRow] = []
        self._redrawn: tuple[list[EventRow] | None, list[str]] = None, []
        """Rows and vehicles' names that a snapshot last redrew the pane for."""
        self._kept: dict[tuple[EventRow, bool], list[Strip]] = {}
        """Rows by what they tell and whether of the picked vehicle: a pick changes few, and is to show soon."""
        self._kept_for: object = None
        """Width, focus, names and colours that these are for."""

    def filtered(self, events: Sequence[Event]) -> list[Event]:
        """Events of the filter's levels that have the words of the search."""
        found = events_from(events, self.least)
        if not self.words:
            return found
        names = {row.system_id: plain(row.name) for row in self.snapshot.vehicles} if self.snapshot else {}
        return found_events(found, self.words, names)

    def shown(self) -> list[EventRow]:
        """Rows that may be on screen: not of a replay's future, of the newest few thousand events."""
        until_us = None if self._live or self.snapshot is None else max(self.snapshot.now_us, self.now_us)
        past = [event for event in self.all_events if until_us is None or event.t_us <= until_us]
        look = (past[-MAX_EVENTS:], self.least, self.words)
        if look != self._look:  # to search and fold takes longer than to draw
            self._look, self._shown = look, rows_of(self.filtered(look[0]))
        return self._shown

    def next_filter(self) -> None:
        """Go on to the next filter: all, warnings and alarms, alarms only, all …"""
        self.least = FILTERS[(FILTERS.index(self.least) + 1) % len(FILTERS)]

    def action_scroll_by(self, rows: int) -> None:
        """Older (positive) or newer."""
        shown = self.shown()
        self._back = min(max(self._back + rows, 0), self._room(shown, self.size.width, self.size.height - 1))
        self.redraw()

    def watch_all_events(self) -> None:
        """Draw again when something happened."""
        self.redraw()

    def watch_least(self) -> None:
        """Go to the newest event when the filter changes."""
        self._back = 0
        self.redraw()

    def watch_words(self) -> None:
        """Go to the newest event when the search changes."""
        self._back = 0
        self.redraw()

    def watch_now_us(self) -> None:
        """Draw again when something has become past."""
        self.watch_snapshot()

    def watch_snapshot(self) -> None:
        """A flight's log changes with its events alone, a replay's also with which of them are past."""
        if self._live:
            return
        names = [row.name for row in self.snapshot.vehicles] if self.snapshot else []
        shown = self.shown()  # the same list as long as nothing in it changed
        if shown is not self._redrawn[0] or names != self._redrawn[1]:
            self._redrawn = (shown if self.display else None), names  # a hidden pane is not drawn
            self.redraw()

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Older."""
        self.action_scroll_by(2)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Newer."""
        self.action_scroll_by(-2)

    def on_click(self, event: events.Click) -> None:
        """The heading takes the focus; a row shows its event."""
        if event.y == 0:
            self.focus()

    def note(self) -> Sequence[Part]:
        """The filter, and whether the newest is on screen."""
        back = f"{self._back} newer below · " if self._back else ""
        alarms = sum(row.times for row in self.shown() if row.event.level == "alarm")
        search = [(f"/{plain(self.words)} ", ink(ACCENT, HEAD))] if self.words else []
        loud: list[Part] = [(f"{MARKS['alarm']} × {alarms} ", ink(level_colour("alarm"), HEAD))]
        return [*search, (f"{back}{LEVEL_LABELS[self.least]} ", ink(FAINT, HEAD)), *(loud if alarms else [])]

    def body(self, width: int, height: int) -> list[Strip]:
        """The newest events that fit, oldest first; on top the newest alarm: what failed last scrolls away last."""
        shown = self.shown()
        if self._is_unknown_now() and height > 1:
            rest = self._events_in(shown, width, height - 1)
            return [*rest, line([(fitted(UNTIL_HERE, width), ink(WARN))], width)]
        return self._events_in(shown, width, height)

    def _events_in(self, shown: list[EventRow], width: int, height: int) -> list[Strip]:
        if not shown:
            none = f" nothing has “{plain(self.words)}”: esc ends the search" if self.words else " nothing yet"
            return [line([(fitted(none, width), ink(FAINT))], width)]
        calm = not self._back and not self.has_focus
        if calm and height < ROOMY:
            shown = [row for row in shown if not row.routine] or shown
        stop = len(shown) - (min(self._back, self._room(shown, width, height)) if self._back else 0)
        rows: list[Strip] = []
        alarm = next((row for row in reversed(shown) if row.event.level == "alarm"), None)
        above = self._rows_of(alarm, width) if alarm is not None and calm else []
        above = above if len(above) + LONGEST_ROWS <= height else []
        for row in reversed(shown[:stop]):
            whole = self._rows_of(row, width)
            above = [] if row is alarm else above
            if rows and len(above) + len(rows) + len(whole) > height:  # a part of a text is none
                return [*above, *rows][-height:]
            rows = [*whole, *rows]
        for row in shown[stop : stop + height - len(rows)]:
            rows += self._rows_of(row, width)
        return rows[:height]

    def _is_unknown_now(self) -> bool:
        """Tell whether the analysis of a recording has not come by yet."""
        return not self._live and self.snapshot is not None and not is_final(self.snapshot)

    def _room(self, shown: Sequence[EventRow], width: int, height: int) -> int:
        """Last row to which the log can be scrolled: the oldest event is on top."""
        used = 0
        for fit, row in enumerate(shown):
            used += len(self._rows_of(row, width))
            if used > height:
                return len(shown) - fit
        return 0

    def _rows_of(self, row: EventRow, width: int) -> list[Strip]:
        """One row; while the log has the focus, as many as the text needs."""
        names = tuple(each.name for each in self.snapshot.vehicles) if self.snapshot is not None else ()
        kept_for = width, self.has_focus, names, ink()
        if kept_for != self._kept_for or len(self._kept) > MAX_EVENTS:
            self._kept, self._kept_for = {}, kept_for
        ours = bool(self.selected) and row.event.system_id == self.selected
        if (row, ours) not in self._kept:
            self._kept[row, ours] = self._fresh_rows_of(row, width, names, ours=ours)
        return self._kept[row, ours]

    def _fresh_rows_of(self, row: EventRow, width: int, names: Sequence[str], *, ours: bool) -> list[Strip]:
        event = row.event
        colour = level_colour(event.level)
        glyph = GLYPHS.get(event.kind, "·")
        parts: list[Part] = [
            (f" {clock(event.t_us)[:-1]} " if width >= HOUR_FROM else f"{clock(event.t_us)[2:-1]} ", ink(FAINT)),
            (f"{MARKS.get(event.level, '  ')} ", ink(colour, bold=True)),
            (f"{glyph} ", ink(ACCENT if ours else FAINT)),
        ]
        if width >= KIND_FROM:
            parts.append((f"{fitted(plain(event.kind), 9)} ", ink(ACCENT if ours else FAINT)))
        room = max(1, width - width_of(parts) - 1)
        often = f" × {row.times}" if row.times > 1 else ""
        text, style = (
            plain(REPORTED_WORDS[event.reported] + _text(event, self.snapshot)),
            ink(BRIGHT if ours else colour),
        )
        if not self.has_focus:
            first, rest = _in_rows(text, room, names)
            last = cut_between_words(rest or first, max(0, room - len(often)), names) + often
            indent = (" " * width_of(parts), style)
            lines = [[*parts, (first, style)], [indent, (last, style)]] if rest else [[*parts, (last, style)]]
        else:
            first, *more = folded(text + often, room, names)
            indent = (" " * width_of(parts), style)
            lines = [[*parts, (first, style)], *([indent, (rest, style)] for rest in more)]
        there = {"@click": f"app.show_event({event.t_us}, {event.system_id})"}
        return [line(each, width).apply_meta(there) for each in lines]
