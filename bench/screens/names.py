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

HELD_S = 2.0
"""Names may be held for so long without a new frame."""
SLACK_S = 0.5
"""Between a frame and the screen that shows it: its way to the station, a turn of the fold, a poll."""
LEAST_PREFIX = 2
"""Letters by which a cut name is known."""
LABEL_LETTER = re.compile(r"[\w\-?~%+.,:=±… \0]")
WORDS = frozenset(
    (
        *("N", "no", "video", "waiting", "for", "first", "frame", "new", "not", "analysed", "yet", "home"),
        *(
            "stale",
            "lost",
            "never",
            "refused",
            "contested",
            "several",
            "held",
            "stated",
            "old",
            "position",
            "positions",
            "ago",
        ),
    )
)
"""Words on video and map that are no names."""
VALUE = re.compile(r"(?<![\w-])(\d{1,2}%|[+±]?\d+(\.\d+)? ?(km|m|s|h)|~?\?+)(?![\w-])")
COUNT = re.compile(r"(?<!\S)\+(\d+)(?!\S)")


@dataclass(frozen=True, slots=True, kw_only=True)
class _LabelText:
    """Letters that belong together."""

    x: int
    y: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Read:
    """What the labels of a pane say."""

    shown: Counter[int]
    """How often each vehicle has a label."""
    marks: tuple[tuple[int, str], ...]
    """Of each label, the vehicle and the signs of its standing."""
    counted: int
    """Labels that found no room."""
    legend: frozenset[int]
    """Ids that are explained."""
    bare: frozenset[int]
    """Vehicles whose labels are their ids."""
    strange: tuple[str, ...]
    """Letters that are neither names nor known words."""


@lru_cache(maxsize=64)
def _pattern(names: tuple[str, ...]) -> re.Pattern[str]:
    """Whole names with the signs of their standing, the longest first."""
    some = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    return re.compile(rf"(?<![\w-])(~?)({some})(\??)(?![\w-])")


def _names(snapshot: Snapshot) -> tuple[str, ...]:
    return tuple(row.name for row in snapshot.vehicles)


def _labels(screen: Screen, pane: str) -> Iterator[_LabelText]:
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
                yield _LabelText(x=start, y=y, text=text)
            start = x if x < left + width and LABEL_LETTER.match(row[x]) else x + 1


def _read(screen: Screen, pane: str, snapshot: Snapshot) -> _Read:
    """The labels of a pane: names, or system ids where the name is explained or cannot be shown."""
    ids = {row.name: row.system_id for row in snapshot.vehicles}
    bare = {"UAV" if row.role == "uav" else str(row.system_id): row.system_id for row in snapshot.vehicles}
    names, words = _pattern(tuple(ids)), _pattern(tuple(bare))
    explanation = re.compile(rf"(?<![\w-])({'|'.join(bare)}) = ({'|'.join(map(re.escape, ids))})$")
    shown, marks, counted, legend, short, strange = Counter[int](), list[tuple[int, str]](), 0, set(), set(), []
    for label in _labels(screen, pane):
        if (match := explanation.search(label.text)) and bare[match[1]] == ids[match[2]]:
            legend.add(ids[match[2]])
            continue
        text = VALUE.sub(" ", label.text)
        counted += sum(int(match[1]) for match in COUNT.finditer(text))
        text = COUNT.sub(" ", text)
        for pattern, known in ((names, ids), (words, bare)):
            for match in pattern.finditer(text):
                shown[known[match[2]]] += 1
                marks.append((known[match[2]], match[1] + match[3]))
                if known is bare:
                    short.add(known[match[2]])
            text = pattern.sub(" ", text)
        strange += [f"{label.text!r} at {label.x},{label.y}" for word in text.split() if word not in WORDS]
    return _Read(
        shown=shown,
        marks=tuple(marks),
        counted=counted,
        legend=frozenset(legend),
        bare=frozenset(short),
        strange=tuple(strange),
    )


def _check_labels(read: _Read, where: str, snapshot: Snapshot, wanted: set[int]) -> Iterator[tuple[str, str]]:
    """Whole, none twice, none of the wanted left out without being counted, ids explained where they do not speak."""
    for text in read.strange:
        yield f"damaged name on the {where}", text
    for system_id, times in read.shown.items():
        if times > 1:
            yield f"damaged name on the {where}", f"{snapshot.name_of(system_id)} is there {times} times"
    missing = wanted - read.shown.keys()
    if len(missing) > read.counted:
        names = sorted(map(snapshot.name_of, missing))
        yield "name left out and not counted", f"{names} on the {where}, {read.counted} counted"
    for system_id in read.bare - read.legend:
        name = snapshot.name_of(system_id)
        clear = name.endswith(str(system_id)) or not name.isascii() or "UAV" in name
        if not clear:
            yield "id without a name", f"{system_id} for {name} on the {where}"


def check_video_labels(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Labels on the video: whole, of named boxes, none twice, none left out without being counted."""
    if "video" not in screen.panes:
        return
    snapshot = moment.snapshot
    boxes = {box.system_id: box for box in snapshot.boxes if box.system_id}
    inside = {i for i, box in boxes.items() if 0 <= box.cx < snapshot.width and 0 <= box.cy < snapshot.height}
    read = _read(screen, "video", snapshot)
    yield from _check_labels(read, "video", snapshot, inside)
    standings = {row.system_id: row.standing for row in snapshot.vehicles if not row.stated}
    for system_id, signs in read.marks:
        name = snapshot.name_of(system_id)
        if system_id not in boxes:
            yield "name of a vehicle that is not named", f"{name} on the video"
        elif not signs and standings.get(system_id) in ("tentative", "unidentified"):
            yield "name of a vehicle that is not named", f"{name} without a sign is {standings[system_id]}"
    age_s = (moment.now_us - moment.frame_us) * 1e-6
    if read.shown and age_s > HELD_S + SLACK_S:
        yield "names older than they look", f"{len(read.shown)} names on a frame of {age_s:.1f} s ago"


def check_map_labels(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Labels on the map: whole, none twice, none left out without being counted while the map shows everything."""
    if "map" not in screen.panes:
        return
    placed = {
        row.system_id
        for row in moment.snapshot.vehicles
        if row.role == "ugv" and row.position_state == "ok" and np.isfinite(row.p_enu[:2]).all()
    }
    yield from _check_labels(_read(screen, "map", moment.snapshot), "map", moment.snapshot, placed)


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
