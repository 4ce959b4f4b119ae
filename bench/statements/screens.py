"""What is drawn: the fleet's table and the identity pane read from the terminal's side, each fact with its field."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from bench.screens.flights import Moment
from bench.screens.screen import Screen, read_screen
from bench.screens.station import ScriptedStation
from bench.screens.values import age_in
from bench.statements.flights import Flown
from bench.statements.rows import check_row
from bench.statements.sentences import SLACK_S, Said, check_sentence
from gcs.snapshot import VehicleRow
from gcs.tui import RollcallApp

__all__ = ["check_screen", "screens_of"]

SIZE = (160, 48)
STANDINGS = {
    word: "unidentified" if word == "unknown" else word
    for word in (
        "confirmed",
        "tentative",
        "coasting",
        "unknown",
        "out of view",
        "no position",
        "no new frame",
        "stated",
    )
}
FACTS = frozenset(
    (
        *("standing", "should be", "likeliest", "candidates", "sender", "signed", "refused", "position", "track"),
        *("place", "heading", "state", "GNSS", "loss", "heartbeat", "battery", "radio", "satellites", "from the UAV"),
        *(
            "doubt",
            "filter",
            "fence",
            "confirmed",
            "tentative",
            "coasting",
            "unknown",
            "out of view",
            "no position",
            "boxes",
        ),
        *("video clock", "camera yaw", ""),
    )
)
"""Names of facts of the identity pane."""
VALUES: Mapping[str, re.Pattern[str]] = {
    "standing": re.compile(
        r"(?P<word>stated: none of ours|stated|no name|gone: no longer in the picture|"
        + "|".join(STANDINGS)
        + r")(?: (?P<percent>\d+)%)?(?: for (?P<age>[\d.]+[smh]))?"
    ),
    "should be": re.compile(
        r"not known: .+|behind the camera: .+|in (?:the middle of )?the picture.*|(?:above|below|left|right).*"
    ),
}
CANDIDATE = re.compile(r"\s?(?P<name>UGV-\d+|none of ours)\s+(?P<percent>\d+)%.*")
SUM_PERCENT = 103
"""Probabilities of one box are rounded down, and add up to no more than 1; three of them may be old by a comparison."""


async def screens_of(moments: Sequence[Moment]) -> list[tuple[Moment, Screen]]:
    """A screen for each moment; one after the other of the vehicles and boxes is picked."""
    station, found = ScriptedStation(moments[0]), []
    app = RollcallApp(station, graphics="blocks")
    app.silent_after_s = math.inf  # a script waits for the machine that looks at it
    async with app.run_test(size=SIZE) as pilot:
        for station.moment in moments:
            app._poll()
            await pilot.press("down")
            await pilot.pause()
            await pilot.pause()
            found.append((station.moment, read_screen(app)))
    return found


def check_screen(flown: Flown, moment: Moment, screen: Screen) -> Iterator[tuple[Said, str]]:
    """The fleet's table, and the pane of who is picked."""
    for row in _fleet(flown, moment, screen):
        for what, why in check_row(flown, moment, row):
            yield _said("screen, fleet", moment, f"{row.name}: {what}", row.system_id), why
    yield from _identity(flown, moment, screen.pane_rows("identity"))


def _said(where: str, moment: Moment, text: str, system_id: int = 0) -> Said:
    return Said(where=where, t_us=moment.snapshot.t_us, text=text, system_id=system_id, standing=True)


def _fleet(flown: Flown, moment: Moment, screen: Screen) -> Iterator[VehicleRow]:
    """The table's lines as rows again: what is drawn is checked like what was to be drawn."""
    heading, *lines = screen.pane_rows("fleet")
    by_name = {row.name: row for row in moment.snapshot.vehicles if row.role == "ugv"}
    at = heading.index("IDENTITY")
    for text in lines:
        row = next((row for name, row in by_name.items() if re.search(rf"\b{name}\b", text[:at])), None)
        if row is None:
            continue
        word = re.match(r"[a-z ]*[a-z]", text[at:])
        ages = {title: age_in(heading, text, title) for title in ("HEART", "POS")}
        yield replace(
            row,
            heartbeat_age_s=math.nan if ages["HEART"] is None else ages["HEART"],
            position_age_s=math.nan if ages["POS"] is None else ages["POS"],
            standing=STANDINGS.get(word[0] if word else "", "unreadable"),  # type: ignore[arg-type]
        )


def _identity(flown: Flown, moment: Moment, rows: Sequence[str]) -> Iterator[tuple[Said, str]]:
    picked = re.search(r"(UAV|UGV-\d+|track \d+) *$", rows[0]) if rows else None
    whose = picked[1] if picked else "fleet"
    system_id = int(whose.removeprefix("UGV-")) if whose.startswith("UGV-") else 0
    facts, percents = _facts(rows[1:])
    for name, value in facts:
        said = _said("screen, identity", moment, f"{whose}: {name} {value}".strip(), system_id)
        if name not in FACTS:
            yield said, "a fact that is not known"
        elif name in VALUES and VALUES[name].fullmatch(value) is None:
            yield said, f"a {name} that is not known"
        elif not name:
            yield from ((said, why) for why in check_sentence(flown, replace(said, text=value, system_id=0)))
        elif system_id and name in ("heartbeat", "position"):
            yield from ((said, why) for why in _age(flown, moment, system_id, name, value))
    if percents > SUM_PERCENT:
        yield _said("screen, identity", moment, f"{whose}: {percents}% in all", system_id), "that is more than 1"


def _facts(rows: Sequence[str]) -> tuple[list[tuple[str, str]], int]:
    """Names, in 13 cells, and values; and the sum of the candidates' probabilities."""
    facts, percents = list[tuple[str, str]](), 0
    for text in (row.rstrip() for row in rows if row.strip()):
        name, value = text[1:14].strip(), text[14:].strip()
        if match := CANDIDATE.match(text):
            percents += int(match["percent"])
        elif not name and value == text.strip() and facts and not value.startswith("may be"):
            facts[-1] = (facts[-1][0], f"{facts[-1][1]} {value}")  # a long value goes on below
        elif not text.startswith("   ") or value == text.strip():  # else what speaks against the candidate above
            facts.append((name, value))
    return facts, percents


def _age(flown: Flown, moment: Moment, system_id: int, name: str, value: str) -> Iterator[str]:
    """How long ago a heartbeat or a position came, by the pane."""
    told = re.search(r"\b([\d.]+)s\b", value)
    now_s, then_s = (flown.silent_s(system_id, t_us, name) for t_us in (moment.now_us, moment.snapshot.t_us))
    faulty = name == "position" and flown.fault_of(system_id, moment.snapshot.t_us, within_s=5)
    if told and not faulty and not min(now_s, then_s) - SLACK_S < float(told[1]) < max(now_s, then_s) + SLACK_S:
        yield f"it came {then_s:.1f} s before"
