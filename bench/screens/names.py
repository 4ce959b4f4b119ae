"""Rules on names: whole wherever they are shown, and shown of those vehicles alone that are named.

Labels on video and map are read from the cells: letters of one colour on one background, whatever drew them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.screens.flights import Moment
from bench.screens.screen import Screen
from gcs.snapshot import Snapshot

__all__ = [
    "check_cut_names",
    "check_fleet_standings",
    "check_map_labels",
    "check_video_labels",
]

HELD_S = 2.0
"""Names may be held for so long without a new frame."""
SLACK_S = 0.5
"""Between a frame and the screen that shows it: its way to the station, a turn of the fold, a poll."""
LEAST_PREFIX = 2
"""Letters by which a cut name is known."""
LABEL_LETTER = re.compile(r"[\w\-?~%+.,:=±… \0]")
WORDS = frozenset(
    (
        *("UAV", "N", "no", "video", "waiting", "for", "first", "frame", "new", "not", "analysed", "yet", "home"),
        *("stale", "lost", "never", "refused", "contested", "several", "held", "old", "position", "positions"),
        *("m", "km", "s", "ago"),
    )
)
"""Words on video and map that are no names."""
VALUES = re.compile(r"~|\?+|~\?|\d{1,2}%|\+\d+|[+±]?\d+(\.\d+)?(s|m|h|km)?|…")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Label:
    """Letters that belong together."""

    x: int
    y: int
    text: str


@lru_cache(maxsize=64)
def _pattern(names: tuple[str, ...]) -> re.Pattern[str]:
    """Whole names with the marks of their standing, the longest first."""
    some = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    return re.compile(rf"(?<![\w-])(~?)({some})(\??)(?![\w-])")


def _names(snapshot: Snapshot) -> tuple[str, ...]:
    return tuple(row.name for row in snapshot.vehicles)


def _labels(screen: Screen, pane: str) -> Iterator[_Label]:
    """Runs of letters in one colour below a pane's heading."""
    left, top, width, height = screen.panes[pane]
    for y in range(top + 1, top + height):
        row, look = screen.rows[y], screen.ink[y] << 24 | screen.paper[y] & 0xFFFFFF
        start = left
        for x in range(left, left + width + 1):
            ends = x == left + width or not LABEL_LETTER.match(row[x]) or (x > start and look[x] != look[x - 1])
            if not ends:
                continue
            if text := row[start:x].replace("\0", "").strip():
                yield _Label(x=start, y=y, text=text)
            start = x if x < left + width and LABEL_LETTER.match(row[x]) else x + 1


def _read_names(screen: Screen, pane: str, names: tuple[str, ...]) -> tuple[list[re.Match[str]], int, list[str]]:
    """Whole names on a pane, how many more are counted, and letters that are neither names nor known words."""
    found: list[re.Match[str]] = []
    counted, strange = 0, []
    for label in _labels(screen, pane):
        found += _pattern(names).finditer(label.text)
        for word in _pattern(names).sub(" ", label.text).split():
            if word in WORDS or VALUES.fullmatch(word):
                counted += int(word[1:]) if re.fullmatch(r"\+\d+", word) else 0
            else:
                strange.append(f"{label.text!r} at {label.x},{label.y}")
    return found, counted, strange


def check_video_labels(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Labels on the video: whole, of named boxes, none twice, none left out without being counted."""
    if "video" not in screen.panes:
        return
    snapshot = moment.snapshot
    found, counted, strange = _read_names(screen, "video", _names(snapshot))
    for text in strange:
        yield "damaged name on the video", text
    shown = Counter(match[2] for match in found)
    boxes = {snapshot.name_of(box.system_id): box for box in snapshot.boxes if box.system_id}
    for name, times in shown.items():
        if name not in boxes:
            yield "name of a vehicle that is not named", f"{name} on the video"
        elif times > 1:
            yield "damaged name on the video", f"{name} is there {times} times"
    standings = {row.name: row.standing for row in snapshot.vehicles}
    for match in found:
        if not match[1] and not match[3] and standings[match[2]] in ("tentative", "unidentified"):
            yield "name of a vehicle that is not named", f"{match[2]} without a mark is {standings[match[2]]}"
    if shown and moment.now_us - moment.frame_us > (HELD_S + SLACK_S) * 1e6:
        age_s = (moment.now_us - moment.frame_us) * 1e-6
        yield "names older than they look", f"{len(shown)} names on a frame of {age_s:.1f} s ago"
    inside = {name for name, box in boxes.items() if 0 <= box.cx < snapshot.width and 0 <= box.cy < snapshot.height}
    missing = inside - shown.keys()
    if len(missing) > counted:
        yield "name left out and not counted", f"{sorted(missing)} on the video, {counted} counted"


def check_map_labels(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Labels on the map: whole, none twice, none left out without being counted while the map shows everything."""
    if "map" not in screen.panes:
        return
    snapshot = moment.snapshot
    names = _names(snapshot)
    found, counted, strange = _read_names(screen, "map", names)
    for text in strange:
        yield "damaged name on the map", text
    shown = Counter(match[2] for match in found)
    for name, times in shown.items():
        if times > 1:
            yield "damaged name on the map", f"{name} is there {times} times"
    placed = {
        row.name
        for row in snapshot.vehicles
        if row.role == "ugv" and row.position_state == "ok" and np.isfinite(row.p_enu[:2]).all()
    }
    missing = placed - shown.keys()
    if len(missing) > counted:
        yield "name left out and not counted", f"{sorted(missing)} on the map, {counted} counted"


def check_cut_names(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Everywhere: no name is cut by an ellipsis or an edge, none runs into something else."""
    names = _names(moment.snapshot)
    for pane, row in _rows(screen):
        for match in re.finditer("…", row):
            if name := _cut_name(row[: match.start()], names):
                yield "cut name", f"{name!r} in {pane}: {row.strip()!r}"
        if pane not in ("video", "map"):
            last = row.rstrip()
            if len(last) >= len(row) - 1 and not last.endswith("…") and (name := _cut_name(last, names, least=4)):
                yield "cut name", f"{name!r} at the edge of {pane}: {row.strip()!r}"


def _cut_name(text: str, names: tuple[str, ...], least: int = LEAST_PREFIX) -> str:
    """The name of which a part ends a text, empty if none or a whole one does that no other begins with."""
    whole = [name for name in names if text.endswith(name)]
    for name in names:
        for length in range(len(name) - 1, least - 1, -1):
            part = name[:length]
            if not text.endswith(part) or re.search(r"[\w-]$", text[: -len(part)]):
                continue
            if not any(len(each) >= length for each in whole if each != part) or part in names:
                return name
    return ""


def _rows(screen: Screen) -> Iterator[tuple[str, str]]:
    """Rows of every pane and of what is around them."""
    covered: set[int] = set()
    for pane, rect in screen.panes.items():
        covered |= set(range(rect[1], rect[1] + rect[3]))
        yield from ((pane, row) for row in screen.pane_rows(pane)[1 if pane != "fleet" else 0 :])
    yield from (("frame", row) for y, row in enumerate(screen.rows) if y not in covered)


def check_fleet_standings(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The fleet's table: confirmed are those who are, and a pause between two frames makes nobody unknown."""
    standings = {row.name: row for row in moment.snapshot.vehicles}
    frame_age_s = (moment.now_us - moment.frame_us) * 1e-6
    for row in screen.pane_rows("fleet")[1:]:
        match = _pattern(_names(moment.snapshot)).search(row)
        if match is None:
            continue
        vehicle = standings[match[2]]
        if "confirmed" in row and vehicle.standing != "confirmed":
            yield "name of a vehicle that is not named", f"{match[2]} in the fleet is {vehicle.standing}"
        if "confirmed" in row and frame_age_s > HELD_S + SLACK_S:
            yield "names older than they look", f"{match[2]} confirmed by a frame of {frame_age_s:.1f} s ago"
        before = moment.named.get(vehicle.system_id)
        held = before == "confirmed" and vehicle.position_state == "ok" and frame_age_s < HELD_S - SLACK_S
        if re.search(r"\bunknown\b", row) and held:
            yield "name dropped between two frames", f"{match[2]}, {frame_age_s:.1f} s after a frame"
