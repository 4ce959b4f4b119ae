"""Every rule on every screen of a flight."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.flights import Moment, Received
from bench.screens.screen import Screen, contrast
from bench.screens.station import shots
from gcs.snapshot import Snapshot

Clocks = dict[str, float]
"""Text of each clock of a screen, by name."""
CLOCKS = {
    "clock": re.compile(r"\b(\d\d):(\d\d):(\d\d)(?:\.\d)?Z"),
    "elapsed": re.compile(r"\bREC(?:ORDING)? (?:(\d+):)?(\d\d):(\d\d)\b"),
    "frame": re.compile(r"\bframe ()()(\d+)\b"),
}
AGE = re.compile(r"(\d+(?:\.\d)?)(s|m|h)$")
UNITS_S = {"s": 1.0, "m": 60.0, "h": 3600.0}
VALUE_SLACK_S = 0.7
"""Time from a packet to the screen, s: the radio, a turn of the fold, a poll, tenths that are not shown."""
FADED_AFTER_S = 10.0
"""A state reported this long ago looks other than a fresh one."""
ALARM_LETTERS = 10
"""Least number of letters of an alarm's text in its row."""
GREEN_AHEAD = 1.15
"""A colour is green where its green is this much stronger than red and blue."""


def clocks_of(screen: Screen) -> Clocks:
    """The clocks of the status bar and the number of the frame."""
    found: Clocks = {}
    heading = screen.pane_rows("video")[:1]
    for name, pattern in CLOCKS.items():
        for text in heading if name == "frame" else screen.rows[:1]:
            if match := pattern.search(text):
                hours, minutes, seconds = (int(part or 0) for part in match.groups())
                found[name] = 3600 * hours + 60 * minutes + seconds
    return found


def check_ages(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The fleet's table: ages at least as large as they are."""
    for _, row, name, received in _reporting(screen, moment):
        for title, since_us in (("HEART", received.heartbeat_us), ("POS", received.position_us)):
            shown_s = _age_in(screen.pane_rows("fleet")[0], row, title)
            true_s = (moment.now_us - since_us) * 1e-6 if since_us else math.inf
            if shown_s is not None and shown_s + VALUE_SLACK_S + _rounding_s(shown_s) < true_s:
                yield "value older than it looks", f"{title} of {name}: {shown_s:g} s shown, {true_s:.1f} s true"


def check_faded(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The fleet's table: the state of a vehicle that is silent looks other than that of one that reports."""
    for title in ("MODE", "ARM"):
        looks: dict[bool, list[tuple[str, float]]] = {True: [], False: []}
        for y, row, name, received in _reporting(screen, moment):
            # the picked one is on another background
            if "▸" not in row[:3] and (look := _look(screen, title, y)) is not None:
                looks[moment.now_us - received.heartbeat_us > FADED_AFTER_S * 1e6].append((name, look))
        fresh = max((look for _, look in looks[False]), default=math.inf)
        for name, look in looks[True]:
            if look >= fresh:
                yield "value older than it looks", f"{title} of {name} looks as fresh as of those that report"


def _reporting(screen: Screen, moment: Moment) -> Iterator[tuple[int, str, str, Received]]:
    """Row of the screen, text, name and what was received, of the vehicles in the fleet's table."""
    by_name = {row.name: row for row in moment.snapshot.vehicles}
    for y, row in enumerate(screen.pane_rows("fleet")[1:], start=1):
        name = next((name for name in sorted(by_name, key=len, reverse=True) if name in row[: len(row) // 2]), "")
        received = moment.received.get(by_name[name].system_id) if name else None
        if received is not None and not by_name[name].contested:
            yield screen.panes["fleet"][1] + y, row, name, received


def _age_in(heading: str, row: str, title: str) -> float | None:
    """The age, seconds, that ends below the end of a title; None where it is in words or not there."""
    match = re.search(rf"\b{title}\b", heading)
    words = row[: match.end()].split() if match else []
    found = AGE.search(words[-1]) if words else None
    return float(found[1]) * UNITS_S[found[2]] if found else None


def _rounding_s(shown_s: float) -> float:
    """Rounding of an age that is shown, s."""
    return 0.5 if shown_s < 60.0 else 30.0 if shown_s < 3600.0 else 1800.0


def _look(screen: Screen, title: str, y: int) -> float | None:
    """Contrast of what is below a title of the fleet's table, None where the column is not there or says nothing."""
    match = re.search(rf"\b{title}\b", screen.pane_rows("fleet")[0])
    if match is None:
        return None
    x = screen.panes["fleet"][0] + match.start()
    return contrast(int(screen.ink[y, x]), int(screen.paper[y, x])) if screen.rows[y][x].isalnum() else None


def check_alarms(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """Every alarm of the list is counted in the status bar; the worst has the row below it."""
    alarms = moment.snapshot.alarms
    loud = sum(alarm.level == "alarm" for alarm in alarms)
    match = re.search(r"\b(\d+) alarms?(?: \+(\d+)\b)?", screen.rows[0])
    other = re.search(r"\b(\d+) warnings?\b", screen.rows[0])
    counted = int(match[1]) if match else 0, int((other and other[1]) or (match and match[2]) or 0)
    if counted != (loud, len(alarms) - loud):
        true = f"{loud} alarms, {len(alarms) - loud} warnings"
        yield "alarm neither visible nor counted", f"{true}: {screen.rows[0].strip()!r}"
    worst = next((alarm for alarm in alarms if alarm.level == "alarm"), None)
    if worst is not None and not any("!!" in row and worst.text[:ALARM_LETTERS] in row for row in screen.rows[1:4]):
        yield "alarm neither visible nor counted", f"{worst.text!r} has no row"


def check_texts(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The row of alarms has alarms of this station alone, not what a vehicle says."""
    for row in screen.rows[1:3]:
        match = re.match(r" !! \d\d:\d\d:\d\dZ (.{8})", row)
        if match and not any(alarm.text.startswith(match[1].rstrip("…")) for alarm in moment.snapshot.alarms):
            yield "a text that looks like an alarm of this station", row.strip()


def check_counts(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """None of several is never green, and nothing is more certain than 99 %."""
    for y, row in enumerate(screen.rows):
        for match in re.finditer(r"\b0( of |/)[1-9]\d*\b", row):
            if _is_green(int(screen.ink[y, match.start()])):
                yield "none of several in green", row.strip()
    rows = [*screen.pane_rows("video"), *(row for row in screen.pane_rows("events") if " is " in row)]
    rows += [row for row in screen.pane_rows("fleet") if "confirmed" in row or "tentative" in row]
    for row in rows:
        if re.search(r"(confirmed|tentative|\()\s?100\s?%|\b100%.*\bon track", row):
            yield "more certain than 99 %", row.strip()


def _is_green(colour: int) -> bool:
    red, green, blue = colour >> 16 & 255, colour >> 8 & 255, colour & 255
    return green > GREEN_AHEAD * red and green > GREEN_AHEAD * blue


def check_status(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The status bar: nothing is left out that is worse than what is there."""
    row = screen.rows[0]
    severities = _severities(moment.snapshot)
    shown = {name for name, (_, pattern) in severities.items() if re.search(pattern, row)}
    for name in severities.keys() - shown:
        less = [each for each in shown if severities[each][0] < severities[name][0]]
        if less:
            instead = f"{name} is left out for {', '.join(sorted(less))}"
            yield "the worst is not in the status bar", f"{instead}: {row.strip()!r}"


def _severities(snapshot: Snapshot) -> dict[str, tuple[int, str]]:
    """Troubles that the status bar may have to show: how bad it is, 2 the worst, and the words it is known by.

    That nothing is authenticated is so from the start on, and one of the warnings that are counted.
    """
    health = snapshot.health
    named = sum(row.standing == "confirmed" for row in snapshot.vehicles if row.role == "ugv")
    silent = [link for link in health.links if not link.silent_s <= 3.5]
    found: dict[str, tuple[int, str]] = {f"{named} confirmed": (1, rf"\b{named}/\d+|\b{named} of \d+")}
    if health.write_failing_s > 0:
        found["the disk fails"] = (2, "DISK")
    if silent:
        found["links silent"] = (2, r"links \d+/\d|no link")
    if health.video == "stalled":
        found["the video has stopped"] = (2, "no video")
    if health.keys == 0:
        found["nothing is authenticated"] = (1, r"\bAUTHENTICATED\b|\bOPEN\b")
    return found


HELD_S = 2.0
"""Names may be held for this long without a new frame."""
SLACK_S = 0.5
"""Time from a frame to the screen that shows it, s: its way to the station, a turn of the fold, a poll."""
MIN_PREFIX = 2
"""Letters by which a cut name is known."""
LABEL_LETTER = re.compile(r"[\w\-?~#%+.,:=±… \0]")
WORDS = frozenset(
    (
        *("N", "no", "video", "waiting", "for", "first", "frame", "new", "not", "analysed", "yet", "home", "ago"),
        *("stale", "lost", "same", "never", "refused", "contested", "several", "held", "stated", "old", "position"),
        "positions",
    )
)
"""Words on video and map that are no names."""
VALUE = re.compile(r"(?<![\w-])(\d{1,2}%|[+±]?\d+(\.\d+)? ?(km|m|s|h)|~?\?+)(?![\w-])")
COUNT = re.compile(r"(?<!\S)\+(\d+)(?: names)?(?!\S)")


@dataclass(frozen=True, slots=True, kw_only=True)
class _LabelText:
    """Letters that belong together."""

    x: int
    y: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Read:
    """Content of a pane's labels."""

    shown: Counter[int]
    """Number of labels of each vehicle."""
    marks: tuple[tuple[int, str], ...]
    """Vehicle of each label, and the signs of its standing."""
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
    numbered = {f"#{box.number}" for box in snapshot.boxes if box.number and not box.system_id}
    shown, marks, counted, legend, short, strange = Counter[int](), list[tuple[int, str]](), 0, set(), set(), []
    for label in _labels(screen, pane):
        if label.text in numbered:  # of one without a name, the same in all pictures
            continue
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


def _cut_name(text: str, names: tuple[str, ...], least: int = MIN_PREFIX) -> str:
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


Rule = Callable[[Screen, Moment], Iterator[tuple[str, str]]]
RULES: tuple[Rule, ...] = (
    check_video_labels,
    check_map_labels,
    check_cut_names,
    check_fleet_standings,
    check_ages,
    check_faded,
    check_alarms,
    check_texts,
    check_counts,
    check_status,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """Something on a screen that is not so."""

    rule: str
    what: str


class Checker:
    """Checks the screens of one flight, in order."""

    def __init__(self) -> None:
        self._clocks: Clocks = {}

    def check(self, screen: Screen, moment: Moment) -> list[Violation]:
        """Faults of a screen."""
        found = [Violation(rule=rule, what=what) for check in RULES for rule, what in check(screen, moment)]
        clocks = clocks_of(screen)
        for name, shown in clocks.items():
            before = self._clocks.get(name, shown)
            if shown < before:
                found.append(Violation(rule="clock that goes back", what=f"{name} from {before:g} to {shown:g}"))
        self._clocks |= clocks
        return found


async def check_screens(moments: Sequence[Moment], size: tuple[int, int]) -> tuple[int, list[Violation]]:
    """Check the screens of a flight; returns how many there are, and what is wrong on them.

    Args:
        moments: of the flight, in order.
        size: columns and rows.
    """
    checker, screens, found = Checker(), 0, []
    async for shot in shots(moments, size):
        screens += 1
        found += checker.check(shot.screen, shot.moment)
    return screens, found
