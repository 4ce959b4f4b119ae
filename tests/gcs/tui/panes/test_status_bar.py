"""The status bar shows the worst first, at every width, in whole words."""

from dataclasses import replace
from itertools import product

import pytest

from gcs.snapshot import Alarm
from gcs.tui.panes.status import status_line
from tests.support.fake_station import NAN, make_snapshot

WIDTHS = range(60, 201)
BASE = make_snapshot(live=True)
LINK = BASE.health.links[0]


def alarms(loud, quiet):
    one = Alarm(key="", level="alarm", kind="", text="", advice="", since_us=0)
    return (one,) * loud + (replace(one, level="warning"),) * quiet


def linked(*silent_s):
    return {"links": tuple(replace(LINK, silent_s=each) for each in silent_s)}


# the words that stay at every width, and what makes them
ALARMS = {"": (0, 0), "2 alarms": (2, 0), "12 alarms": (12, 30), "3 warnings": (0, 3)}
RECORDING = {
    "disk LOW": {"free_bytes": 900_000_000, "full_in_s": 300.0},
    "DISK HANGS": {"write_stalled_s": 42.0},
    "NOT RECORDING": {"write_failing_s": 400.0},
    "REC": {"free_bytes": 52_400_000_000},
}
LINKS = {
    "no link": {"links": ()},
    "1 link silent": linked(9.0, 0.1),
    "4 links silent": linked(9000.0, 9.0, NAN, float("inf")),
    "2 links ok": linked(0.1, 0.1),
}
VIDEO = {
    "no video": {"video": "stalled"},
    "video late": {"lag_s": 4.0, "undecoded": 1200},
    "bad video": {"undecoded": 9},
    "": {"video": "waiting"},
}
STATES = list(product(ALARMS, RECORDING, LINKS, VIDEO, (0, 12)))


def said(state, width):
    count, recording, links, video, keys = state
    changes = RECORDING[recording] | LINKS[links] | VIDEO[video]
    health = replace(BASE.health, keys=keys, **changes)
    snapshot = replace(BASE, alarms=alarms(*ALARMS[count]), health=health)
    return status_line(snapshot, width, live=True, title="2026-11-20_10-33-12Z")


def words_of(text):
    return set(text.replace(",", "").split())


def has(text, short):
    """Whether an item is there, in any of its forms."""
    forms = {
        "bad video": ("bad video", "9 undecoded"),
        "no video": ("no video", "video stalled"),
        "video late": ("video late", "video lag 4.0s 1200 undecoded"),
        "1 link silent": ("1 link silent", "1 of 2 links silent"),
        "4 links silent": ("4 links silent", "4 of 4 links silent"),
    }
    return any(form in text for form in forms.get(short, (short,)))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("recording", RECORDING)
@pytest.mark.parametrize("links", LINKS)
def test_the_worst_is_there_at_every_width_in_whole_words(recording, links):
    states = [state for state in STATES if state[1:3] == (recording, links)]
    for state in states:
        words = words_of(said(state, 1000).text) | {"OPEN", "NOT", "late", "no", "link", "ok", "bad", "+30"}
        for width in WIDTHS if state[0] == "12 alarms" else range(60, 200, 23):
            strip = said(state, width)
            assert strip.cell_length == width
            text = strip.text
            troubles = [each for each in state[:4] if each not in ("REC", "2 links ok")]
            assert all(has(text, each) for each in troubles), (width, state, text)
            # four troubles at once fill sixty cells
            if width >= 64 or "" in state[:4] or "2 links ok" in state:
                assert "2/7" in text and "REC" in text, (width, state, text)
            assert words_of(text) <= words, (width, text)
            if "NOTHING" in text or "OPEN" in text:
                assert "link" in text and ("disk" in text.lower() or recording == "NOT RECORDING"), (width, text)


def test_troubles_come_before_what_is_well():
    text = said(("2 alarms", "DISK HANGS", "1 link silent", "no video", 0), 200).text
    order = ["2 alarms", "DISK HANGS", "links silent", "video stalled", "● REC", "NOTHING IS AUTHENTICATED", "2/7"]
    assert sorted(order, key=text.index) == order


def test_words_get_shorter_before_anything_is_left_out():
    state = ("2 alarms", "REC", "1 link silent", "", 0)
    assert "NOTHING IS AUTHENTICATED" in said(state, 160).text
    assert "OPEN" in said(state, 80).text and "disk ok" in said(state, 80).text
    narrow = said(state, 60).text
    assert has(narrow, "1 link silent") and "REC" in narrow and "2/7" in narrow
