"""The checker of screens finds what is wrong: each rule on a screen, or on a truth, that was changed on purpose."""

import asyncio
from dataclasses import replace

import pytest

from bench.flights import polls_of
from bench.screens.__main__ import script_of
from bench.screens.checker import Checker
from bench.screens.station import VIEWS, shots
from gcs.snapshot import Alarm

pytestmark = pytest.mark.slow

SIZE = (160, 48)
S = 1_000_000


@pytest.fixture(scope="module")
def shot():
    """A screen with video, map, fleet, identity and log, four seconds into a flight in which all are named."""

    async def first(moments):
        async for each in shots(moments, SIZE):
            return each

    moments = polls_of(script_of("ordinary", seconds=4.0, vehicles=3, poll_us=250_000))
    last = next(each for each in reversed(moments) if len(each.snapshot.boxes) == 3)
    return asyncio.run(first([last] * len(VIEWS)))


def found(screen, moment):
    return {violation.rule for violation in Checker().check(screen, moment)}


def written(screen, x, y, text):
    """A screen with something else in a place."""
    rows = list(screen.rows)
    rows[y] = rows[y][:x] + text + rows[y][x + len(text) :]
    return replace(screen, rows=tuple(rows))


def place(screen, pane, text):
    """Where a text is on a pane."""
    left, top, _, height = screen.panes[pane]
    return next(
        (screen.rows[y].index(text, left), y)
        for y in range(top, top + height)
        if text in screen.rows[y][left : left + screen.panes[pane][2]]
    )


def overwrite(pane, old, new):
    def change(shot):
        x, y = place(shot.screen, pane, old)
        return written(shot.screen, x, y, new), shot.moment

    return change


def in_row(y, text):
    """Written over the beginning of a row of the screen."""
    return lambda shot: (written(shot.screen, 0, y, text.ljust(SIZE[0])), shot.moment)


def truth(**changes):
    """The screen as it is, another truth."""
    return lambda shot: (shot.screen, replace(shot.moment, **{k: v(shot.moment) for k, v in changes.items()}))


def unnamed(moment):
    boxes = tuple(replace(box, system_id=0) for box in moment.snapshot.boxes)
    return replace(moment.snapshot, boxes=boxes)


def standing(word):
    def change(moment):
        rows = (replace(row, standing=word) if row.role == "ugv" else row for row in moment.snapshot.vehicles)
        return replace(moment.snapshot, vehicles=tuple(rows))

    return change


def without_position(moment):
    return {i: replace(r, position_us=moment.now_us - 9 * S) for i, r in moment.received.items()}


def one_silent(moment):
    return {i: replace(r, heartbeat_us=moment.now_us - 60 * S * (i == 11)) for i, r in moment.received.items()}


def alarmed(moment):
    alarm = Alarm(key="x", level="alarm", kind="link", text="nothing comes", advice="look", since_us=moment.now_us)
    return replace(moment.snapshot, alarms=(alarm,))


def dark_disk(moment):
    return replace(moment.snapshot, health=replace(moment.snapshot.health, write_failing_s=3.0))


def green_none(shot):
    x, y = shot.screen.rows[0].index("3/3"), 0
    ink = shot.screen.ink.copy()
    ink[y, x] = 0x40F060
    return replace(written(shot.screen, x, y, "0/3"), ink=ink), shot.moment


DAMAGE = {
    "damaged name on the video": [
        overwrite("video", "UGV-12", "UGV-?2"),
        overwrite("video", "UGV-12", "UGV-1▀"),
        overwrite("video", "UGV-12", "UGV-13"),
        overwrite("video", "UGV-12", "UGV-21"),
    ],
    "damaged name on the map": [
        overwrite("map", "UGV-12", "UGV-1→"),
        overwrite("map", "UGV-12", "?GV-12"),
        overwrite("map", "UGV-12", "UGV-13"),
    ],
    "name left out and not counted": [overwrite("video", "UGV-12", "▀▀▀▀▀▀"), overwrite("map", "UGV-12", "      ")],
    "cut name": [
        overwrite("events", "UGV-12", "UGV-1…"),
        overwrite("fleet", "UGV-12", "UGV… "),
        in_row(47, f"{' ' * (SIZE[0] - 5)}UGV-1"),
    ],
    "name of a vehicle that is not named": [
        truth(snapshot=unnamed),
        truth(snapshot=standing("tentative")),
        truth(snapshot=standing("no position")),
    ],
    "names older than they look": [truth(now_us=lambda moment: moment.frame_us + 4 * S)],
    "name dropped between two frames": [overwrite("fleet", "confirmed", "unknown  ")],
    "value older than it looks": [truth(received=without_position), truth(received=one_silent)],
    "alarm neither visible nor counted": [truth(snapshot=alarmed), in_row(0, " ROLLCALL 7 alarms")],
    "a text that looks like an alarm of this station": [in_row(1, " !! 10:20:04Z UGV-11: no heartbeat")],
    "none of several in green": [green_none],
    "more certain than 99 %": [overwrite("fleet", "confirmed 9", "confirmed100%")],
    "the worst is not in the status bar": [truth(snapshot=dark_disk)],
}


@pytest.mark.parametrize(
    ("rule", "number"), [(rule, number) for rule, changes in DAMAGE.items() for number in range(len(changes))]
)
def test_each_rule_finds_what_was_damaged(shot, rule, number):
    assert rule not in found(shot.screen, shot.moment), "it is wrong before"
    assert rule in found(*DAMAGE[rule][number](shot))


def test_a_clock_that_goes_back_is_found(shot):
    checker = Checker()
    checker.check(shot.screen, shot.moment)
    earlier = in_row(0, " ROLLCALL ● REC 00:00  00:00:01Z")(shot)
    assert "clock that goes back" in {violation.rule for violation in checker.check(*earlier)}


@pytest.mark.parametrize(("number", "damaged"), [(77, False), (78, True)])
def test_the_number_of_a_box_without_a_name_is_no_damaged_name(shot, number, damaged):
    snapshot = shot.moment.snapshot
    name = snapshot.name_of(snapshot.boxes[0].system_id)
    screen = written(shot.screen, *place(shot.screen, "video", name), "#77".ljust(len(f"{name} 99%")))
    boxes = (replace(snapshot.boxes[0], system_id=0, number=number), *snapshot.boxes[1:])
    moment = replace(shot.moment, snapshot=replace(snapshot, boxes=boxes))
    assert ("damaged name on the video" in found(screen, moment)) is damaged
