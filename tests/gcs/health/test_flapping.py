"""What keeps coming back is told as that, with how often; the first sentence is said only while it is so."""

from dataclasses import replace

import pytest

from gcs.health.alarms import Alarms
from gcs.snapshot import Health, LinkHealth, VehicleRow
from tests.support.fake_station import START_US, make_snapshot

LINK = LinkHealth(name="udp", packets=100, bad=0, dropped=0, silent_s=0.0)
WELL = Health(video="ok", links=(LINK,), free_bytes=50_000_000_000, keys=1)
ROWS = tuple(
    VehicleRow(system_id=i, name=name, role=role, heartbeat_age_s=0.3, position_age_s=0.2, position_state="ok")
    for i, name, role in ((1, "UAV", "uav"), (11, "UGV-11", "ugv"))
)
BASE = replace(make_snapshot(), vehicles=ROWS, boxes=(), image=None, pose="known", health=WELL)
STALLED = {"health": replace(WELL, video="stalled")}
SILENT = {"vehicles": (ROWS[0], replace(ROWS[1], heartbeat_age_s=4.0, position_state="lost"))}
REFUSED = {"vehicles": (ROWS[0], replace(ROWS[1], position_state="refused", refused_for="jump"))}
CUT = {"health": replace(WELL, links=(replace(LINK, silent_s=4.0),))}


class Flight:
    """Snapshots ten times a second."""

    def __init__(self):
        self.alarms, self.t_us, self.log, self.events = Alarms(), START_US, [], []

    def see(self, seconds, **now):
        for _ in range(round(seconds * 10)):
            self.t_us += 100_000
            active, events = self.alarms.update(replace(BASE, **now, t_us=self.t_us))
            self.log.append((self.t_us, bool(now), active))
            self.events += events
        return {alarm.key: alarm for alarm in active}


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("on_s", "off_s"), [(1.2, 1.0), (2.0, 2.0), (1.3, 4.0), (8.0, 12.0)])
@pytest.mark.parametrize(("wrong", "key"), [(STALLED, "video"), (CUT, "link udp"), (SILENT, "silent 11")])
def test_the_sentence_is_never_said_of_what_has_been_well_for_three_seconds(wrong, key, on_s, off_s):
    flight = Flight()
    for _ in range(15):
        flight.see(on_s, **wrong)
        flight.see(off_s)
    well_since = 0
    for t_us, is_wrong, active in flight.log:
        well_since = 0 if is_wrong else well_since or t_us
        if well_since and t_us - well_since >= 3_000_000:
            assert key not in {alarm.key for alarm in active}
    last = {alarm.key: alarm for alarm in flight.log[-1][2]}
    assert last[f"{key} on and off"].level == "warning"
    assert ": 15 times in " in last[f"{key} on and off"].text
    assert flight.see(60) == {}
    assert len(flight.events) <= 6
    assert [event.over for event in flight.events[-2:]] == [False, True]


def test_the_video_that_comes_and_goes_has_its_own_words_and_count():
    flight = Flight()
    for _ in range(6):
        flight.see(2, **STALLED)
        flight.see(22)
    (alarm,) = flight.see(1.2, **STALLED).values()
    assert alarm.text == "the video comes and goes: 7 times in 2 min"
    told = [(event.alarm, event.alarm_level, event.over) for event in flight.events]
    plain = [("video", "alarm", False), ("video", "alarm", True)]
    assert told == [*plain, *plain, ("video on and off", "warning", False)]


def test_a_hole_in_the_video_that_is_over_before_anybody_acts_is_no_alarm():
    """Frames come a second late now and then on a computer under load: names are held meanwhile."""
    flight = Flight()
    for _ in range(6):
        assert flight.see(0.9, **STALLED) == {}
        flight.see(5)
    assert flight.events == []
    flight.see(1.2, **STALLED)
    flight.see(5)
    assert [event.text for event in flight.events] == ["the video has stopped", "over after 1 s: the video has stopped"]


def test_what_comes_and_goes_and_then_stays_is_said_as_it_is():
    flight = Flight()
    for _ in range(5):
        flight.see(2, **STALLED)
        flight.see(2)
    assert set(flight.see(9, **STALLED)) == {"video on and off"}
    assert set(flight.see(5, **STALLED)) == {"video on and off", "video"}
    assert set(flight.see(4)) == {"video on and off"}


def test_a_name_that_is_not_to_be_acted_on_stays_so_while_it_comes_and_goes():
    flight = Flight()
    for _ in range(6):
        flight.see(2, **REFUSED)
        flight.see(5)
    (alarm,) = flight.see(0.1).values()
    assert alarm.text.startswith("UGV-11: again and again: its positions cannot be right: jump, 6 times in ")
    assert (alarm.level, alarm.doubts_name, alarm.system_id) == ("alarm", True, 11)


def test_a_counter_that_grows_now_and_then_stays_an_alarm():
    flight = Flight()
    for count in range(1, 8):
        flight.see(0.1, health=replace(WELL, ingest_restarts=count))
        active = flight.see(13.9, health=replace(WELL, ingest_restarts=count))
    assert {alarm.level for alarm in active.values()} == {"alarm"}
    assert next(iter(active.values())).text.startswith("again and again: the receiving process had")


def test_a_gap_of_a_moment_is_not_another_time():
    flight = Flight()
    for _ in range(20):
        flight.see(2, **STALLED)
        flight.see(0.3)
    assert set(flight.see(0.1, **STALLED)) == {"video"} and len(flight.events) == 1
