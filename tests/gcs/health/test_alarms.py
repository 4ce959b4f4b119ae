from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.health.alarms import Alarms
from gcs.health.event_throttle import EventThrottle
from gcs.health.link_rates import LinkRates
from gcs.snapshot import Event, Health, LinkHealth, VehicleRow
from mavlink.state import VehicleCondition
from tests.support.fake_station import START_US, make_snapshot

LINK = LinkHealth(name="udpin:0.0.0.0:14550", packets=100, bad=0, dropped=0, silent_s=0.0)
WELL = Health(video="ok", links=(LINK,), free_bytes=50_000_000_000, keys=1)
ROWS = tuple(
    VehicleRow(system_id=i, name=name, role=role, heartbeat_age_s=0.3, position_age_s=0.2, position_state="ok")
    for i, name, role in ((1, "UAV", "uav"), (11, "UGV-11", "ugv"), (12, "UGV-12", "ugv"))
)
BASE = replace(make_snapshot(), vehicles=ROWS, boxes=(), health=WELL, image=None, pose="known")


TURNED = replace(WELL, fit=0.99)
MEASURED = replace(TURNED, yaw_offset=0.0, pitch_offset=0.0, yaw_offset_std=0.02, pitch_offset_std=0.02)
SETTLED = replace(MEASURED, time_offset_std_s=0.02)


class Watch:
    """Snapshots ten times a second."""

    def __init__(self):
        self.alarms, self.t_us = Alarms(), START_US
        self.active, self.events = (), []

    def see(self, seconds, rows=None, health=WELL, **more):
        for _ in range(round(seconds * 10)):
            self.t_us += 100_000
            snapshot = replace(BASE, t_us=self.t_us, vehicles=rows or ROWS, health=health, **more)
            self.active, events = self.alarms.update(snapshot)
            self.events += events
        return {alarm.key: alarm for alarm in self.active}


def changed(index, **fields):
    return tuple(replace(row, **fields) if k == index else row for k, row in enumerate(ROWS))


@pytest.fixture
def watch():
    return Watch()


def test_nothing_wrong_nothing_said(watch):
    assert watch.see(30) == {} and watch.events == []


@pytest.mark.parametrize(
    ("rows", "key", "level"),
    [
        (changed(1, position_state="stale"), "position 11", "warning"),
        (changed(1, position_state="lost"), "position 11", "alarm"),
        (changed(1, position_state="refused", refused_for="jump"), "refused 11 jump", "alarm"),
        (changed(1, heartbeat_age_s=4.0, position_state="lost"), "silent 11", "alarm"),
        (changed(2, contested=True), "contested 12", "alarm"),
        (changed(2, heartbeat_age_s=math.inf, position_age_s=math.inf, position_state="never"), "unheard", "warning"),
        (changed(2, position_state="never"), "no position 12", "warning"),
        (changed(2, clock_fault="x"), "clock 12", "warning"),
        (changed(2, doubted_for="GPS glitch"), "doubted 12", "alarm"),
        (changed(2, compass_doubted=True), "compass 12", "alarm"),
    ],
)
def test_every_trouble_of_a_vehicle_is_one_alarm_raised_once_and_cleared_once(watch, rows, key, level):
    active = watch.see(20, rows)
    assert {k: alarm.level for k, alarm in active.items()} == {key: level}
    assert active[key].advice and active[key].text
    assert watch.see(20) == {}
    said = [event for event in watch.events if event.level != "info"]
    assert len(said) == (0 if key.startswith("contested") else 1)
    assert [event.text[:4] for event in watch.events if event.level == "info"] == ["over"] * len(said)


@pytest.mark.parametrize(
    ("health", "key", "level"),
    [
        (replace(WELL, links=(replace(LINK, silent_s=4.0),)), "link udpin:0.0.0.0:14550", "alarm"),
        (replace(WELL, links=(replace(LINK, silent_s=math.inf),)), "no packet udpin:0.0.0.0:14550", "alarm"),
        (replace(WELL, links=(replace(LINK, silent_s=math.nan),)), "link udpin:0.0.0.0:14550", "alarm"),
        (replace(WELL, video="stalled"), "video", "alarm"),
        (replace(WELL, lag_s=1.5), "lag", "warning"),
        (replace(WELL, behind_s=2.5), "overload", "alarm"),
        (replace(WELL, time_offset_s=0.8, time_offset_std_s=0.02), "video clock", "warning"),
        (replace(WELL, fit=0.001), "no match", "alarm"),
        (replace(WELL, fit=0.05), "match not known", "warning"),
        (replace(WELL, views_differ="Car is Bus by North"), "views differ", "alarm"),
        (replace(TURNED, yaw_offset=-1.6, yaw_offset_std=0.02), "camera heading", "warning"),
        (replace(TURNED, pitch_offset=0.25, pitch_offset_std=0.02), "camera pitch", "warning"),
        (replace(WELL, clock_step_s=-3600.0), "clock step", "warning"),
        (replace(WELL, write_failing_s=0.4, write_reason="No space left on device"), "disk", "alarm"),
        (replace(WELL, write_stalled_s=1.2), "disk hangs", "alarm"),
        (replace(WELL, free_bytes=1_000_000_000), "disk space", "warning"),
        (replace(WELL, full_in_s=500.0), "disk space", "warning"),
        (replace(WELL, full_in_s=100.0), "disk space", "alarm"),
        (replace(WELL, keys=0), "no keys", "warning"),
    ],
)
def test_every_trouble_of_the_station_is_an_alarm(watch, health, key, level):
    active = watch.see(12, health=health)
    assert {k: alarm.level for k, alarm in active.items()} == {key: level}
    assert watch.see(10, health=SETTLED) == {}


def test_a_film_is_not_said_to_be_of_something_else_where_hardly_a_frame_is_looked_at(watch):
    assert watch.see(12, health=replace(WELL, fit=0.001, fps=0.5)) == {}


@pytest.mark.parametrize(
    ("found", "key"),
    [
        (replace(SETTLED, time_offset_s=0.8), "video clock"),
        (replace(SETTLED, fit=0.001), "no match"),
        (replace(SETTLED, yaw_offset=-1.6), "camera heading"),
        (replace(SETTLED, pitch_offset=0.25), "camera pitch"),
        (replace(SETTLED, mirrored=True), "camera mirrored"),
    ],
)
def test_what_is_wrong_with_the_camera_is_not_over_while_nobody_knows(watch, found, key):
    assert set(watch.see(12, health=found)) == {key}
    assert set(watch.see(60)) == {key}, "the estimate begins anew, or little is seen"
    assert watch.see(10, health=SETTLED) == {}


@pytest.mark.parametrize("what", ["arming", "faults"])
def test_what_a_vehicle_says_is_not_over_when_it_falls_silent(watch, what):
    condition = VehicleCondition(**{what: ("compass",)})
    watch.see(15, changed(1, condition=condition))
    active = watch.see(20, changed(1, condition=condition, heartbeat_age_s=20.0, position_state="lost"))
    assert set(active) == {"silent 11", {"arming": "arming 11", "faults": "part 11"}[what]}
    assert watch.see(10) == {}


@pytest.mark.parametrize(
    ("health", "rows", "key"),
    [
        (replace(WELL, links=(replace(LINK, dropped=5),)), ROWS, "dropped udpin:0.0.0.0:14550"),
        (replace(WELL, ingest_restarts=1), ROWS, "ingest"),
        (replace(WELL, ring_dropped=9), ROWS, "ring"),
        (replace(WELL, undecoded=9), ROWS, "undecoded"),
        (replace(WELL, write_lost=9), ROWS, "lost"),
        (WELL, changed(1, bad_signature=2), "signature 11"),
        (WELL, changed(1, unsigned=2), "unsigned 11"),
        (WELL, changed(1, bad_signature=2, replayed=2), "replay 11"),
    ],
)
def test_a_counter_that_grew_is_an_alarm_for_a_while(watch, health, rows, key):
    watch.see(5)
    assert set(watch.see(9, rows, health)) == {key}
    assert watch.see(10, rows, health) == {}
    assert len(watch.events) == (0 if key in ("lost", "signature 11", "unsigned 11", "replay 11") else 2)


@pytest.mark.parametrize(("heard_s", "state"), [(math.inf, "never"), (200.0, "lost")])
def test_a_vehicle_that_is_held_is_an_alarm_after_three_seconds_and_not_unheard(watch, heard_s, state):
    rows = changed(1, heartbeat_age_s=heard_s, position_state=state, held=30, held_s=1700.0)
    assert watch.see(2.5, rows) == {}
    active = watch.see(20, rows)
    assert {key: alarm.level for key, alarm in active.items()} == {"held 11": "alarm"}
    assert "b accepts it" in active["held 11"].advice


def test_unsigned_packets_without_keys_are_only_told_as_such(watch):
    assert set(watch.see(9, changed(1, unsigned=2), replace(WELL, keys=0))) == {"no keys"}


def test_conflict_with_the_frame(watch):
    assert watch.see(1, conflicts=frozenset({12}))["conflict 12"].system_id == 12
    assert set(Watch().see(5, conflicts=frozenset({12}), pose="no attitude")) == {"attitude 1"}
    assert set(watch.see(10, conflicts=frozenset({12}), pose="no attitude")) == {"conflict 12", "attitude 1"}


def test_getting_worse_is_told_and_is_the_same_alarm(watch):
    first = watch.see(5, changed(1, position_state="stale"))["position 11"]
    second = watch.see(5, changed(1, position_state="lost"))["position 11"]
    assert second.since_us == first.since_us and second.level == "alarm"
    assert [event.level for event in watch.events] == ["warning", "alarm"]


def test_each_trouble_of_one_vehicle_comes_and_goes_for_itself(watch):
    watch.see(5, changed(1, position_state="refused", refused_for="0/0"))
    watch.see(5, changed(1, position_state="refused", refused_for="jump"))
    watch.see(5, changed(1, heartbeat_age_s=9.0, position_state="lost", refused_for="jump"))
    assert {alarm.key for alarm in watch.active} == {"refused 11 jump", "silent 11"}
    watch.see(12, changed(1, position_state="lost", clock_fault="x"))
    watch.see(20)
    refused = "its positions cannot be right"
    told = [event.text.removeprefix("UGV-11: ").replace("UGV-11: ", "") for event in watch.events]
    coming = [text for text in told if not text.startswith("over")]
    assert coming == [f"{refused}: 0/0", f"{refused}: jump", "no heartbeat", "position lost", "its clock is wrong: x"]
    assert sorted(text.partition(" s: ")[2] for text in told if text.startswith("over")) == sorted(coming)


def test_a_trouble_that_a_silent_vehicle_had_before_is_not_over_while_it_is_silent(watch):
    watch.see(5, changed(1, position_state="lost"))
    watch.see(30, changed(1, heartbeat_age_s=30.0, position_state="lost"))
    assert [event.text for event in watch.events] == ["UGV-11: position lost", "UGV-11: no heartbeat"]
    assert {alarm.key for alarm in watch.active} == {"position 11", "silent 11"}
    assert watch.see(5) == {} and len(watch.events) == 4


def silent(age_s):
    """How a vehicle looks that beats once a second, reports ten times a second and has been silent for so long."""
    state = "ok" if age_s < 1 else "stale" if age_s < 3 else "lost"
    return changed(1, heartbeat_age_s=age_s + 0.5, position_age_s=age_s, position_state=state)


def test_one_that_falls_silent_and_comes_back_is_one_trouble(watch):
    for tenth in range(80):
        watch.see(0.1, silent(tenth * 0.1))
    watch.see(3.2, changed(1, position_state="ok"))
    watch.see(0.3, changed(1, position_state="stale"))
    watch.see(10)
    assert [event.text.split(": ")[-1] for event in watch.events] == ["no heartbeat", "no heartbeat"]
    assert [event.level for event in watch.events] == ["alarm", "info"]


def test_what_stays_of_a_trouble_is_told_once_it_has_lasted(watch):
    watch.see(8, changed(1, heartbeat_age_s=9.0, position_state="lost"))
    watch.see(8, changed(1, position_state="stale"))
    told = ["UGV-11: no heartbeat", "UGV-11: position stale", "over after 8 s: UGV-11: no heartbeat"]
    assert [event.text for event in watch.events] == told
    assert [alarm.level for alarm in watch.active] == ["warning"]


def test_a_uav_without_attitude_is_an_alarm_unless_it_is_silent_altogether(watch):
    assert watch.see(2.5, pose="no attitude") == {}
    assert watch.see(1, pose="no attitude")["attitude 1"].text == "UAV: no attitude"
    gone = changed(0, heartbeat_age_s=9.0, position_state="lost")
    assert set(Watch().see(20, gone, pose="no attitude")) == {"silent 1"}


def test_the_present_reason_is_told_not_the_most_frequent(watch):
    often = {"altitude, far from the ground": 500, "0/0": 3}
    active = watch.see(5, changed(1, position_state="refused", refusals=often, refused_for="0/0"))
    assert active["refused 11 0/0"].text == "UGV-11: its positions cannot be right: 0/0"


def test_bytes_that_are_no_mavlink_are_told_as_such(watch):
    garbled = replace(LINK, packets=0, junk_bytes=4000, silent_s=math.inf)
    ((key, alarm),) = watch.see(12, health=replace(WELL, links=(garbled,))).items()
    assert key.startswith("junk ")
    assert alarm.text.endswith("what is received is no MAVLink") and "baud" in alarm.advice


@pytest.mark.parametrize(
    ("index", "junk_per_s", "silent_s", "told"),
    [
        (1, 900.0, 3.6, ": its link brings garbled bytes"),
        (1, 900.0, 0.1, ": its link brings garbled bytes, perhaps its own"),
        (0, 900.0, 0.0, ""),
        (1, 3.0, 0.0, ""),
        (1, math.nan, math.nan, ""),
        (-1, 900.0, 0.0, ""),
    ],
)
def test_a_silent_vehicle_is_told_with_what_its_link_brings(watch, index, junk_per_s, silent_s, told):
    brings = {"index": index, "junk_per_s": junk_per_s, "silent_s": silent_s}
    links = LINK, replace(LINK, name="/dev/ttyUSB0", **brings)
    silent = changed(1, heartbeat_age_s=9.0, position_state="lost", link=1)
    alarm = watch.see(1, silent, health=replace(WELL, links=links))["silent 11"]
    assert alarm.text == f"UGV-11: no heartbeat{told}"
    assert alarm.text in {event.text for event in watch.events}


def test_heartbeats_that_a_bad_link_swallows_are_no_loss_while_positions_come(watch):
    assert watch.see(20, changed(1, heartbeat_age_s=6.0)) == {}
    assert set(watch.see(1, changed(1, heartbeat_age_s=11.0))) == {"silent 11"}


def test_short_troubles_are_no_alarms(watch):
    for _ in range(20):
        watch.see(0.5, changed(1, position_state="stale"))
        watch.see(0.5)
    assert watch.events == []


def test_coming_and_going_does_not_flap(watch):
    for _ in range(100):
        watch.see(2, changed(1, heartbeat_age_s=4.0, position_state="lost"))
        watch.see(4)
    # 100 losses in ten minutes
    assert 2 <= len(watch.events) <= 12
    assert watch.see(60) == {}


def test_time_that_steps_back_raises_nothing(watch):
    watch.see(5, changed(1, position_state="lost"))
    watch.t_us -= 3_600_000_000
    assert "position 11" in watch.see(5, changed(1, position_state="lost"))
    assert len(watch.events) == 1


def test_the_worst_and_newest_come_first(watch):
    watch.see(5, changed(1, position_state="stale"))
    watch.see(5, changed(1, position_state="stale"), replace(WELL, links=(replace(LINK, silent_s=9.0),)))
    watch.see(5, changed(1, position_state="stale"), replace(WELL, links=(replace(LINK, silent_s=9.0),), keys=0))
    assert [alarm.key for alarm in watch.active] == ["link udpin:0.0.0.0:14550", "no keys", "position 11"]


def said(number, *, hz=1000.0, texts=("a",), start_us=START_US, system_id=11):
    return [
        Event(
            t_us=start_us + round(k / hz * 1e6),
            level="info",
            kind="text",
            text=texts[k % len(texts)],
            system_id=system_id,
        )
        for k in range(number)
    ]


def test_a_few_words_pass_as_they_are():
    throttle, words = EventThrottle(), said(20, hz=10.0, texts=("a", "b", "c"))
    assert throttle.admit(words) == words and throttle.overdue(START_US + 60_000_000) == []


def test_a_flood_is_summed_up_and_every_word_is_counted():
    throttle = EventThrottle()
    told = throttle.admit(said(5000, texts=("x", "x", "y")))
    told += throttle.overdue(START_US + 60_000_000)
    assert len(told) <= 20 + 2 * 6 + 6
    held = sum(int(event.text.split(" more")[0]) for event in told if " more" in event.text)
    assert held + sum(" more" not in event.text for event in told) == 5000
    assert any("most often: x × " in event.text for event in told)


def test_one_text_over_and_over_says_how_often():
    throttle = EventThrottle()
    told = throttle.admit(said(1020)) + throttle.overdue(START_US + 60_000_000)
    assert "a × " in told[-1].text


@pytest.mark.slow
def test_a_disk_that_fills_says_what_is_left_once_for_each_level(watch):
    for minute in range(30, 0, -1):
        watch.see(60, health=replace(WELL, free_bytes=minute * 120 * 10**6, full_in_s=60.0 * minute))
    told = [(event.level, event.text) for event in watch.events if "the disk" in event.text]
    assert told == [
        ("warning", "the disk will be full soon: 1,920 MB free, 16.0 min at this rate"),
        ("alarm", "the disk is almost full: 120 MB free, 1.0 min at this rate"),
    ]


def test_one_that_is_heard_and_refused_is_not_called_unheard(watch):
    rows = changed(2, heartbeat_age_s=math.inf, position_state="never", bad_signature=3)
    assert "unheard" not in watch.see(20, rows)


def test_one_flooding_vehicle_does_not_silence_another():
    throttle = EventThrottle()
    throttle.admit(said(5000))
    other = said(3, system_id=12)
    assert throttle.admit(other) == other


def test_rates_of_the_links():
    rates = LinkRates()
    for second in range(90):
        link = replace(LINK, packets=500 * second, junk_bytes=70 * second)
        health = rates.with_rates(START_US + second * 1_000_000, replace(WELL, links=(link,)))
        if second == 0:
            assert math.isnan(health.links[0].packets_per_s)
    assert (health.links[0].packets_per_s, health.links[0].junk_per_s) == pytest.approx((500.0, 70.0))
    assert rates.with_rates(START_US, replace(WELL, links=())) == replace(WELL, links=())
