"""A fault of the program costs one packet or one frame, is told and kept, and ends no flight."""

import socket

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.flight.flight import Flight
from gcs.flight.frame_loop import MAX_WAITING, FrameLoop
from gcs.flight.plan import FlightPlan
from gcs.fold.pipeline import Pipeline
from gcs.health.faults import LASTING, Faults
from gcs.mission.mission import parse_mission
from gcs.session.recorder import Recorder
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog
from tests.support.ports import free_port
from tests.support.waiting import until
from vision.video.video import Frame

MISSION = parse_mission({"uav": {"system_id": 1}, "ugv": [{"system_id": 11}, {"system_id": 12}]}, "mission")

NOW_US = 1_790_000_000_000_000
"""At which the fold's clock stands still."""


def heartbeat(system_id):
    speaker = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    return dialect.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(speaker)


def packet(system_id, t_us=1_000_000):
    return Packet(t_us=t_us, raw=heartbeat(system_id), link=0, peer=1)


def fail(text):
    raise ValueError(text)


class Broken:
    """Everything, but for one thing, works."""

    names = ()

    def detect(self, image, *, gsd_m=None):
        """As a graphics card that went away."""
        fail("no device")


@pytest.fixture
def fold(tmp_path):
    recorder = Recorder(tmp_path, MISSION, video=True)
    seen, faults = [], Faults(recorder.folder / "faults.txt")
    fold = FrameLoop(Pipeline(MISSION), Broken(), recorder, faults, seen.append, now_us=lambda: NOW_US + fold.late_us)
    fold.late_us = 0
    fold.seen, fold.folder = seen, recorder.folder
    yield fold
    recorder.close()


def frame(index):
    return Frame(index=index, t_us=NOW_US, image=np.zeros((8, 8, 3), np.uint8))


def test_the_fleet_goes_on_without_its_detector(fold):
    for index in range(LASTING):
        fold.add_packets([packet(11, NOW_US)], NOW_US)
        fold.run_once(frame(index))
    assert len(fold.seen) == LASTING and fold.latest.frame == LASTING - 1
    assert fold.latest.vehicles[1].heartbeat_age_s == 0.0
    assert fold._faults.persistent == "detecting: ValueError: no device"
    assert (fold.folder / "faults.txt").read_text().count("Traceback") == 1, "one place, one traceback"
    assert (fold.folder / "detections.csv").read_text().count("\n") == 1, "nobody looked"


def test_one_packet_that_cannot_be_worked_on_costs_nothing_else(fold, monkeypatch):
    feed = Pipeline.add_packet
    monkeypatch.setattr(Pipeline, "add_packet", lambda self, p: fail("odd") if p.system_id == 12 else feed(self, p))
    fold.add_packets([packet(12, NOW_US), packet(11, NOW_US), packet(12, NOW_US)], NOW_US)
    fold.run_once(None)
    assert fold.latest.vehicles[1].heartbeat_age_s == 0.0
    assert (fold._faults.count, fold._faults.persistent) == (2, "")
    assert fold._faults.last == "packet of system 12: ValueError: odd"


def test_packets_that_wait_for_ever_are_bounded_and_counted(fold):
    batch = [packet(11)] * 1000
    for _ in range(MAX_WAITING // 1000 + 3):
        fold.add_packets(batch, 1_000_000)
    assert fold.throughput.packets_dropped == 3000


def test_telemetry_that_is_taken_in_late_makes_no_vehicle_silent(fold):
    """As on a machine so busy that what was received and recorded waits for seconds."""
    fold.add_packets([packet(11, NOW_US - 6_000_000)], NOW_US - 5_800_000)
    fold.run_once(None)
    snapshot = fold.latest
    assert snapshot.vehicles[1].heartbeat_age_s == pytest.approx(0.2, abs=1e-3)
    assert snapshot.health.behind_s == pytest.approx(5.8, abs=1e-3)
    # told once it lasts
    fold.late_us = 1_100_000
    fold.add_packets([], NOW_US - 5_700_000)
    fold.run_once(None)
    snapshot = fold.latest
    assert {alarm.key for alarm in snapshot.alarms} >= {"overload"}
    assert not any(alarm.key.startswith(("silent", "position")) for alarm in snapshot.alarms)
    fold.add_packets([], NOW_US + fold.late_us)
    fold.run_once(None)
    assert fold.latest.vehicles[1].heartbeat_age_s == pytest.approx(7.1, abs=1e-3)
    assert any(alarm.key == "silent 11" for alarm in fold.latest.alarms), "heard for so long, and it said nothing"
    assert fold.latest.health.behind_s == 0.0


def test_a_job_that_works_again_is_well(tmp_path):
    faults = Faults(tmp_path / "faults.txt")
    for _ in range(LASTING):
        faults.turn_failed("naming", ValueError("x"))
    assert faults.persistent == "naming: ValueError: x"
    faults.turn_succeeded("naming")
    assert (faults.persistent, faults.count) == ("", LASTING)


def test_tracebacks_that_cannot_be_kept_are_no_fault(tmp_path):
    faults = Faults(tmp_path / "gone" / "faults.txt")
    faults.record("naming", ValueError("x"))
    assert faults.count == 1


def test_a_flight_whose_fold_fails_goes_on_recording_and_says_so(tmp_path, monkeypatch):
    port = free_port()
    monkeypatch.setattr("gcs.flight.flight.FAULT_PAUSE_S", 0.01)
    monkeypatch.setattr("gcs.flight.views.IDLE_S", 0.01)
    monkeypatch.setattr(Pipeline, "add_frame", lambda *_, **__: fail("lost its head"))
    flight = Flight(FlightPlan(mission=MISSION, links=(f"udpin:127.0.0.1:{port}",), video="", sessions=tmp_path))
    sent = 0
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:

            def say(system_id):
                nonlocal sent
                vehicle.sendto(heartbeat(system_id), ("127.0.0.1", port))
                sent += 1
                assert until(lambda: flight.packets == sent), "recording goes on"

            assert until(lambda: say(11) or flight.error is not None)
            for _ in range(20):
                say(12)
        assert str(flight.error) == "naming: ValueError: lost its head; telemetry and video are recorded all the same"
    finally:
        flight.stop()
    assert len(Tlog.open(flight.folder / "telemetry.tlog").index) == sent
    assert any("faults of this program" in line for line in flight.faults)
    assert "lost its head" in (flight.folder / "faults.txt").read_text()
