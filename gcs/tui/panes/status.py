"""The status bar: what is flown or replayed, recording, links, video, disk; the least important goes first."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from rich.cells import cell_len
from textual.reactive import reactive
from textual.strip import Strip
from textual.widget import Widget

from gcs.health.link_alarms import is_silent
from gcs.health.station_alarms import LATE_S, LOW_BYTES, LOW_S, STALLED_S
from gcs.report.overlay import named_count
from gcs.snapshot import HELD_SHOWN_S, Health, Snapshot
from gcs.tui.draw.format import age, bytes_text, clock, duration, plain
from gcs.tui.draw.strips import Part, split_line, width_of
from gcs.tui.palette import ALARM, BRIGHT, FAINT, HEAD, INK, WARN, Colour, count_colour, ink
from gcs.tui.panes.alarms import alarm_counts, count_parts

__all__ = ["StatusBar"]

LAG_SHOWN_S = 0.05
FORECAST_S = 86_400.0
"""A disk that lasts longer lasts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A piece of the bar."""

    rank: int
    """Highest goes first when there is no room."""
    parts: tuple[Part, ...]


class StatusBar(Widget):
    """One row on top."""

    ALLOW_SELECT: ClassVar[bool] = False
    snapshot: reactive[Snapshot | None] = reactive(None, always_update=True)
    title: reactive[str] = reactive("")
    """The station's title, which may change while a recording is analysed."""

    def __init__(self, *, live: bool, id: str) -> None:
        super().__init__(id=id)
        self._live = live
        self._first_us = 0

    def watch_snapshot(self, snapshot: Snapshot | None) -> None:
        """Elapsed time counts from the first snapshot."""
        if snapshot is not None and not self._first_us:
            self._first_us = snapshot.now_us

    def render_line(self, y: int) -> Strip:
        """Title on the left, all else on the right."""
        width = self.size.width
        name = "ROLLCALL" if self._live else "REPLAY"
        left: list[Part] = [(f" {name} ", ink(BRIGHT, HEAD, bold=True))]
        items = self._items()
        while items and width_of(left) + sum(width_of(item.parts) + 2 for item in items) > width - 2:
            items.remove(max(items, key=lambda item: item.rank))
        right: list[Part] = []
        for item in items:
            right += [("  ", ink(FAINT, HEAD)), *item.parts]
        room = width - width_of(left) - width_of(right) - 2
        title = plain(self.title)
        if cell_len(title) <= room:
            left.append((title, ink(FAINT, HEAD)))
        return split_line(left, [*right, (" ", ink(FAINT, HEAD))], width)

    def _items(self) -> list[Item]:
        if self.snapshot is None:
            return []
        health = self.snapshot.health
        items = [_names(self.snapshot)]
        if self._live:
            size = _item(5, bytes_text(health.recorded_bytes), INK)
            items = [self._recording(health), *_open(health), size, *items, _links(health), *_links_named(health)]
            items.append(_disk(health))
            items.append(_item(2, clock(self.snapshot.now_us), INK))
        items.append(_video(self.snapshot))
        if self.snapshot.alarms:
            parts = count_parts(*alarm_counts(self.snapshot.alarms))
            items.insert(0, Item(rank=1, parts=(*parts[:-1], (parts[-1][0].rstrip(), parts[-1][1]))))
        return items

    def _recording(self, health: Health) -> Item:
        assert self.snapshot is not None
        since = duration((self.snapshot.now_us - self._first_us) / 1e6)
        if health.write_failing_s > 0:
            return _item(0, f"NOT RECORDING {since}", WARN)
        return Item(rank=0, parts=(("● REC ", ink(ALARM, HEAD, bold=True)), (since, ink(INK, HEAD))))


def _item(rank: int, text: str, colour: Colour) -> Item:
    return Item(rank=rank, parts=((text, ink(colour, HEAD)),))


def _open(health: Health) -> list[Item]:
    """Shown for as long as any sender can pose as a vehicle."""
    if health.keys:
        return [_item(6, f"{health.keys} key{'s' if health.keys > 1 else ''}", FAINT)]
    return [_item(1, "NOTHING IS AUTHENTICATED", WARN)] if health.keys == 0 else []


def _links(health: Health) -> Item:
    silent = [link for link in health.links if is_silent(link)]
    if not health.links:
        return _item(2, "no link", ALARM)
    if not silent:
        return _item(2, f"{len(health.links)} link{'s' if len(health.links) > 1 else ''} ok", INK)
    since = f" {age(silent[0].silent_s)}" * math.isfinite(silent[0].silent_s)
    return _item(2, f"{len(silent)} of {len(health.links)} links silent{since}", ALARM)


def _links_named(health: Health) -> list[Item]:
    parts: list[Part] = []
    for link in health.links:
        parts.append((f"{plain(link.name)} ", ink(ALARM if is_silent(link) else FAINT, HEAD)))
        lost = f" {link.bad} bad" * bool(link.bad) + f" {link.dropped} dropped" * bool(link.dropped)
        rate = f"{link.packets_per_s:.0f}/s" if math.isfinite(link.packets_per_s) else str(link.packets)
        parts.append((f"{rate}{lost} ", ink(WARN if link.dropped else FAINT, HEAD)))
    return [Item(rank=7, parts=tuple(parts))] if parts else []


def _disk(health: Health) -> Item:
    low = health.free_bytes < LOW_BYTES or health.full_in_s < LOW_S
    free = bytes_text(health.free_bytes)
    if health.write_failing_s > 0:
        return _item(1, f"DISK FAILS {age(health.write_failing_s)}", ALARM)
    if health.write_stalled_s > STALLED_S:
        return _item(1, f"DISK HANGS {age(health.write_stalled_s)}", ALARM)
    if health.full_in_s < FORECAST_S:
        free += f", full in {age(health.full_in_s)}"
    return _item(2, f"disk LOW {free}", ALARM) if low else _item(6, f"disk {free} free", FAINT)


def _names(snapshot: Snapshot) -> Item:
    """How many are confirmed; with the age of the names where they are held, and no count once they are too old."""
    if any(row.standing == "no new frame" for row in snapshot.vehicles):
        return _item(3, f"no new frame for {age(snapshot.frame_age_s)}", WARN)
    named, total = named_count(snapshot)
    if snapshot.held_s:
        return _item(3, f"{named}/{total} confirmed {age(snapshot.held_s)} ago", FAINT)
    return _item(3, f"{named}/{total} confirmed", count_colour(named, total))


def _video(snapshot: Snapshot) -> Item:
    health = snapshot.health
    if health.video != "ok":
        calm = health.video in ("none", "waiting", "ended")
        return _item(4, f"video {plain(health.video)}", FAINT if calm else ALARM)
    if snapshot.frame_age_s > HELD_SHOWN_S:
        return _item(4, f"video {age(snapshot.frame_age_s)} old", WARN)
    late = health.lag_s > LATE_S or health.undecoded > 0
    faults = f" lag {health.lag_s:.1f}s" * (health.lag_s >= LAG_SHOWN_S)
    faults += f" {health.undecoded} undecoded" * (health.undecoded > 0)
    return _item(4, f"video ok{faults}", WARN if late else FAINT)
