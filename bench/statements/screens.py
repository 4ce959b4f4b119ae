"""Statements that are drawn: every rule of ``bench.screens``, and facts of the identity pane, each with its field."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from bench.flights import Moment, TrueFlight
from bench.screens.checker import Checker
from bench.screens.screen import Screen
from bench.screens.station import shots
from bench.statements.sentences import SLACK_S, Said, check_sentence, match_sentence

SIZE = (160, 48)
AGE = r"(?: for [\d.]+[smh])?"
STANDING = (
    r"(?:confirmed|tentative|coasting|unknown|out of view|no position|never heard|refused|misplaced|no new frame)"
    r"(?: \d+%)?"
)
ANY = re.compile(".+")
PLACE = re.compile(
    r"(?:not known|behind the camera)(?:: .+)?|in .*the picture.*|where its box is|"
    r"(?:far )?(?:above|below|left|right).* the picture"
)
FACTS = dict.fromkeys(
    (
        *("likeliest", "candidates", "sender", "signed", "refused", "position", "track", "place", "heading", "state"),
        *("GNSS", "loss", "heartbeat", "battery", "radio", "satellites", "from the UAV", "filter", "fence"),
        *("confirmed", "tentative", "coasting", "unknown", "out of view", "no position", "misplaced", "never heard"),
        *("no new frame", "boxes", "video clock", "camera yaw", "do", "named", "ever named"),
    ),
    ANY,
) | {
    "standing": re.compile(
        rf"\S (?:{STANDING}|stated(?:: none of ours)?|no name){AGE}|gone: no longer in the picture|"
        r"not known: no new frame .*"
    ),
    "should be": PLACE,
}
"""The pane's facts, and what each may say."""
NOTHING = ("nothing", "nothing names it now")
CANDIDATE = re.compile(r"\s?(?:UGV-\d+|none of ours)\s+(\d+)%.*")
SUM_PERCENT = 103
"""Probabilities of one box are rounded down, and add up to no more than 1; three of them may be old by a comparison."""


async def check_screens(flown: TrueFlight, moments: Sequence[Moment]) -> list[tuple[int, list[tuple[Said, str]]]]:
    """Letters and false statements of a screen a moment; one after the other of vehicles and boxes is picked."""
    checker, found = Checker(), []
    async for shot in shots(moments, SIZE, [("down",)] * len(moments)):
        told = [(_said(shot.moment, each.what), each.rule) for each in checker.check(shot.screen, shot.moment)]
        told += _identity(flown, shot.moment, shot.screen)
        found.append((sum(bool(row.strip()) for row in shot.screen.rows), told))
    return found


def _said(moment: Moment, text: str, system_id: int = 0) -> Said:
    return Said(where="screen", t_us=moment.snapshot.t_us, text=text, system_id=system_id, standing=True)


def _identity(flown: TrueFlight, moment: Moment, screen: Screen) -> Iterator[tuple[Said, str]]:
    rows = screen.pane_rows("identity")
    picked = re.search(r"(UAV|UGV-\d+|track \d+) *$", rows[0]) if rows else None
    whose = picked[1] if picked else "fleet"
    system_id = int(whose.removeprefix("UGV-")) if whose.startswith("UGV-") else 0
    facts, percents = _facts(rows[1:])
    for name, value in facts:
        said = _said(moment, f"{whose}: {name} {value}", system_id)
        if name == "against":  # a whole sentence, of an alarm without the name
            yield from ((said, why) for why in _against(flown, moment, replace(said, text=value, system_id=0), whose))
        elif re.fullmatch(r"UGV-\d+", name):  # of the fleet, one that is not named, and why
            if not PLACE.fullmatch(value):
                of_it = replace(said, text=value)
                yield from ((said, why) for why in _against(flown, moment, of_it, name))
        elif name not in FACTS or FACTS[name].fullmatch(value) is None:
            yield said, "a fact that is not known"
        elif system_id and name in ("heartbeat", "position"):
            yield from ((said, why) for why in _age(flown, moment, system_id, name, value))
    if percents > SUM_PERCENT:
        yield _said(moment, f"{whose}: {percents}% in all", system_id), "that is more than 1"


def _against(flown: TrueFlight, moment: Moment, said: Said, whose: str) -> Iterator[str]:
    """Reasons against a name: sentences of alarms, a box's doubt, or what a candidate has."""
    reasons = {each.against for box in moment.snapshot.boxes for each in box.candidates}
    if said.text in reasons or said.text in NOTHING:
        return
    whole = match_sentence(said.text) or match_sentence(f"{whose}: {said.text}")
    for text in (said.text,) if whole else said.text.split("; "):
        named = replace(said, text=f"{whose}: {text}")
        yield from check_sentence(flown, named if match_sentence(named.text) else replace(said, text=text))


def _facts(rows: Sequence[str]) -> tuple[list[tuple[str, str]], int]:
    """Names, in 13 cells, and values; and the sum of the candidates' probabilities."""
    facts, percents = list[tuple[str, str]](), 0
    for text in (row.rstrip() for row in rows if row.strip()):
        name, value = text[1:14].strip(), text[14:].strip()
        if match := CANDIDATE.match(text):
            percents += int(match[1])
        elif not name and value == text.strip() and facts:
            facts[-1] = (facts[-1][0], f"{facts[-1][1]} {value}")  # a long value goes on below
        elif not text.startswith("   ") or value == text.strip():  # else what speaks against the candidate above
            facts.append((name, value))
    return facts, percents


def _age(flown: TrueFlight, moment: Moment, system_id: int, name: str, value: str) -> Iterator[str]:
    """Age of a heartbeat or a position by the pane."""
    told = re.search(r"\b([\d.]+)s\b", value)
    now_s, then_s = (flown.silent_s(system_id, t_us, name) for t_us in (moment.now_us, moment.snapshot.t_us))
    faulty = name == "position" and flown.fault_of(system_id, moment.snapshot.t_us, within_s=5)
    if told and not faulty and not min(now_s, then_s) - SLACK_S < float(told[1]) < max(now_s, then_s) + SLACK_S:
        yield f"it came {then_s:.1f} s before"
