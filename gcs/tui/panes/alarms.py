"""The alarms pane: what is wrong now, since when, and what to do; acknowledged ones step back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar, Final

from textual import events
from textual.binding import Binding, BindingType
from textual.reactive import reactive
from textual.strip import Strip

from gcs.health.station_alarms import first_of
from gcs.snapshot import Alarm, Snapshot
from gcs.tui.draw.format import REPORTED_WORDS, age
from gcs.tui.draw.strips import Part, folded, line
from gcs.tui.messages import AlarmsSeen, VehiclePicked
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, GOOD, HEAD, INK, PANEL, PICKED, WARN, ink, level_colour
from gcs.tui.panes.pane import Pane
from infra.plain_text import plain

ADVICE_INDENT: Final = "    "
HANGING_FROM: Final = 60
"""Narrower panes have what is wrong over their whole width, below since when."""
CUT: Final = "    … z: the whole screen"
"""Text in place of the last row of an alarm that is longer than the pane is high."""
WORDS: Final = {"alarm": "!! ALARM", "warning": "!  WARN "}
ALARMS_UNKNOWN: Final = "alarms of this place are not known yet"
"""Text in place of ``no alarms`` where a replay's analysis has not come by."""
Group = tuple[Alarm, ...]
"""Alarms shown as one, the worst first: the same of several vehicles, or several troubles of one: a lost link is not
twenty rows, a vehicle in trouble is not five."""
Seen = frozenset[tuple[str, int, str]]
"""Acknowledged alarms: key, since when, level. One that comes again, or gets worse, is a new one."""


def token(alarm: Alarm) -> tuple[str, int, str]:
    """Token that is remembered of an acknowledged alarm."""
    return alarm.key, alarm.since_us, alarm.level


def unseen(alarms: Iterable[Alarm], seen: Seen) -> list[Alarm]:
    """Alarms that are not acknowledged."""
    return [alarm for alarm in alarms if not alarm.acknowledged and token(alarm) not in seen]


def worst_alarm(snapshot: Snapshot, system_id: int) -> Alarm | None:
    """The worst that is wrong with a vehicle, None while nothing is."""
    # they are in order, the worst first
    about = (each for each in snapshot.alarms if system_id in (each.vehicles or (each.system_id,)))
    return next(about, None)


def is_final(snapshot: Snapshot) -> bool:
    """Tell whether all alarms are known: not so at a replay's place that its analysis has not come by."""
    return (snapshot.analysed or snapshot.begins_us > 0) and not snapshot.provisional


def alarm_counts(alarms: Sequence[Alarm]) -> tuple[int, int]:
    """Alarms and warnings."""
    loud = sum(alarm.level == "alarm" for alarm in alarms)
    return loud, len(alarms) - loud


class AlarmPane(Pane):
    """Rows of a trouble: whose, what, and what to do, each on as many rows as it needs."""

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
        self._shown: tuple[int, ...] = ()
        """Number of its group, for each row on screen."""

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """List of what is wrong now."""
        return () if self.snapshot is None else self.snapshot.alarms

    @property
    def groups(self) -> tuple[Group, ...]:
        """Alarms put together where several vehicles have the same trouble, or one vehicle has several."""
        return alike(self.alarms)

    def watch_seen(self) -> None:
        """Draw again when some were acknowledged."""
        self.redraw()

    def action_move(self, steps: int) -> None:
        """Move to the alarm above or below."""
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
        """Acknowledge alarms; the station is given those that had not been."""
        if fresh := unseen(alarms, self.seen):
            self.seen = self.seen | {token(alarm) for alarm in fresh}
            self.post_message(AlarmsSeen(tuple(fresh)))

    def note(self) -> Sequence[Part]:
        """Number of alarms, and how to acknowledge them."""
        loud, quiet = alarm_counts(self.alarms)
        if not self.alarms:
            return [("none ", ink(GOOD, HEAD))] if self.snapshot is not None and is_final(self.snapshot) else ()
        fresh = len(unseen(self.alarms, self.seen))
        below = len(self.groups) - 1 - max(self._shown, default=0)
        if self.size.width < HANGING_FROM:
            hidden = self._first + below
            return [(f"{fresh} new " * bool(fresh) + f"+{hidden} " * (hidden > 0), ink(BRIGHT, HEAD))]
        hint = f"{self._first} above " * bool(self._first) + f"{below} below " * (below > 0)
        hint += f"{fresh} new " if fresh else "all seen "
        return [(hint, ink(FAINT, HEAD)), *count_parts(loud, quiet)]

    def body(self, width: int, height: int) -> list[Strip]:
        """Draw the alarms, the worst first; scrolled to the mark."""
        if self.snapshot is None:
            return []
        groups = self.groups
        if not groups:
            known = is_final(self.snapshot)
            return [line([(" nothing is wrong that is known of" * known, ink(FAINT))], width)]
        self._at = min(self._at, len(groups) - 1)
        rows = [partial(self._rows_of, group, marked=self._marks(at), width=width) for at, group in enumerate(groups)]
        first = max(self._first, _earliest(rows, self._at, height))
        self._first = min(first, self._at, _earliest(rows, len(rows) - 1, height))
        shown: list[tuple[int, Strip]] = []
        for at in range(self._first, len(rows)):
            strips = rows[at]()
            if len(strips) > height > 1 and not shown:
                strips = [*strips[: height - 1], line([(CUT, ink(ACCENT))], width)]
            elif len(shown) + len(strips) > height > 1:
                break
            shown += [(at, strip) for strip in strips]
        self._shown = tuple(at for at, _ in shown[:height])
        return [strip for _, strip in shown[:height]]

    def _marks(self, at: int) -> bool:
        return self.has_focus and at == self._at

    def _rows_of(self, group: Group, *, marked: bool, width: int) -> list[Strip]:
        assert self.snapshot is not None
        alarm = group[0]
        known = not unseen(group, self.seen)
        paper = PICKED if marked else PANEL
        colour = FAINT if known else level_colour(alarm.level)
        since = age(max(0.0, (self.snapshot.now_us - min(each.since_us for each in group)) * 1e-6))
        head = f"{'▸' if marked else ' '}{'seen    ' if known else WORDS.get(alarm.level, '        ')} {since:>5} "
        indent = " " * (len(head) if width >= HANGING_FROM else len(ADVICE_INDENT))
        text = plain(text_of(group))
        first = folded(text, max(1, width - len(head)))[0]
        rest = text[len(first) :].lstrip()
        more = folded(rest, max(1, width - len(indent))) if rest else []
        text_ink = ink(FAINT if known else BRIGHT, paper)
        advised = ink(ACCENT if marked else INK if not known else FAINT, paper)
        lines: list[list[Part]] = [[(head, ink(colour, paper, bold=not known)), (first, text_ink)]]
        lines += [[(indent, text_ink), (each, text_ink)] for each in more]
        advice = folded(plain(advice_of(group)), max(1, width - len(ADVICE_INDENT)))
        lines += [[(ADVICE_INDENT, advised), (each, advised)] for each in advice]
        return [line(parts, width, paper) for parts in lines]

    def on_click(self, event: events.Click) -> None:
        """Mark the alarm under the pointer; acknowledge it at the second click."""
        if 0 < event.y <= len(self._shown):
            self._at = self._shown[event.y - 1]
            self.redraw()
            if event.chain > 1:
                self.action_seen_one()


def _earliest(rows: Sequence[Callable[[], list[Strip]]], last: int, height: int) -> int:
    """The first alarm on screen if the last one is to be whole at the bottom."""
    first, used = last, len(rows[last]())
    while first and (used := used + len(rows[first - 1]())) <= height:
        first -= 1
    return first


def count_parts(loud: int, quiet: int) -> list[Part]:
    """Numbers by level, in words."""
    parts: list[Part] = []
    if loud:
        parts.append((f"{loud} alarm{'s' if loud > 1 else ''} ", ink(ALARM, HEAD, bold=True)))
    if quiet:
        parts.append((f"{quiet} warning{'s' if quiet > 1 else ''} ", ink(WARN, HEAD)))
    return parts


def alike(alarms: Iterable[Alarm]) -> tuple[Group, ...]:
    """Groups: what several vehicles have alike, and all else of each vehicle; in order of their first alarm."""
    alarms = tuple(alarms)
    shared: dict[tuple[str, ...], list[Alarm]] = {}
    for alarm in alarms:
        shared.setdefault(_what(alarm), []).append(alarm)
    groups: dict[object, list[Alarm]] = {}
    for alarm in alarms:
        several = len(shared[_what(alarm)]) > 1 or not alarm.system_id
        # its own words are not among what was found out about it
        own = (alarm.system_id, alarm.kind == "text", alarm.reported)
        groups.setdefault(_what(alarm) if several else own, []).append(alarm)
    return tuple(map(tuple, groups.values()))


def text_of(group: Group) -> str:
    """``UGV-1, UGV-2: no heartbeat`` with the first few names where there are many; ``UGV-1: this; that``."""
    if group[0].reported:
        return REPORTED_WORDS[group[0].reported] + text_of(tuple(replace(alarm, reported="") for alarm in group))
    if len(group) == 1:
        return group[0].text
    names = dict.fromkeys(_parts(alarm)[0] for alarm in group)
    troubles = dict.fromkeys(trouble_of(alarm) for alarm in group)
    says = " says" if group[0].kind == "text" else ""
    return f"{first_of(list(names))}{says}: {'; '.join(troubles)}"


def advice_of(group: Group) -> str:
    """Advice about each of its troubles, the worst first."""
    return "; ".join(dict.fromkeys(alarm.advice for alarm in group))


def _what(alarm: Alarm) -> tuple[str, ...]:
    return alarm.level, alarm.kind, alarm.advice, alarm.reported, trouble_of(alarm) if alarm.system_id else alarm.key


def trouble_of(alarm: Alarm) -> str:
    """The text after the vehicle's name."""
    return _parts(alarm)[1] or alarm.key


def _parts(alarm: Alarm) -> tuple[str, str]:
    """Words of an alarm: whose it is, and what."""
    whose, _, what = alarm.text.partition(" says: " if alarm.kind == "text" else ": ")
    return whose, what
