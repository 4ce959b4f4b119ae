"""Meaning of the replay keys: speeds, jumps, events, and times typed by hand. Pure but for the timeline they move."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

import numpy as np

from gcs.station import Timeline

SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
SECOND_US = 1_000_000
DAY_US = 86_400 * SECOND_US
SAME_US = 1_000
"""A moment this near is the one that is on screen."""
RELATIVE = re.compile(r"([+-])(.+)")
ELAPSED = re.compile(r"(?:(?:(\d{1,3}):)?(\d{1,3}):)?(\d{1,6}(?:\.\d{1,6})?)", re.ASCII)
CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d{1,6})?))?Z", re.IGNORECASE | re.ASCII)
SHARE = re.compile(r"(\d{1,3}(?:\.\d{1,6})?)%", re.ASCII)


def toggle(timeline: Timeline) -> None:
    """Play or pause; at the end, play starts again from the beginning."""
    if timeline.playing:
        timeline.pause()
        return
    if timeline.now_us >= timeline.stop_us:
        timeline.seek(timeline.start_us)
    timeline.play()


def jump(timeline: Timeline, seconds: float) -> None:
    """Move by seconds, negative is back, within the recording."""
    goal = timeline.now_us + round(seconds * SECOND_US)
    timeline.seek(min(max(goal, timeline.start_us), timeline.stop_us))


def change_speed(timeline: Timeline, steps: int) -> None:
    """The next speed up (positive) or down, 0.1 to 20 times."""
    if steps > 0:
        timeline.set_speed(next((speed for speed in SPEEDS if speed > timeline.speed + 1e-9), SPEEDS[-1]))
    else:
        timeline.set_speed(next((speed for speed in reversed(SPEEDS) if speed < timeline.speed - 1e-9), SPEEDS[0]))


def shares_named(timeline: Timeline, system_ids: Iterable[int]) -> dict[int, float]:
    """Return the share of the recording, as far as it is analysed, for which each vehicle had a name."""
    parts = {system_id: timeline.confidence(system_id) for system_id in system_ids}
    known = {system_id: part[np.isfinite(part)] for system_id, part in parts.items()}
    return {system_id: float((part > 0.0).mean()) for system_id, part in known.items() if part.size}


def time_beside(times_us: Iterable[int], timeline: Timeline, steps: int) -> int | None:
    """The next (positive) or previous of some times within the recording from now, None when there is none."""
    inside = [t_us for t_us in times_us if timeline.start_us <= t_us <= timeline.stop_us]
    if steps > 0:
        return min((t_us for t_us in inside if t_us > timeline.now_us + SAME_US), default=None)
    return max((t_us for t_us in inside if t_us < timeline.now_us - SAME_US), default=None)


def parse_time(text: str, start_us: int, stop_us: int, now_us: int) -> int:
    """A time typed by an operator.

    Args:
        text: ``90`` or ``1:30`` or ``1:02:03`` since the start, ``+10`` or ``-1:00`` from now, ``50%`` of the
            recording, ``10:33:12Z`` UTC.
        start_us: First time of the recording.
        stop_us: Last one.
        now_us: Where the replay is.

    Returns:
        Unix µs, not clamped.

    Raises:
        ValueError: Not a time, or a clock time that the recording does not hold.
    """
    text = text.strip()
    if match := SHARE.fullmatch(text):
        return start_us + round((stop_us - start_us) * float(match[1]) / 100)
    if match := CLOCK.fullmatch(text):
        return _on_clock(match, start_us, stop_us)
    if match := RELATIVE.fullmatch(text):
        return now_us + (1 if match[1] == "+" else -1) * _elapsed(match[2])
    return start_us + _elapsed(text)


def _elapsed(text: str) -> int:
    match = ELAPSED.fullmatch(text.strip())
    if match is None:
        raise ValueError("not a time: try 90, 1:30, +10, -1:00, 50% or 10:33:12Z")
    hours, minutes, seconds = int(match[1] or 0), int(match[2] or 0), float(match[3])
    return round((3600 * hours + 60 * minutes + seconds) * SECOND_US)


def _on_clock(match: re.Match[str], start_us: int, stop_us: int) -> int:
    midnight = datetime.fromtimestamp(start_us / SECOND_US, UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    since = timedelta(hours=int(match[1]), minutes=int(match[2]), seconds=float(match[3] or 0))
    t_us = round((midnight + since).timestamp() * SECOND_US)
    for goal in (t_us, t_us + DAY_US):
        # a minute of slack: typing the second before the start means the start
        if start_us - 60 * SECOND_US <= goal <= stop_us + 60 * SECOND_US:
            return goal
    raise ValueError("the recording does not hold that time of day")
