"""The status bar: what is wrong first, then recording, names, links, disk; shortened before anything is left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Final

from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from gcs.health.link_alarms import is_silent
from gcs.health.station_alarms import LATE_S, LOW_BYTES, LOW_S, STALLED_S
from gcs.report.overlay import named_count
from gcs.snapshot import HELD_SHOWN_S, Health, Snapshot
from gcs.tui.draw.format import NOT_ANALYSED, age, bytes_text, clock, duration, plain
from gcs.tui.draw.strips import Part, clickable, split_line, width_of
from gcs.tui.palette import ALARM, BRIGHT, FAINT, HEAD, INK, WARN, Colour, count_colour, ink
from gcs.tui.panes.alarms import alarm_counts, count_parts

__all__ = ["StatusBar", "status_line"]

LAG_SHOWN_S = 0.05
GAP = 2
"""Cells between two items, and after the last."""
MARGIN = 1
"""Cells before the first item and between the ends, less the second after the last."""
FORECAST_S = 86_400.0
"""A disk that lasts longer lasts."""


class Rank(IntEnum):
    """What goes last when there is no room: the worst troubles first."""

    ALARMS = 0
    DISK_TROUBLE = 1
    LINK_TROUBLE = 2
    VIDEO_TROUBLE = 3
    RECORDING = 4
    NAMES = 5
    LINKS = 6
    DISK = 7
    OPEN = 8
    PROGRAM = 9
    """From here up items are shortened for one another; those below are only there where these need no shorter form."""
    VIDEO = 10
    CLOCK = 11
    KEYS = 12
    SIZE = 13
    LINKS_NAMED = 14
    TITLE = 15


PANES_BY_RANK: Final = {
    Rank.ALARMS: "alarms",
    Rank.DISK_TROUBLE: "alarms",
    Rank.LINK_TROUBLE: "alarms",
    Rank.VIDEO_TROUBLE: "alarms",
    Rank.OPEN: "alarms",
    Rank.NAMES: "identity",
    Rank.VIDEO: "video",
}
"""Which pane has more about it: a click brings it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A piece of the bar."""

    rank: Rank
    forms: tuple[tuple[Part, ...], ...]
    """The same in fewer and fewer words; whole words in each."""


class StatusBar(Widget):
    """One row on top."""

    ALLOW_SELECT: ClassVar[bool] = False
    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True)
    title: reactive[str] = reactive("")
    """The station's title, which may change while a recording is analysed."""

    def __init__(self, *, live: bool, id: str) -> None:
        super().__init__(id=id)
        self._live = live

    def render_line(self, y: int) -> Strip:
        """Program and title on the left, all else on the right, troubles first."""
        return status_line(self.snapshot, self.size.width, live=self._live, title=self.title)


def status_line(snapshot: Snapshot | None, width: int, *, live: bool, title: str = "") -> Strip:
    """The bar in so many cells.

    Args:
        snapshot: What it shows, None before the first.
        width: Of the strip.
        live: A flight, not a replay.
        title: What is flown or replayed.
    """
    program = (("ROLLCALL" if live else "REPLAY", ink(BRIGHT, HEAD, bold=True)),)
    ends = [Item(rank=Rank.PROGRAM, forms=(program,))]
    if title:
        ends.append(_item(Rank.TITLE, FAINT, plain(title)))
    items = [] if snapshot is None else _items(snapshot, live=live)
    gap: Part = (" " * GAP, ink(FAINT, HEAD))
    left: list[Part] = [(" ", ink(FAINT, HEAD))]
    right: list[Part] = []
    placed = fitting([*ends, *items], width - MARGIN)
    there = {item.rank for item, _ in placed}
    if any(item.rank <= Rank.NAMES and item.rank not in there for item in items):
        placed = fitting([*ends, *map(_worst_alone, items)], width - MARGIN)
    for item, parts in placed:
        goal = PANES_BY_RANK.get(item.rank)
        shown = [clickable(part, f"app.pane({goal!r})") for part in parts] if goal else parts
        (left if item in ends else right).extend([*shown, gap])
    right[-1:] = [(" ", gap[1])]
    return split_line(left, right, width)


def _items(snapshot: Snapshot, *, live: bool) -> list[Item]:
    """In the order they have while nothing is wrong; troubles go before them."""
    health = snapshot.health
    items = [_names(snapshot)]
    if live:
        size = _item(Rank.SIZE, INK, bytes_text(health.recorded_bytes))
        items = [_recording(snapshot), *_open(health), size, *items, _links(health), *_links_named(health)]
        items += [] if health.write_failing_s > 0 else [_disk(health)]
        items.append(_item(Rank.CLOCK, INK, clock(snapshot.now_us)))
    items += [_video(snapshot), *_alarms(snapshot)]
    return sorted(items, key=lambda item: min(item.rank, Rank.RECORDING))


def _recording(snapshot: Snapshot) -> Item:
    health = snapshot.health
    since = duration(max(0, snapshot.now_us - health.recording_since_us) / 1e6) if health.recording_since_us else ""
    failing_s = health.write_failing_s
    if failing_s > 0:
        fails = f"DISK FAILS {age(failing_s)}"
        text = "NOT RECORDING"
        return _item(Rank.DISK_TROUBLE, ALARM, f"{text} {since}".rstrip() + f", {fails}", f"{text}, {fails}", text)
    mark, time = ("● REC", ink(ALARM, HEAD, bold=True)), (f" {since}", ink(INK, HEAD))
    return Item(rank=Rank.RECORDING, forms=((mark, time), (mark,), (("REC", mark[1]),)))


def fitting(items: Sequence[Item], width: int) -> list[tuple[Item, tuple[Part, ...]]]:
    """The items that there is room for, in their order, each in the longest form that leaves room for the others."""
    chosen: dict[int, tuple[Part, ...]] = {}
    room = width
    by_rank = sorted(range(len(items)), key=lambda at: items[at].rank)
    for group in (
        [at for at in by_rank if items[at].rank <= Rank.PROGRAM],
        [at for at in by_rank if items[at].rank > Rank.PROGRAM],
    ):
        for at in group:
            shortest = items[at].forms[-1]
            if width_of(shortest) + GAP > room:
                break
            chosen[at] = shortest
            room -= width_of(shortest) + GAP
        for at in group:
            spare = room + width_of(chosen[at]) if at in chosen else -1
            form = next((form for form in items[at].forms if width_of(form) <= spare), None)
            if form is not None:
                chosen[at], room = form, spare - width_of(form)
    return [(items[at], chosen[at]) for at in sorted(chosen)]


def _item(rank: Rank, colour: Colour, *forms: str) -> Item:
    return Item(rank=rank, forms=tuple(((text, ink(colour, HEAD)),) for text in forms))


def _alarms(snapshot: Snapshot) -> list[Item]:
    """How many, by level; none while nothing is wrong."""
    if not snapshot.alarms:
        return []
    loud, quiet = alarm_counts(snapshot.alarms)
    parts = count_parts(loud, quiet)
    parts[-1] = (parts[-1][0].rstrip(), parts[-1][1])
    more = [(f"+{quiet}", parts[-1][1])] if loud and quiet else []
    return [Item(rank=Rank.ALARMS, forms=(tuple(parts), (*parts[:1], *more) if more else tuple(parts)))]


def _worst_alone(item: Item) -> Item:
    """Without the count of warnings, where all that is wrong has no room beside it."""
    (text, style), *_ = item.forms[-1]
    return item if item.rank > Rank.ALARMS else Item(rank=item.rank, forms=(((text.rstrip(), style),),))


def _open(health: Health) -> list[Item]:
    """Shown for as long as any sender can pose as a vehicle."""
    if health.keys:
        return [_item(Rank.KEYS, FAINT, f"{health.keys} key{'s' if health.keys > 1 else ''}")]
    return [_item(Rank.OPEN, WARN, "NOTHING IS AUTHENTICATED", "NOT AUTHENTICATED", "OPEN")] if health.keys == 0 else []


def _links(health: Health) -> Item:
    silent = [link for link in health.links if is_silent(link)]
    if not health.links:
        return _item(Rank.LINK_TROUBLE, ALARM, "no link")
    if not silent:
        return _item(Rank.LINKS, INK, f"{len(health.links)} link{'s' if len(health.links) > 1 else ''} ok")
    since = f" {age(silent[0].silent_s)}" * math.isfinite(silent[0].silent_s)
    text = f"{len(silent)} of {len(health.links)} links silent"
    short = f"{len(silent)} link{'s' if len(silent) > 1 else ''} silent"
    return _item(Rank.LINK_TROUBLE, ALARM, text + since, text, short)


def _links_named(health: Health) -> list[Item]:
    parts: list[Part] = []
    for link in health.links:
        parts.append((f"{' ' if parts else ''}{plain(link.name)} ", ink(ALARM if is_silent(link) else FAINT, HEAD)))
        lost = f" {link.bad} bad" * bool(link.bad) + f" {link.dropped} dropped" * bool(link.dropped)
        rate = f"{link.packets_per_s:.0f}/s" if math.isfinite(link.packets_per_s) else str(link.packets)
        parts.append((f"{rate}{lost}", ink(WARN if link.dropped else FAINT, HEAD)))
    return [Item(rank=Rank.LINKS_NAMED, forms=(tuple(parts),))] if parts else []


def _disk(health: Health) -> Item:
    low = health.free_bytes < LOW_BYTES or health.full_in_s < LOW_S
    free = bytes_text(health.free_bytes)
    full = f", full in {age(health.full_in_s)}" if health.full_in_s < FORECAST_S else ""
    if health.write_stalled_s > STALLED_S:
        return _item(Rank.DISK_TROUBLE, ALARM, f"DISK HANGS {age(health.write_stalled_s)}", "DISK HANGS")
    if low:
        return _item(Rank.DISK_TROUBLE, ALARM, f"disk LOW {free}{full}", f"disk LOW {free}", "disk LOW")
    return _item(Rank.DISK, FAINT, f"disk {free} free{full}", f"disk {free} free", f"disk {free}", "disk ok")


def _names(snapshot: Snapshot) -> Item:
    """How many are confirmed; with the age of the names where they are held, and no count once they are too old."""
    if not snapshot.analysed:
        return _item(Rank.NAMES, WARN, NOT_ANALYSED)
    if any(row.standing == "no new frame" for row in snapshot.vehicles):
        return _item(Rank.NAMES, WARN, f"no new frame for {age(snapshot.frame_age_s)}", "no new frame")
    named, total = named_count(snapshot)
    count = f"{named}/{total}"
    if snapshot.held_s:
        ago = f"{age(snapshot.held_s)} ago"
        return _item(Rank.NAMES, FAINT, f"{count} confirmed {ago}", f"{count} {ago}")
    if snapshot.provisional:
        return _item(Rank.NAMES, FAINT, f"{count} confirmed, provisional", f"{count} provisional")
    return _item(Rank.NAMES, count_colour(named, total), f"{count} confirmed", count)


def _video(snapshot: Snapshot) -> Item:
    health = snapshot.health
    if health.video in ("none", "waiting", "ended"):
        return _item(Rank.VIDEO, FAINT, f"video {health.video}")
    if health.video != "ok":
        return _item(Rank.VIDEO_TROUBLE, ALARM, f"video {plain(health.video)}", "no video")
    if snapshot.frame_age_s > HELD_SHOWN_S:
        return _item(Rank.VIDEO_TROUBLE, WARN, f"video {age(snapshot.frame_age_s)} old", "video old")
    faults = f" lag {health.lag_s:.1f}s" * (health.lag_s >= LAG_SHOWN_S)
    faults += f" {health.undecoded} undecoded" * (health.undecoded > 0)
    if health.lag_s > LATE_S:
        return _item(Rank.VIDEO_TROUBLE, WARN, f"video{faults}", "video late")
    if health.undecoded:
        return _item(Rank.VIDEO_TROUBLE, WARN, f"video ok{faults}", f"{health.undecoded} undecoded", "bad video")
    return _item(Rank.VIDEO, FAINT, f"video ok{faults}", "video ok")
