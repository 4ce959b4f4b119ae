"""Texts without end: memory stays, every packet is in the raw log, and the screen stays quick."""

from __future__ import annotations

import json
import tracemalloc

import pytest

from gcs.fold.pipeline import Pipeline
from gcs.health.event_throttle import EventThrottle
from gcs.mission.mission import load_mission
from gcs.session.event_log import EventLog
from gcs.snapshot import Event
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog
from mavlink.tlog.writer import TlogWriter
from sim.faults.fault_traffic import HEARTBEAT, HOSTILE_TEXTS, TEXT, SenderEncoder
from tests.support.fake_station import START_US, FakeStation, running, screen_text

TEXTS = 20_000
MISSION = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[[ugv]]\nsystem_id = 12\n"


@pytest.fixture
def pipeline(tmp_path):
    (tmp_path / "mission.toml").write_text(MISSION)
    return Pipeline(load_mission(tmp_path / "mission.toml"))


def flood(number, hz=1000.0):
    voice = SenderEncoder(11)
    for k in range(number):
        t_us = START_US + round(k / hz * 1e6)
        words = HOSTILE_TEXTS[k % len(HOSTILE_TEXTS)].encode("utf-8", "replace")[:50]
        yield Packet(t_us, voice.frame(t_us, TEXT, k % 8, words))


@pytest.mark.slow
def test_a_thousand_texts_a_second_cost_no_memory_and_none_is_lost(pipeline, tmp_path):
    tlog, log = TlogWriter(tmp_path / "telemetry.tlog"), EventLog(tmp_path / "events.jsonl")
    told = 0
    tracemalloc.start()
    for k, packet in enumerate(flood(TEXTS)):
        tlog.write(packet)
        pipeline.add_packet(packet)
        if k % 100 == 99:
            snapshot = pipeline.add_frame(-1, packet.t_us)
            log.write(snapshot.events)
            told += len(snapshot.events)
        if k == TEXTS // 4:
            before, _ = tracemalloc.get_traced_memory()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    tlog.close()
    log.close()
    # fifteen thousand events kept would be five times as much; the log's rows may wait for a slow disk
    assert after - before < 1_500_000
    assert len(Tlog.open(tmp_path / "telemetry.tlog").index.t_us) == TEXTS
    # twenty at once, then two a second and their sum
    assert told <= 20 + 20 * 4
    rows = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert len(rows) == told
    assert not any(ord(letter) < 32 for row in rows for letter in row["text"])
    held = sum(int(row["text"].split(" more, ")[0]) for row in rows if " more, most often: " in row["text"])
    assert held > 0.9 * TEXTS * 13 / 14


def test_other_vehicles_are_heard_through_a_flood(pipeline):
    other = SenderEncoder(12)
    for k, packet in enumerate(flood(3000)):
        pipeline.add_packet(packet)
        if k == 2000:
            pipeline.add_packet(Packet(packet.t_us, other.frame(packet.t_us, HEARTBEAT, 10, 10, 3, 129, 4, 3)))
            pipeline.add_packet(Packet(packet.t_us, other.frame(packet.t_us, TEXT, 6, b"Reached waypoint #1")))
    said = {event.text for event in pipeline.add_frame(-1, packet.t_us).events if event.system_id == 12}
    assert {"UGV-12 says: Reached waypoint #1", "rover 12 is there, AUTO"} <= said


def test_a_sender_that_falls_silent_is_summed_up_all_the_same(pipeline):
    for packet in flood(700):
        pipeline.add_packet(packet)
    pipeline.add_frame(-1, packet.t_us)
    later = pipeline.add_frame(-1, packet.t_us + 2_000_000)
    assert any(" more, most often" in event.text for event in later.events)


def test_arming_and_disarming_without_end_is_bounded_too(pipeline):
    voice = SenderEncoder(11)
    told = 0
    for k in range(5000):
        t_us = START_US + k * 10_000
        pipeline.add_packet(Packet(t_us, voice.frame(t_us, HEARTBEAT, k % 7, 10, 3, 129 if k % 2 else 1, 4, 3)))
        told += len(pipeline.add_frame(-1, t_us).events) if k % 20 == 0 else 0
    assert told < 250


def test_talkers_are_bounded():
    throttle = EventThrottle()
    for k in range(5000):
        throttle.admit([Event(t_us=START_US + k, level="info", kind=str(k), text="x")])
    assert len(throttle._senders) <= 600


async def test_keys_are_answered_during_a_flood(pipeline):
    station = FakeStation(live=True)
    packets = flood(4000)
    async with running(station, (120, 36)) as (app, pilot, _):
        for keys in (["e"], ["down"], ["l"], ["l"], ["l"], ["a"], ["question_mark"], ["escape"]):
            for _ in range(500):
                pipeline.add_packet(next(packets))
            snapshot = pipeline.add_frame(-1, START_US + 4_000_000)
            station.said = [*station.said, *snapshot.events][-2000:]
            app._poll()
            await pilot.press(*keys)
        await pilot.press("e", "z")
        said = screen_text(app)
        assert "more, most often: " in said and app.is_running
        assert not any(ord(letter) < 32 for letter in said if letter != "\n")
