"""The status bar: a slot for each fact, always in the same place and in the same short words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Final

from textual.reactive import reactive
from textual.strip import Strip

from gcs.health.link_alarms import is_silent
from gcs.health.station_alarms import LATE_S, LOW_BYTES, LOW_S, STALLED_S
from gcs.report.overlay import named_count
from gcs.snapshot import HELD_SHOWN_S, Health, Snapshot
from gcs.tui.draw.format import NOT_ANALYSED, age, clock, duration
from gcs.tui.draw.map_canvas import STANDING_MARKS
from gcs.tui.draw.strips import Part, clickable, split_line, width_of
from gcs.tui.kept_lines import KeptLines, PlainLines
from gcs.tui.palette import ALARM, BRIGHT, FAINT, HEAD, INK, WARN, count_colour, ink
from gcs.tui.panes.alarms import alarm_counts
from gcs.tui.themes import Colour
from infra.plain_text import plain

FORECAST_S = 3600.0
"""A disk that lasts longer than an hour is not worth a word."""


class Room(IntEnum):
    """Detail for which a bar has room; it depends on its width alone, so that no word changes while it is read."""

    TIGHT = 0
    USUAL = 1
    WIDE = 2


WIDTHS: Final = {Room.WIDE: 116, Room.USUAL: 80}
"""Widths from which on each form is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusSlot:
    """One fact of the bar."""

    cells: tuple[int, int, int]
    """Width that it takes, by room; 0 leaves it out."""
    parts: tuple[Part, ...] = ()
    pane: str = ""
    """Pane that has more about it: a click brings it."""

    def at(self, room: Room) -> list[Part]:
        """Parts of the bar, and the cells that are left."""
        if not self.cells[room]:
            return []
        shown = [clickable(part, f"app.pane({self.pane!r})") if self.pane else part for part in self.parts]
        gap = 2 if room is Room.WIDE else 1
        return [*shown, (" " * max(gap, self.cells[room] - width_of(shown) + gap), ink(FAINT, HEAD))]


class StatusBar(KeptLines, PlainLines):
    """One row on top."""

    ALLOW_SELECT: ClassVar[bool] = False
    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True)
    title: reactive[str] = reactive("")
    """The station's title, which may change while a recording is analysed."""

    def __init__(self, *, live: bool, id: str) -> None:
        super().__init__(id=id)
        self._live = live

    def render_line(self, y: int) -> Strip:
        """Program and title on the left, all else on the right."""
        return status_line(self.snapshot, self.size.width, live=self._live, title=self.title)


def status_line(snapshot: Snapshot | None, width: int, *, live: bool, title: str = "") -> Strip:
    """The bar in this many cells.

    Args:
        snapshot: What it shows, None before the first.
        width: Of the strip.
        live: A flight, not a replay.
        title: What is flown or replayed.
    """
    room = next((room for room, least in WIDTHS.items() if width >= least), Room.TIGHT)
    slots = [] if snapshot is None else _slots(snapshot, room, live=live)
    right = _fitting(slots, room, width)
    left: list[Part] = [(" ", ink(FAINT, HEAD))]
    program = "ROLLCALL" if live else "REPLAY"
    extras = [(program, ink(BRIGHT, HEAD, bold=True)), (plain(title), ink(FAINT, HEAD))]
    if snapshot is not None and live:
        extras += _rates(snapshot.health)
    for text, style in extras:
        if text and width_of(left) + width_of([(text, style)]) + 2 + width_of(right) < width:
            left += [(text, style), ("  ", style)]
    return split_line(left, right, width)


def _fitting(slots: Sequence[StatusSlot], room: Room, width: int) -> list[Part]:
    """Return the slots that fit, and on a screen for which none of them are made the first ones."""
    parts = [part for slot in slots for part in slot.at(room)]
    if parts and room is Room.TIGHT:  # every cell counts
        parts[-1] = (" " * (len(parts[-1][0]) - 1), parts[-1][1])
    return parts if not slots or width_of(parts) + 1 < width else _fitting(slots[:-1], room, width)


def _slots(snapshot: Snapshot, room: Room, *, live: bool) -> list[StatusSlot]:
    """Return the slots from the left: what is wrong, whether it is kept, who is named, what comes, and the time."""
    if not live:
        return [_alarms(snapshot), _names(snapshot, Room.WIDE, (14, 14, 14)), _video(snapshot)]
    return [
        _alarms(snapshot),
        _recording(snapshot, room),
        _names(snapshot, room, (7, 15, 22)),
        _links(snapshot.health),
        _video(snapshot),
        _authentication(snapshot.health, room),
        StatusSlot(cells=(0, 0, 9), parts=_words(INK, clock(snapshot.now_us))),
    ]


def _words(colour: Colour, text: str) -> tuple[Part, ...]:
    return ((text, ink(colour, HEAD, bold=colour is ALARM)),) if text else ()


def _alarms(snapshot: Snapshot) -> StatusSlot:
    """Number of alarms, and of warnings beside them; empty while nothing is wrong."""
    loud, quiet = alarm_counts(snapshot.alarms)
    parts = _words(ALARM, f"{loud} alarm{'s' * (loud > 1)}" if loud else "")
    if quiet:
        parts += _words(WARN, f" +{quiet}" if loud else f"{quiet} warning{'s' * (quiet > 1)}")
    return StatusSlot(cells=(13, 13, 13), parts=parts, pane="alarms")


def _recording(snapshot: Snapshot, room: Room) -> StatusSlot:
    """Tell whether all is kept and for how long it was, or how long the disk lasts once that is below an hour."""
    health, cells = snapshot.health, (10, 14, 16)
    if trouble := _disk_trouble(health):
        ago = f" {age(health.write_failing_s or health.write_stalled_s)}" if room is not Room.TIGHT else ""
        return StatusSlot(cells=cells, parts=_words(ALARM, trouble + ago), pane="alarms")
    mark: Part = ("● REC" if room is not Room.TIGHT else "●", ink(ALARM, HEAD, bold=True))
    low = health.free_bytes < LOW_BYTES or health.full_in_s < LOW_S
    if low or health.full_in_s < FORECAST_S:
        left = age(health.full_in_s) if health.full_in_s < FORECAST_S else "LOW"
        return StatusSlot(cells=cells, parts=(mark, *_words(ALARM if low else WARN, f" disk {left}")), pane="alarms")
    since_us = health.recording_since_us
    since = f" {duration(max(0, snapshot.now_us - since_us) / 1e6)}" if since_us else ""
    return StatusSlot(cells=cells, parts=(("● REC", mark[1]), *(_words(INK, since) if room is not Room.TIGHT else ())))


def _disk_trouble(health: Health) -> str:
    if health.write_failing_s > 0:
        return "DISK FAILS"
    return "DISK HANGS" if health.write_stalled_s > STALLED_S else ""


def _names(snapshot: Snapshot, room: Room, cells: tuple[int, int, int]) -> StatusSlot:
    """Number of confirmed names, faint while it is held for want of a frame, and no count once it is too old."""
    if not snapshot.analysed:
        begins = f"begins {clock(snapshot.begins_us)}" if snapshot.begins_us else ""
        return StatusSlot(cells=cells, parts=_words(WARN, begins or NOT_ANALYSED), pane="identity")
    named, total = named_count(snapshot)
    stalled = any(row.standing == "no new frame" for row in snapshot.vehicles)
    count = f"{'–' if stalled else named}/{total}"
    text = f"{STANDING_MARKS['confirmed']}{count}" if room is Room.TIGHT else f"{count} confirmed"
    colour = WARN if stalled else count_colour(named, total)
    if snapshot.held_s and not stalled:
        text, colour = text + f" {age(snapshot.held_s)} ago" * (room is Room.WIDE), FAINT
    elif snapshot.provisional:
        text, colour = f"{text}, provisional", FAINT
    return StatusSlot(cells=cells, parts=_words(colour, text), pane="identity")


def _links(health: Health) -> StatusSlot:
    """Number of links that bring something."""
    count = len(health.links)
    silent = sum(map(is_silent, health.links))
    colour = ALARM if silent or not count else INK
    return StatusSlot(
        cells=(9, 9, 11), parts=_words(colour, f"links {count - silent}/{count}" if count else "no link"), pane="alarms"
    )


def _rates(health: Health) -> list[Part]:
    """Packets a second and what was lost, of each link where there is room."""
    parts: list[Part] = []
    for link in health.links:
        lost = f" {link.bad} bad" * bool(link.bad) + f" {link.dropped} dropped" * bool(link.dropped)
        rate = f"{link.packets_per_s:.0f}/s" if link.packets_per_s == link.packets_per_s else str(link.packets)
        colour = ALARM if is_silent(link) else WARN if link.dropped else FAINT
        parts.append((f"{plain(link.name)} {rate}{lost}", ink(colour, HEAD)))
    return parts


def _video(snapshot: Snapshot) -> StatusSlot:
    """Tell whether what is shown is new; the pane has the figures."""
    health = snapshot.health
    if health.video in ("none", "waiting", "ended"):
        colour, word = FAINT, {"none": "video none", "waiting": "video wait", "ended": "video end"}[health.video]
    elif health.video != "ok":
        colour, word = ALARM, "no video"
    elif snapshot.frame_age_s > HELD_SHOWN_S:
        colour, word = WARN, "video old"
    elif health.lag_s > LATE_S:
        colour, word = WARN, "video late"
    elif health.undecoded:
        colour, word = WARN, "video bad"
    else:
        colour, word = FAINT, "video ok"
    return StatusSlot(cells=(10, 10, 10), parts=_words(colour, word), pane="video")


def _authentication(health: Health, room: Room) -> StatusSlot:
    """Shown for as long as any sender can pose as a vehicle; else how many keys are in use."""
    if health.keys:
        words = _words(FAINT, f"{health.keys} key{'s' * (health.keys > 1)}") if room is not Room.TIGHT else ()
    else:
        words = _words(WARN, "OPEN" if room is not Room.WIDE else "NOT AUTHENTICATED") if health.keys == 0 else ()
    return StatusSlot(cells=(4, 7, 17), parts=words, pane="alarms")
