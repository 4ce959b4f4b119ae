"""Numbers, times and foreign text as an operator reads them. Pure; seconds, metres, radians in, words out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Final

from rich.cells import cell_len

from gcs.health.heard import is_heard, refused_because
from gcs.snapshot import Box, Reported, Snapshot, Standing, VehicleRow
from infra.plain_text import plain

NOT_ANALYSED: Final = "not analysed yet"
"""Text in place of all that is not known of a place of a recording."""
REPORTED_WORDS: Final[Mapping[Reported, str]] = {"": "", "then": "then: ", "now": "now recomputed: "}
"""Words before what only the flight reported, and what only the replay of it does."""


def age(seconds: float) -> str:
    """Format an age in at most five letters: ``0.2s``, ``42s``, ``12m``, ``3h``, ``never``; ``–`` for NaN."""
    if math.isnan(seconds):
        return "–"
    if math.isinf(seconds):
        return "never"
    if seconds < 9.95:
        return f"{max(0.0, seconds):.1f}s"
    if seconds < 99.5:
        return f"{seconds:.0f}s"
    return f"{seconds / 60:.0f}m" if seconds < 5970 else f"{seconds / 3600:.0f}h"


def position(state: str, age_s: float) -> str:
    """``0.2s`` while good, else the state in a word, with the age where one is known: ``stale 1s``, ``never``;
    ``several`` send it."""
    if state == "ok":
        return age(age_s)
    if state in ("stale", "lost", "same") and math.isfinite(age_s):
        return f"{state} {age(age_s) if age_s >= 9.95 else f'{age_s:.0f}s'}"
    return "several" if state == "contested" else plain(state)


def position_of(row: VehicleRow) -> str:
    """A vehicle's position as ``position`` has it; ``same 12s`` while one comes over and over."""
    return position("same" if row.frozen else row.position_state, row.position_age_s)


def standing_word(standing: Standing) -> str:
    """A standing in at most eleven letters."""
    return "unknown" if standing == "unidentified" else plain(standing)


def as_far_as_known(snapshot: Snapshot, text: str) -> str:
    """Return the word for a provisional place, of which the last seconds before it alone are known: nothing is never
    there."""
    if not snapshot.provisional:
        return text
    return (
        "–" if text == "never" else text.replace("never heard", "not heard").replace("no position yet", "no position")
    )


def box_as_far_as_known(snapshot: Snapshot, box: Box | None) -> Box | None:
    """A box with the words about its candidates as ``as_far_as_known`` has them."""
    if box is None or not snapshot.provisional:
        return box
    known = partial(as_far_as_known, snapshot)
    candidates = (replace(each, against=known(each.against), missing=known(each.missing)) for each in box.candidates)
    return replace(box, doubt=known(box.doubt), candidates=tuple(candidates))


def standing_of_row(row: VehicleRow) -> str:
    """A vehicle's standing in at most eleven letters; without a position, whether it was heard at all."""
    if row.standing == "no position" and row.role == "ugv":
        if refused_because(row):
            return "refused"
        if not is_heard(row):
            return "never heard"
        if row.frozen:
            return "same place"
    return standing_word(row.standing)


def name_or_id(name: str, system_id: int, width: int) -> str:
    """A vehicle's name, or its system id where that takes more than ``width`` cells: a part of it may be another's."""
    return name if cell_len(name) <= width or not system_id else str(system_id)


def percent(share: float) -> str:
    """``97%``, empty for NaN."""
    return "" if not math.isfinite(share) else f"{100 * share:.0f}%"


def number(value: float, unit: str, digits: int = 1) -> str:
    """``0.4 m``, never ``-0 m``; ``–`` for NaN or infinity."""
    return f"{value:z.{digits}f} {unit}" if math.isfinite(value) else "–"


def metres(value: float) -> str:
    """Format a distance in at most six letters: ``0.4 m``, ``235 m``, ``7.9 km``; ``–`` for NaN or infinity."""
    if abs(value) < 99.95:
        return number(value, "m")
    return number(value, "m", 0) if abs(value) < 999.5 else number(value / 1000, "km", int(abs(value) < 9950))


def degrees(angle: float) -> str:
    """Three digits clockwise from north: ``045°``, ``–`` for NaN."""
    return f"{round(math.degrees(angle)) % 360:03d}°" if math.isfinite(angle) else "–"


def duration(seconds: float) -> str:
    """``04:11``, ``1:02:03``, with a minus sign before the start."""
    whole = int(abs(seconds))
    sign = "-" if seconds < 0 and whole else ""
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    return f"{sign}{hours}:{minutes:02d}:{rest:02d}" if hours else f"{sign}{minutes:02d}:{rest:02d}"


def clock(t_us: int, *, tenths: bool = False) -> str:
    """UTC time of day: ``10:33:12Z`` or ``10:33:12.4Z``; ``--:--:--`` outside the calendar."""
    try:
        moment = datetime.fromtimestamp(t_us // 1_000_000, UTC)
    except (ValueError, OverflowError, OSError):
        return "--:--:--"
    return f"{moment:%H:%M:%S}" + (f".{t_us // 100_000 % 10}" if tenths else "") + "Z"
