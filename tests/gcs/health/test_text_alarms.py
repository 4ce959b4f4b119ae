"""What vehicles say is never taken for what this program found out, and is an alarm until it was acknowledged."""

from dataclasses import replace

import msgspec
import pytest

from gcs.health.alarms import GONE_US, MAX_TEXTS
from gcs.session.event_log import event_row
from gcs.snapshot import Alarm, Event
from gcs.tui.panes.alarms import alike, text_of
from mavlink.protocol.packet import Auth
from tests.support.alarm_scenes import OTHER, UGV, Scene, Vehicle
from tests.support.flights import S

CRITICAL, INFO = 2, 6


class Speaker(Vehicle):
    """Says what is in ``words`` within the next second, once."""

    words = ()

    def frames(self, t_us):
        yield from super().frames(t_us)
        yield from (self.speaker.statustext(text, severity) for text, severity in self.words)
        self.words = ()


class Heard(Scene):
    """A scene that keeps the newest snapshot, and how alarms are acknowledged in it."""

    def keep(self, snapshot):
        super().keep(snapshot)
        self.now = snapshot

    @property
    def said(self):
        return [alarm for alarm in self.now.alarms if alarm.kind == "text"]

    def acknowledge(self, alarm):
        self.pipeline.add_event(
            Event(t_us=self.t_us, level="info", kind="operator", text=f"seen: {alarm.text}", alarm=alarm.key)
        )


@pytest.fixture
def scene():
    return Heard(Speaker(OTHER), Speaker(UGV)).run(1)


def say(scene, *texts, severity=CRITICAL, seconds=0.2):
    scene.vehicles[0].words = [(text, severity) for text in texts]
    return scene.run(seconds)


def test_a_text_that_poses_as_our_alarm_is_told_with_who_says_it(scene):
    say(scene, "UGV-11: no heartbeat")
    (alarm,) = scene.said
    assert (alarm.text, alarm.level, alarm.system_id) == ("UGV-12 says: UGV-11: no heartbeat", "alarm", OTHER)
    assert [event.text for event in scene.events if event.kind == "text"] == [alarm.text]


@pytest.mark.slow
def test_it_stays_until_it_was_acknowledged_and_is_not_repeated(scene):
    say(scene, "Crash: disarming", seconds=30)
    (alarm,) = scene.said
    scene.acknowledge(alarm)
    scene.run(30)
    say(scene, "Crash: disarming")
    assert scene.said == [alarm], "repeated, it is the one that was seen"
    scene.run(GONE_US / S - 1)
    assert scene.said == [alarm]
    assert scene.run(2).said == []
    (again,) = say(scene, "Crash: disarming").said
    assert again.key == alarm.key and again.since_us > alarm.since_us, "a new one"


@pytest.mark.parametrize(("severity", "is_alarm"), [(0, True), (2, True), (3, True), (4, False), (6, False)])
def test_errors_and_worse_are_alarms(scene, severity, is_alarm):
    assert bool(say(scene, "x", severity=severity).said) == is_alarm


def test_a_flood_is_a_few_alarms_and_none_is_lost_in_it(scene):
    say(scene, *(f"waypoint {k}" for k in range(200)), severity=INFO)
    say(scene, "Throttle failsafe")
    assert [alarm.text for alarm in scene.said] == ["UGV-12 says: Throttle failsafe"]
    say(scene, *(f"error {k}" for k in range(500)))
    texts = [alarm.text for alarm in scene.said]
    assert len(texts) == MAX_TEXTS + 1 and "UGV-12 says: Throttle failsafe" in texts
    assert "UGV-12 says: error 499 (and 494 more)" in texts
    for alarm in scene.said:
        scene.acknowledge(alarm)
    scene.run(1)
    since = max(alarm.since_us for alarm in scene.said)
    say(scene, "error 500")
    assert any(alarm.since_us > since and "error 500" in alarm.text for alarm in scene.said), "there is room again"


def test_what_this_program_found_comes_first(scene):
    scene.health = replace(scene.health, video="stalled")
    scene.run(2)
    say(scene, "Crash: disarming")
    assert next(alarm.key for alarm in scene.now.alarms) == "video" and scene.said


def test_a_sender_that_may_be_another_is_told_as_that():
    twin = Vehicle(OTHER, shift_m=-60.0, peer=99)
    scene = Heard(Speaker(OTHER), Speaker(UGV), twin)
    scene.run(8)
    assert say(scene, "hello").said[0].text == "UGV-12 (contested) says: hello"
    scene = Heard(Speaker(OTHER), Vehicle(UGV, check=lambda packet: Auth.GOOD)).run(1)
    assert say(scene, "hello").said[0].text == "UGV-12 (unsigned) says: hello"


def text_alarm(system_id, words):
    name = f"UGV-{system_id}"
    return Alarm(
        key=f"text {name} {words}", level="alarm", kind="text", text=f"{name} says: {words}", advice="", since_us=1,
        system_id=system_id,
    )  # fmt: skip


def test_a_vehicles_words_are_no_row_with_what_was_found_out_about_it():
    lost = Alarm(key="silent 12", level="alarm", kind="vehicle", text="UGV-12: x", advice="", since_us=1, system_id=12)
    rows = alike((lost, text_alarm(12, "UGV-11: y"), text_alarm(12, "b: c"), text_alarm(13, "same")))
    assert [text_of(row) for row in rows] == ["UGV-12: x", "UGV-12 says: UGV-11: y; b: c", "UGV-13 says: same"]
    (row,) = alike((text_alarm(12, "same"), text_alarm(13, "same")))
    assert text_of(row) == "UGV-12, UGV-13 says: same"


def test_an_acknowledgement_is_recorded_with_its_alarm():
    event = Event(t_us=1, level="info", kind="operator", text="seen: x", alarm="text 12 x\x1b")
    assert msgspec.json.decode(event_row(event))["alarm"] == "text 12 x�"
    assert "alarm" not in msgspec.json.decode(event_row(replace(event, alarm="")))
