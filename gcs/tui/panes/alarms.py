"""The alarms pane: what is wrong now, since when, and what to do; acknowledged ones step back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar, Final

from textual import events
from textual.binding import Binding, BindingType
from textual.reactive import reactive
from textual.strip import Strip

from gcs.snapshot import Alarm
from gcs.tui.draw.alarm_groups import Group, advice_of, alike, text_of
from gcs.tui.draw.format import age, plain
from gcs.tui.draw.strips import Part, fitted, line
from gcs.tui.messages import AlarmsSeen, VehiclePicked
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, GOOD, HEAD, PANEL, PICKED, WARN, ink, level_colour
from gcs.tui.panes.pane import Pane

__all__ = ["ALARM_KEYS", "ROWS_EACH", "AlarmPane", "Seen", "alarm_counts", "count_parts", "token", "unseen"]

ROWS_EACH: Final = 2
WORDS: Final = {"alarm": "!! ALARM", "warning": "!  WARN "}
Seen = frozenset[tuple[str, int, str]]
"""Acknowledged alarms: key, since when, level. One that comes again, or gets worse, is a new one."""

ALARM_KEYS: Final = (
    Binding(
        "a", "pane('alarms')", "alarms", id="pane.alarms", tooltip="Alarms: show and focus, again to hide", show=False
    ),
    Binding("A", "acknowledge", "seen", id="alarms.seen", tooltip="Acknowledge all alarms", show=False),
)


def token(alarm: Alarm) -> tuple[str, int, str]:
    """What is remembered of an acknowledged alarm."""
    return alarm.key, alarm.since_us, alarm.level


def unseen(alarms: Iterable[Alarm], seen: Seen) -> list[Alarm]:
    """Alarms that are not acknowledged."""
    return [alarm for alarm in alarms if token(alarm) not in seen]


def alarm_counts(alarms: Sequence[Alarm]) -> tuple[int, int]:
    """Alarms and warnings."""
    loud = sum(alarm.level == "alarm" for alarm in alarms)
    return loud, len(alarms) - loud


class AlarmPane(Pane):
    """One trouble on two rows: whose and what, and what to do."""

    label: ClassVar[str] = "ALARMS"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)", "Up", id="alarms.up", show=False, tooltip="Alarm above"),
        Binding("down,j", "move(1)", "Down", id="alarms.down", show=False, tooltip="Alarm below"),
        Binding("enter", "seen_one", "Seen", id="alarms.one", show=False, tooltip="Acknowledge this alarm"),
    ]

    seen: reactive[Seen] = reactive(frozenset(), repaint=False)

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._at = 0
        self._first = 0

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """What is wrong now."""
        return () if self.snapshot is None else self.snapshot.alarms

    @property
    def groups(self) -> tuple[Group, ...]:
        """The same, put together where several vehicles have the same trouble, or one vehicle has several."""
        return alike(self.alarms)

    def watch_seen(self) -> None:
        """Some were acknowledged."""
        self.redraw()

    def action_move(self, steps: int) -> None:
        """The alarm above or below."""
        self._at = min(max(self._at + steps, 0), max(0, len(self.groups) - 1))
        self.redraw()

    def action_seen_one(self) -> None:
        """Acknowledge what is at the mark, and pick its vehicle, of several the first."""
        groups = self.groups
        if not groups:
            return
        group = groups[min(self._at, len(groups) - 1)]
        self.acknowledge(group)
        if group[0].system_id:
            self.post_message(VehiclePicked(group[0].system_id))

    def acknowledge(self, alarms: Iterable[Alarm]) -> None:
        """These have been seen; the station is given those that had not."""
        if fresh := unseen(alarms, self.seen):
            self.seen = self.seen | {token(alarm) for alarm in fresh}
            self.post_message(AlarmsSeen(tuple(fresh)))

    def note(self) -> Sequence[Part]:
        """How many, and how to acknowledge."""
        loud, quiet = alarm_counts(self.alarms)
        if not self.alarms:
            return [("none ", ink(GOOD, HEAD))]
        fresh = len(unseen(self.alarms, self.seen))
        hint = f"{fresh} new · enter, A: seen " if fresh else "all seen "
        return [(hint, ink(FAINT, HEAD)), *count_parts(loud, quiet)]

    def body(self, width: int, height: int) -> list[Strip]:
        """The worst first; scrolled to the mark."""
        if self.snapshot is None:
            return []
        groups = self.groups
        if not groups:
            return [line([(" nothing is wrong that is known of", ink(FAINT))], width)]
        each = ROWS_EACH if height >= ROWS_EACH else 1
        fit = max(1, height // each)
        self._at = min(self._at, len(groups) - 1)
        self._first = max(0, min(max(self._first, self._at - fit + 1), self._at, len(groups) - fit))
        rows: list[Strip] = []
        for index in range(self._first, min(self._first + fit, len(groups))):
            rows += self._rows_of(groups[index], marked=self.has_focus and index == self._at, width=width)[:each]
        return rows

    def _rows_of(self, group: Group, *, marked: bool, width: int) -> list[Strip]:
        assert self.snapshot is not None
        alarm = group[0]
        known = not unseen(group, self.seen)
        paper = PICKED if marked else PANEL
        colour = FAINT if known else level_colour(alarm.level)
        since = age(max(0.0, (self.snapshot.now_us - min(each.since_us for each in group)) * 1e-6))
        head = f"{'▸' if marked else ' '}{'seen    ' if known else WORDS.get(alarm.level, '        ')} {since:>5} "
        text = fitted(plain(text_of(group)), width - len(head)).rstrip()
        advised = fitted(plain(advice_of(group)), width - 4).rstrip()
        what = [(head, ink(colour, paper, bold=not known)), (text, ink(FAINT if known else BRIGHT, paper))]
        advice = [("    ", ink(FAINT, paper)), (advised, ink(ACCENT if marked else FAINT, paper))]
        return [line(what, width, paper), line(advice, width, paper)]

    def on_click(self, event: events.Click) -> None:
        """Mark the alarm under the pointer."""
        if event.y > 0 and self.alarms:
            self._at = min(self._first + (event.y - 1) // ROWS_EACH, len(self.groups) - 1)
            self.redraw()


def count_parts(loud: int, quiet: int) -> list[Part]:
    """Numbers by level, in words."""
    parts: list[Part] = []
    if loud:
        parts.append((f"{loud} alarm{'s' if loud > 1 else ''} ", ink(ALARM, HEAD, bold=True)))
    if quiet:
        parts.append((f"{quiet} warning{'s' if quiet > 1 else ''} ", ink(WARN, HEAD)))
    return parts
