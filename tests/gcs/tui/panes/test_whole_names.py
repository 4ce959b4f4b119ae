"""Names are never cut where other text may be: the log, the row of alarms, the fleet's table."""

from dataclasses import replace

import pytest
from rich.cells import cell_len

from gcs.snapshot import Alarm, Event
from gcs.tui.draw.strips import cut_between_words, folded
from gcs.tui.panes.banner import alert_of
from tests.support.fake_station import START_US, FakeStation, make_snapshot, running, text_of

NAMES = ("UGV-1", "UGV-16", "Hauler North 7")


@pytest.mark.parametrize(
    ("text", "width", "cut"),
    [
        ("track 1 is UGV-16", 17, "track 1 is UGV-16"),
        ("track 1 is UGV-16 (99%)", 18, "track 1 is …"),  # "UGV-16 …" takes one more
        ("track 1 is UGV-16 (99%)", 19, "track 1 is UGV-16 …"),
        ("track 1 is UGV-16", 16, "track 1 is …"),  # not UGV-1
        ("near Hauler North 7 now", 21, "near Hauler North 7 …"),
        ("near Hauler North 7 now", 19, "near …"),  # not Hauler North
        ("W" * 30, 6, "WWWW …"),
        ("漢字漢字 a", 8, "漢字漢 …"),
        ("ab", 1, "…"),
        ("ab", 0, ""),
    ],
)
def test_a_text_is_cut_between_words_and_never_in_a_name(text, width, cut):
    assert cut_between_words(text, width, NAMES) == cut


async def test_the_log_and_the_fleet_show_whole_names_or_none():
    long = "Hauler North Seven"
    base = make_snapshot(live=True)
    rows = tuple(replace(row, name=long) if row.system_id == 11 else row for row in base.vehicles)
    station = FakeStation(live=True, snapshot=replace(base, vehicles=rows))
    station.said = [Event(t_us=START_US, level="info", kind="identity", text=f"track 3 is {long}", system_id=11)]
    async with running(station, size=(60, 30)) as (app, _, _):
        assert "track 3 is " in text_of(app._events)
        fleet = text_of(app.query_one("#fleet"))
        assert " 11 " in fleet and "Hauler" not in fleet
    async with running(station, size=(160, 48)) as (app, _, _):
        assert long in text_of(app.query_one("#fleet"))


def test_an_alarm_that_is_over_is_no_longer_in_the_row():
    base = make_snapshot(live=True)
    came = Event(t_us=base.t_us - 5_000_000, level="alarm", kind="video", text="the video has stopped")
    went = replace(came, t_us=base.t_us - 1_000_000, level="info", text="over after 4 s: the video has stopped")
    assert alert_of(base, [came], frozenset()).level == "warning", "there is no alarm in the list"
    assert alert_of(base, [came, went], frozenset()).level == "calm"


def test_an_alarm_that_was_acknowledged_is_not_loud_again_from_the_log():
    base = make_snapshot(live=True)
    text = "the video has stopped"
    alarm = Alarm(key="video", level="alarm", kind="video", text=text, advice="look", since_us=base.t_us - 1_000_000)
    came = Event(t_us=alarm.since_us, level="alarm", kind="video", text=text)
    seen = frozenset({(alarm.key, alarm.since_us, alarm.level)})
    assert alert_of(replace(base, alarms=(alarm,)), [came], seen).level == "calm"


@pytest.mark.parametrize("name", ["Hauler North 7", "漢字 15", "UGV-16"])
@pytest.mark.parametrize("width", range(14, 40))
def test_a_fold_is_never_within_a_name_and_loses_no_word(name, width):
    text = f"6 named: Bravo-2 (89%), 漢字-15 (89%), {name} (89%), UGV-1 (91%)"
    lines = folded(text, width, (name,))
    assert " ".join(lines) == text
    assert any(name in each for each in lines)
    assert max(map(cell_len, lines)) <= width
