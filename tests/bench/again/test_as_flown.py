"""What the flight itself reported is shown beside what its replay works out again, and marked where they differ."""

import json
from dataclasses import replace

import pytest

from gcs.health.alarm_rules import findings, reported_alarm
from gcs.playback.as_flown import FlownReports
from gcs.playback.replay import Replay
from gcs.session.session import open_session
from gcs.snapshot import Alarm, Event, LinkHealth
from sim.world.presets import nominal
from sim.world.scenario import ScenarioGround
from tests.support.fake_station import START_US, make_snapshot
from tests.support.scripted import InjectedFaults, fly
from tests.support.waiting import until

S = 1_000_000
SCENARIO = replace(nominal(3), ground=ScenarioGround(kind="curved", vehicles=4, spacing_m=8.0), duration_s=10.0)
HOLE = InjectedFaults(no_video=((4.0, 7.5),), no_telemetry=(3.0, 8.0))


def event(seconds, text, level="info", kind="vehicle", system_id=0, **more):
    t_us = START_US + round(seconds * S)
    return Event(t_us=t_us, level=level, kind=kind, text=text, system_id=system_id, **more)


def reports(*events, until_s=100):
    return FlownReports(events, START_US, START_US + until_s * S)


def alarm(key, since_s, text, kind="vehicle", system_id=0):
    since_us = START_US + round(since_s * S)
    return Alarm(key=key, level="alarm", kind=kind, text=text, advice="", since_us=since_us, system_id=system_id)


def marks(found):
    return [(each.text, each.reported) for each in found]


def test_events_of_both_are_shown_once_and_others_are_marked():
    both = reports(
        event(1, "UGV-11: no heartbeat", "alarm", system_id=11),
        event(2, "track 3 is UGV-11 (100%)", kind="identity", system_id=11),
        event(3, "track 4 is UGV-12 (97%)", kind="identity", system_id=12),
        event(4, "udp: nothing is received any more", "alarm", kind="link"),
        event(5, "Reached waypoint #3", kind="text", system_id=11),
    )
    again = [
        event(1.4, "UGV-11: no heartbeat", "alarm", system_id=11),
        event(2, "track 3 is UGV-11 (99%)", kind="identity", system_id=11),
        event(3, "track 4 is UGV-13 (97%)", kind="identity", system_id=13),
        event(5, "UGV-11 says: Reached waypoint #3", kind="text", system_id=11),
    ]
    both.add(START_US + 6 * S, again, ())
    assert not any(each.reported == "then" for each in both.events()), "it may still be found"
    both.add(START_US + 60 * S, (), ())
    assert marks(both.events()) == [
        ("UGV-11: no heartbeat", ""),
        ("track 3 is UGV-11 (100%)", ""),
        ("track 4 is UGV-12 (97%)", "then"),
        ("track 4 is UGV-13 (97%)", "now"),
        ("udp: nothing is received any more", ""),
        ("Reached waypoint #3", ""),
    ]


def test_an_alarm_that_the_flight_raised_twice_and_its_replay_once_is_two():
    key, text = "flapping 0", "the video comes and goes"
    told = {"kind": "video", "alarm": key, "alarm_level": "alarm"}
    both = reports(
        event(2, text, "alarm", **told),
        event(33, f"over after 31 s: {text}", over=True, **told),
        event(37, text, "alarm", **told),
        event(90, f"over after 53 s: {text}", over=True, **told),
    )
    for k in range(1, 96):
        both.add(START_US + k * S, (), [alarm(key, 1, text, kind="video")])
    spans = [span for span in both.spans() if span.alarm.key == key]
    begin, end = (
        [round((us - START_US) / S) for us in each]
        for each in zip(*[(span.alarm.since_us, span.until_us) for span in spans], strict=True)
    )
    assert (begin, end) == ([1, 37], [37, 95])
    assert all(span.alarm.reported == "" for span in spans)


def test_what_is_said_twice_is_shown_twice():
    both = reports(*[event(k, "Mission: 1 WP", kind="text", system_id=11) for k in (1, 2)])
    for k in (1, 2, 3):
        both.add(START_US + k * S, [event(k, "Mission: 1 WP", kind="text", system_id=11)], ())
    assert [each.reported for each in both.events()] == ["", "", "now"]


def test_a_recording_without_reports_marks_nothing():
    alone = reports()
    alone.add(START_US, [event(1, "UGV-11: no heartbeat", "alarm", system_id=11)], ())
    on = alarm("silent 11", 1, "UGV-11: no heartbeat", system_id=11)
    assert [each.reported for each in alone.events()] == [""]
    assert alone.alarms(START_US + 2 * S, [on]) == (on,)


def test_alarms_of_the_flight_come_and_go_and_are_acknowledged():
    flight = reports(
        event(2, "udp: nothing is received any more", "alarm", kind="link"),
        event(4, "seen: udp: nothing is received any more", kind="operator"),
        event(5, "UGV-11: position stale", "warning", system_id=11),
        event(7, "UGV-11: position lost", "alarm", system_id=11),
        event(9, "over after 4 s: UGV-11: position lost", system_id=11),
        event(20, "over after 18 s: udp: nothing is received any more", kind="link"),
        event(21, "the old words for it", "alarm", kind="video"),
        event(23, "over after 2 s: the old words for it", kind="video"),
        event(24, "a single line", "alarm", kind="video"),
    )
    flight.add(START_US + 90 * S, (), ())

    def on(seconds):
        return [(a.key, a.level, a.acknowledged, a.reported) for a in flight.alarms(START_US + round(seconds * S), ())]

    link = "link udp"
    assert on(1) == [] and on(3) == [(link, "alarm", False, "")]
    assert on(4.5) == [(link, "alarm", True, "")], "links are not recorded, so that nothing contradicts the flight"
    assert on(6) == [(link, "alarm", True, ""), ("position 11", "warning", False, "then")]
    assert on(8) == [(link, "alarm", True, ""), ("position 11", "alarm", False, "then")]
    assert on(10) == [(link, "alarm", True, "")] and on(22) == [("the old words for it", "alarm", False, "")]
    assert on(25) == []


def test_an_alarm_whose_words_changed_is_over_all_the_same():
    flight = reports(
        event(2, "UGV-11: its positions cannot be right: a jump", "alarm", system_id=11),
        event(3, "UGV-12: no heartbeat", "alarm", system_id=12),
        event(9, "the disk will be full soon: 900 MB free", "warning", kind="recording"),
        event(33, "over after 26 s: UGV-12: the old words", system_id=12),
        event(40, "over after 28 s: the disk will be full soon: 700 MB free", kind="recording"),
        event(50, "the end"),
    )
    keys = {seconds: {a.key for a in flight.alarms(START_US + seconds * S, ())} for seconds in (10, 34, 41)}
    refused = "refused 11 a jump"
    assert keys == {10: {refused, "silent 12", "disk space"}, 34: {refused, "disk space"}, 41: {refused}}


def test_an_alarm_that_only_one_of_them_has_still_is_marked_from_then_on():
    flight = reports(event(2, "UGV-11: no heartbeat", "alarm", system_id=11), event(60, "the end"))
    same = alarm("silent 11", 2, "UGV-11: no heartbeat", system_id=11)
    flight.add(START_US + 20 * S, (), (same,))
    flight.finish()
    assert [each.reported for each in flight.alarms(START_US + 22 * S, ())] == [""]
    assert [each.reported for each in flight.alarms(START_US + 40 * S, ())] == ["then"]


def told(seconds, key, text, level="alarm", *, over=False, kind="vehicle", system_id=0):
    """An event with the alarm that it tells of."""
    more = {"alarm": key, "alarm_level": level, "over": over}
    return event(seconds, text, "info" if over else level, kind, system_id, **more)


def test_alarms_are_read_by_their_keys_whatever_their_words_are():
    flight = reports(
        told(2, "conflict 11", "Bravo: words of another version", kind="identity", system_id=11),
        told(3, "video on and off", "the video comes and goes: 3 times in 9 s", "warning", kind="video"),
        event(4, "seen: Bravo", kind="operator", alarm="conflict 11"),
        told(5, "near 11 12", "A: b and C: too near each other: 2.0 m"),
        event(6, "UGV-12: no heartbeat", "alarm", system_id=12),
        told(9, "conflict 11", "over after 6 s: other words", over=True, kind="identity", system_id=11),
        told(40, "video on and off", "over after 30 s: the video comes and goes", "warning", over=True, kind="video"),
        event(50, "the end"),
    )
    on = {seconds: {a.key: a for a in flight.alarms(START_US + seconds * S, ())} for seconds in (8, 20, 45)}
    assert [set(found) for found in on.values()] == [
        {"conflict 11", "video on and off", "near 11 12"},
        {"video on and off", "near 11 12"},
        {"near 11 12"},
    ], "what has no key is an event alone"
    assert on[8]["conflict 11"].acknowledged and on[8]["conflict 11"].doubts_name
    assert on[8]["video on and off"].level == "warning" and "camera" in on[8]["video on and off"].advice


def test_an_alarm_with_another_figure_in_the_replay_is_the_same():
    flight = reports(
        told(2, "near 11 12", "A and B: too near each other: 2.0 m"),
        told(9, "near 11 12", "over after 4 s: A and B: too near each other: 2.0 m", over=True),
    )
    again = [
        told(2.4, "near 11 12", "A and B: too near each other: 1.8 m"),
        told(9.2, "near 11 12", "over after 5 s: A and B: too near each other: 1.8 m", over=True),
    ]
    flight.add(START_US + 60 * S, again, ())
    assert [each.reported for each in flight.events()] == ["", ""]


def test_an_alarm_of_both_is_one_and_one_of_the_replay_alone_is_marked():
    flight = reports(
        event(2, "UGV-11: no heartbeat", "alarm", system_id=11), event(3, "seen: UGV-11: no heartbeat", kind="operator")
    )
    same = alarm("silent 11", 2.5, "UGV-11: no heartbeat", system_id=11)
    other = alarm("silent 12", 3, "UGV-12: no heartbeat", system_id=12)
    flight.add(START_US + 4 * S, (), (same, other))
    shown = flight.alarms(START_US + 4 * S, (same, other))
    assert {(a.key, a.reported, a.acknowledged) for a in shown} == {
        ("silent 11", "", True),
        ("silent 12", "now", False),
    }


def test_events_a_day_away_are_of_a_wrong_clock():
    assert len(reports(event(-90_000, "a"), event(1, "b"), event(200_000, "c")).flown) == 1


def test_every_alarm_is_known_again_by_its_event():
    """Those of a snapshot with all sorts of trouble: key and rule are found from the line in the event log."""
    base = make_snapshot(live=True)
    links = tuple(replace(link, silent_s=9.0, dropped=3) for link in base.health.links)
    links += (LinkHealth(name="x: y", packets=0, bad=0, dropped=0, silent_s=9.0),)
    troubles = {"video": "stalled", "behind_s": 9.0, "keys": 0, "clock_step_s": 5.0, "write_stalled_s": 4.0}
    health = replace(base.health, links=links, **troubles)
    rows = tuple(replace(row, heartbeat_age_s=30.0, position_state="lost") for row in base.vehicles)
    limits = replace(base.limits, separation_m=50.0)
    found = [f for f in findings(replace(base, health=health, vehicles=rows, limits=limits)) if not f.rule.logged_by]
    assert len({f.key for f in found}) > 12
    for finding in found:
        known = reported_alarm(finding.text, finding.rule.kind, finding.system_id)
        assert known is not None and known.rule == finding.rule, finding.text
        assert known.key == finding.key or " and " in known.key


def line_of(t_us, level, kind, system_id, text, **more):
    return json.dumps({"time_us": t_us, "level": level, "kind": kind, "system_id": system_id, "text": text} | more)


def test_events_beside_a_bare_log_are_not_its_own(tmp_path):
    (tmp_path / "events.jsonl").write_text(line_of(START_US, "alarm", "vehicle", 11, "UGV-11: no heartbeat") + "\n")
    (tmp_path / "flight.tlog").write_bytes(b"")
    for recording, events in ((tmp_path, 1), (tmp_path / "flight.tlog", 0)):
        found, trouble = FlownReports.read(recording, START_US, START_US)
        assert (len(found.flown), trouble) == (events, "")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = fly(tmp_path_factory.mktemp("flown"), SCENARIO, HOLE)
    path = folder / "events.jsonl"
    lines = path.read_text().splitlines()
    start_us = SCENARIO.start_us
    silent = next(json.loads(line) for line in lines if "no heartbeat" in line and '"system_id":12' in line)
    lines.remove(next(line for line in lines if "no heartbeat" in line and '"system_id":11' in line))
    extra = [
        line_of(
            *(start_us + 3 * S, "alarm", "vehicle", 13, "UGV-13: position lost"),
            alarm="position 13",
            alarm_level="alarm",
        ),
        line_of(silent["time_us"] + S // 2, "info", "operator", 12, f"seen: {silent['text']}"),
        line_of(start_us + 60 * S, "info", "operator", None, "order: return"),
    ]
    path.write_text("\n".join([*lines, "{broken", *extra]) + "\n")
    return folder


@pytest.mark.slow
def test_a_replay_shows_what_the_operator_saw(flown):
    replay = Replay(open_session(flown))
    try:
        replay.pause()
        assert until(lambda: not replay.title.endswith(")")), replay.error
        assert replay.stop_us == SCENARIO.start_us + 60 * S, "until the last thing that was reported"
        assert replay.start_us <= SCENARIO.start_us
        replay.seek(SCENARIO.start_us + round(7.4 * S))
        assert until(lambda: (replay.latest() or make_snapshot()).t_us > SCENARIO.start_us + 7 * S)
        shown = replay.latest()
        assert {row.standing for row in shown.vehicles[1:]} <= {"no new frame", "no position", "out of view"}
        alarms = {alarm.key: alarm for alarm in shown.alarms}
        assert alarms["silent 12"].acknowledged and not alarms["silent 12"].reported
        assert alarms["silent 11"].reported == "now" and not alarms["silent 11"].acknowledged
        assert alarms["position 13"].reported == "then"
        told = [each.text for each in replay.events()]
        assert "order: return" in told and any("1 lines could not be read" in text for text in told)
        flight = [each for each in replay.events() if each.t_us < SCENARIO.start_us + 10 * S]
        assert sum(each.text == "UGV-12: no heartbeat" for each in flight) == 1
    finally:
        replay.stop()
