"""The status bar has a place for each fact, and the same few words for it, at every width."""

from dataclasses import replace
from itertools import product

import pytest

from gcs.snapshot import Alarm
from gcs.tui.panes.status import status_line
from tests.support.fake_station import NAN, make_snapshot

BASE = make_snapshot(live=True)
LINK = BASE.health.links[0]


def alarms(loud, quiet):
    one = Alarm(key="", level="alarm", kind="", text="", advice="", since_us=0)
    return (one,) * loud + (replace(one, level="warning"),) * quiet


def linked(*silent_s):
    return {"links": tuple(replace(LINK, silent_s=each) for each in silent_s)}


# the words at every width, and what makes them
ALARMS = {"": (0, 0), "2 alarms": (2, 0), "12 alarms +30": (12, 30), "3 warnings": (0, 3)}
RECORDING = {
    "disk 5": {"free_bytes": 900_000_000, "full_in_s": 300.0},
    "disk LOW": {"free_bytes": 900_000_000},
    "DISK HANGS": {"write_stalled_s": 42.0},
    "DISK FAILS": {"write_failing_s": 400.0},
    "● REC": {"free_bytes": 52_400_000_000, "full_in_s": 4000.0},
}
LINKS = {
    "no link": {"links": ()},
    "links 1/2": linked(9.0, 0.1),
    "links 0/4": linked(9000.0, 9.0, NAN, float("inf")),
    "links 2/2": linked(0.1, 0.1),
}
VIDEO = {
    "no video": {"video": "stalled"},
    "video late": {"lag_s": 4.0, "undecoded": 1200},
    "video bad": {"undecoded": 9},
    "video wait": {"video": "waiting"},
    "video ok": {},
}
FACTS = (ALARMS, RECORDING, LINKS, VIDEO)


def said(words, width, keys=0, live=True):
    count, *others = words
    changes = {}
    for table, word in zip(FACTS[1:], others, strict=True):
        changes |= table[word]
    snapshot = replace(BASE, alarms=alarms(*ALARMS[count]), health=replace(BASE.health, keys=keys, **changes))
    return status_line(snapshot, width, live=live, title="2026-11-20_10-33-12Z")


@pytest.mark.parametrize("width", [60, 79, 80, 100, 115, 116, 160, 200])
def test_every_fact_is_there_at_every_width_and_in_the_same_place(width):
    places = {}
    for words in product(*FACTS):
        strip = said(words, width)
        assert strip.cell_length == width
        for slot, word in enumerate(
            (*words, "2/7 confirmed" if width >= 80 else "●2/7", "OPEN" if width < 116 else "NOT AUTHENTICATED")
        ):
            assert word in strip.text, (width, words, strip.text)
            if word:
                places.setdefault(slot, set()).add(strip.text.index(word))
    assert all(len(columns) == 1 for slot, columns in places.items() if slot != 1), places
    assert max(places[1]) - min(places[1]) <= len("● REC "), "the mark of the recording goes before the disk"


def test_a_disk_that_lasts_for_an_hour_is_no_word():
    assert "disk" not in said(("", "● REC", "links 2/2", "video ok"), 200).text


def test_names_that_are_held_have_their_age_and_a_replay_says_when_they_are_not_final():
    held = replace(BASE, seen_us=BASE.t_us - 1_200_000)
    assert "2/7 confirmed 1.2s ago" in status_line(held, 120, live=True).text
    assert "2/7 confirmed, provisional" in status_line(replace(BASE, provisional=True), 80, live=False).text
    assert "REPLAY" in said(("", "● REC", "links 2/2", "video ok"), 80, live=False).text
