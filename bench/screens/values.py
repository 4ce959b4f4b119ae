"""Rules on values: no clock goes back, nothing is older than it looks, nothing bad is hidden."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from bench.screens.flights import Moment, Received
from bench.screens.screen import Screen, contrast
from gcs.snapshot import Snapshot

Clocks = dict[str, float]
"""What each clock of a screen shows, by name."""
CLOCKS = {
    "clock": re.compile(r"\b(\d\d):(\d\d):(\d\d)(?:\.\d)?Z"),
    "elapsed": re.compile(r"\bREC(?:ORDING)? (?:(\d+):)?(\d\d):(\d\d)\b"),
    "frame": re.compile(r"#()()(\d+)\b"),
}
AGE = re.compile(r"(\d+(?:\.\d)?)(s|m|h)$")
UNITS_S = {"s": 1.0, "m": 60.0, "h": 3600.0}
SLACK_S = 0.7
"""Between a packet and the screen: the radio, a turn of the fold, a poll, tenths that are not shown."""
FADED_AFTER_S = 10.0
"""A state reported so long ago looks other than a fresh one."""
ALARM_LETTERS = 10
"""So much of an alarm's text is in its row at least."""
GREEN_AHEAD = 1.15
"""A colour is green where its green is so much stronger than red and blue."""


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
            if shown_s is not None and shown_s + SLACK_S + _rounding_s(shown_s) < true_s:
                yield "value older than it looks", f"{title} of {name}: {shown_s:g} s shown, {true_s:.1f} s true"


def check_faded(screen: Screen, moment: Moment) -> Iterator[tuple[str, str]]:
    """The fleet's table: the state of a vehicle that is silent looks other than that of one that reports."""
    for title in ("MODE", "ARM"):
        looks: dict[bool, list[tuple[str, float]]] = {True: [], False: []}
        for y, row, name, received in _reporting(screen, moment):
            # the picked one is on another background
            if not row.startswith("▸") and (look := _look(screen, title, y)) is not None:
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
    """By how much an age may be rounded."""
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
    """What the status bar may have to show: how bad it is, 2 the worst, and the words it is known by.

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
