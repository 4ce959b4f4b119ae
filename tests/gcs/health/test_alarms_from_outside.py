"""Every alarm of the table is raised by what comes in from outside: packets, frames, links, disks, clocks."""

import os
import signal
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.flight.frame_loop import FrameLoop
from gcs.flight.monitor import FlightMonitor, Throughput
from gcs.flight.video import FlightVideo
from gcs.fold.pipeline import Pipeline
from gcs.fold.view_exchange import ViewExchange
from gcs.health.condition_alarms import CONDITION_RULES
from gcs.health.faults import Faults
from gcs.health.link_alarms import LINK_RULES
from gcs.health.proximity_alarms import PAIR_RULES
from gcs.health.station_alarms import STALLED_S, STATION_RULES
from gcs.health.vehicle_alarms import VEHICLE_RULES
from gcs.mission.mission import View
from gcs.session.recorder import Recorder
from gcs.snapshot import Event
from infra.wall_clock import ClockWatch
from mavlink.ingest.health import IngestHealth
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.signing.streams import ticks_of
from mavlink.tlog.writer import TlogWriter
from tests.support.alarm_scenes import CASES, MISSION, OTHER, UAV, UGV, Scene, Vehicle, raises
from tests.support.faulty_disk import HangingDisk
from tests.support.flights import T0, S
from tests.support.frames import heartbeats
from tests.support.ports import free_port
from tests.support.receiving import HOST, wait_for
from tests.support.signed_vehicles import Sender as Signed
from tests.support.signed_vehicles import secret_of, verifier
from tests.support.video_senders import Sender as Camera
from tests.support.video_senders import coded
from tests.support.waiting import until
from vision.detect.detections import Detections
from vision.video.video import Frame

RULES = (*VEHICLE_RULES, *CONDITION_RULES, *PAIR_RULES, *LINK_RULES, *STATION_RULES)
FLOOD, LARGE = 4000, 60_000
"""Datagrams, and bytes of one that fills a receive buffer with few."""
LINE = Event(t_us=T0, level="info", kind="operator", text="a line of the event log")


# what a verifier says of what they send


class Signs(Vehicle):
    """Signs, with a key or another's, by a clock that lags."""

    secret, lag_s, timed = secret_of(UGV), 0, True

    def __post_init__(self):
        super().__post_init__()
        signed = Signed(self.system_id, secret=self.secret)
        self.speaker._mav.signing = signed.mav.signing

    def frames(self, t_us):
        self.speaker._mav.signing.timestamp = ticks_of(t_us) - self.lag_s * 100_000
        yield from super().frames(t_us)


def judged(vehicle, *, keys=1):
    vehicle.check = verifier(UGV).check
    scene = Scene(vehicle)
    scene.health = replace(scene.health, keys=keys, free_bytes=10**11)
    return scene


@raises("signature")
def signs_with_another_key():
    return judged(type("Forger", (Signs,), {"secret": secret_of(99)})(UGV)).run(3).came


@raises("unsigned", "warning")
def does_not_sign():
    return judged(Vehicle(UGV)).run(3).came


@raises("held")
def was_signed_long_ago():
    return judged(type("Late", (Signs,), {"lag_s": 1800})(UGV)).run(6).came


@raises("replay")
def is_played_again():
    vehicle = Signs(UGV, "hpat")
    kept = []
    vehicle.extra = lambda speaker, t_us: kept.append(speaker.heartbeat()) or kept[-1:]
    scene = judged(vehicle).run(15)
    player = Vehicle(UGV, "", peer=99, check=vehicle.check, extra=lambda speaker, t_us: kept[:10])
    scene.vehicles.append(player)
    return scene.run(3).came


# what links, disks, cameras and this computer do


def judged_health(health, seconds=20.0):
    """Alarms of a station whose health stays as it was found."""
    scene = Scene(*(Vehicle(i, "") for i in (UAV, UGV, OTHER)))
    scene.health = health
    return scene.run(seconds).came


class Station:
    """A station's links, recording, camera, and who looks after them."""

    def __init__(self, folder, *, ingest=None, video="", keys=1, disk=None):
        self.disk = disk or HangingDisk()
        self.recorder = Recorder(folder, MISSION, video=bool(video), disk=self.disk)
        self.video, self.faults = FlightVideo(video, self.recorder), Faults(self.recorder.folder / "faults.txt")
        self.ingest = ingest or SimpleNamespace(health=IngestHealth, notices=list)
        self.events = []
        self.monitor = FlightMonitor(self.ingest, self.recorder, self.video, (), keys=keys, on_event=self.events.append)

    def health(self, packets_dropped=0):
        return self.monitor.check(Throughput(frames=0, fps=0.0, packets_dropped=packets_dropped), self.faults, None)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.disk.may_write.set()
        self.disk.room, self.disk.write_error = None, 0
        self.video.close()
        self.recorder.close()


@raises("no keys", "warning")
def has_no_keys(tmp_path):
    with Station(tmp_path, keys=0) as station:
        return judged_health(station.health())


@raises("disk")
def has_a_full_disk(tmp_path):
    with Station(tmp_path) as station:
        station.disk.room = 0
        station.recorder.events((LINE,))
        assert until(lambda: station.health().write_failing_s > 0)
        return judged_health(station.health())


@raises("lost")
def has_a_full_disk_for_long(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.session.line_file.RAM_BYTES", 1000)
    with Station(tmp_path) as station:
        station.disk.room = 0
        assert until(lambda: station.recorder.events((LINE,) * 1000) or station.health().write_lost)
        return judged_health(station.health())


@raises("disk hangs")
def has_a_disk_that_hangs(tmp_path):
    with Station(tmp_path) as station:
        station.disk.may_write.clear()
        station.recorder.events((LINE,))
        assert until(lambda: station.health().write_stalled_s > STALLED_S)
        return judged_health(station.health())


def has_room_for(monkeypatch, tmp_path, free):
    with Station(tmp_path) as station:
        monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=free))
        return judged_health(station.health())


@raises("disk space", "warning")
def has_little_room(tmp_path, monkeypatch):
    return has_room_for(monkeypatch, tmp_path, 1_900_000_000)


@raises("disk space")
def has_hardly_any_room(tmp_path, monkeypatch):
    return has_room_for(monkeypatch, tmp_path, 190_000_000)


@raises("clock step", "warning")
def has_its_clock_set(tmp_path):
    set_ns = [0]
    clock = ClockWatch(lambda: 10**18 + set_ns[0], lambda: 10**9)
    writer = TlogWriter(tmp_path / "telemetry.tlog", clock=clock)
    with writer, Station(tmp_path / "sessions") as station:
        writer.write(Packet(T0, heartbeats(1)[0]))
        set_ns[0] = 60 * 10**9
        writer.write(Packet(T0 + 60 * S, heartbeats(1)[0]))
        station.ingest.health = lambda: IngestHealth(record=writer.state)
        return judged_health(station.health())


@raises("no packet")
def hears_nothing(tmp_path, started):
    with Station(tmp_path, ingest=started()[0]) as station:
        return judged_health(station.health())


@raises("junk")
def hears_noise(tmp_path, started, sender):
    ingest, port = started()
    with Station(tmp_path, ingest=ingest) as station:
        assert until(lambda: sender.sendto(b"no mavlink", (HOST, port)) and station.health().links[0].junk_bytes)
        return judged_health(station.health())


def test_a_vehicle_whose_packets_come_garbled_is_told_so(tmp_path, started, sender):
    ingest, port = started()
    with Station(tmp_path, ingest=ingest) as station:
        vehicle = Vehicle(UGV)
        scene = Scene(vehicle).run(3)
        vehicle.sends, garbled = "", next(vehicle.frames(T0))[::-1]
        for second in range(1, 8):
            for _ in range(5):
                sender.sendto(garbled, (HOST, port))
            junk = 5 * second * len(garbled)
            assert until(lambda junk=junk: station.health().links[0].junk_bytes >= junk)
            scene.health = station.health()
            scene.run(1)
    assert scene.came["silent 11", "alarm"].text == "UGV-11: no heartbeat: its link brings garbled bytes"


@raises("link")
def hears_no_more(tmp_path, started, sender, monkeypatch):
    monkeypatch.setattr("gcs.health.link_alarms.SILENT_S", 0.5)
    ingest, port = started()
    with Station(tmp_path, ingest=ingest) as station:
        sender.sendto(heartbeats(1)[0], (HOST, port))
        wait_for(ingest, 1)
        assert until(lambda: 0.5 < station.health().links[0].silent_s < np.inf)
        return judged_health(station.health())


@raises("flood")
@raises("dropped")
@raises("ingest")
@raises("ring", "warning")
def is_flooded_while_its_receiver_hangs(tmp_path, started, sender):
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux counts what it drops")
    ingest, port = started(ring_bytes=8192, system_ids=(UAV, UGV))
    frame, came = MavlinkEncoder(UAV).heartbeat(), {}

    def all_came():
        # it goes on until it is noticed: how many the busy system dropped meanwhile is not known
        for _ in range(1 if any(key.startswith("flood") for key, _ in came) else FLOOD // 8):
            sender.sendto(frame, (HOST, port))
        ingest.read(0.01)
        came.update(judged_health(station.health(), 3.0))
        return {"dropped", "ingest", "ring", "flood"} <= {key.split()[0] for key, _ in came}

    with Station(tmp_path, ingest=ingest) as station:
        sender.sendto(frame, (HOST, port))
        wait_for(ingest, 1)
        os.kill(ingest.supervisor.process.pid, signal.SIGSTOP)
        # many of them, and large ones so that the buffer is full before another process takes over
        for datagram in [frame] * FLOOD + [bytes(LARGE)] * (2 * ingest.health().links[0].buffer_bytes // LARGE):
            sender.sendto(datagram, (HOST, port))
        until(all_came)
    return came


def folded(tmp_path, detector=None, *, late_us=0, heard_late_us=0):
    """Alarms of a flight's loop over forty frames, by a clock of its own."""
    now_us, came = [T0], {}
    with Station(tmp_path) as station:
        loop = FrameLoop(
            Pipeline(MISSION), detector, station.recorder, station.faults, lambda snapshot: None, lambda: now_us[0]
        )
        for index in range(40):
            now_us[0] += 100_000
            loop.add_packets([], now_us[0] - heard_late_us)
            loop.health = replace(station.health(), video="ok")
            loop.run_once(Frame(index=index, t_us=now_us[0] - late_us, image=np.zeros((8, 8, 3), np.uint8)))
            came |= {(alarm.key, alarm.level): alarm for alarm in loop.latest.alarms}
    return came


class Blind:
    """Sees nothing, or fails."""

    def __init__(self, error=None):
        self.error = error

    def detect(self, image, *, gsd_m=None):
        if self.error:
            raise self.error
        return Detections.empty()


@raises("fault", "warning")
def has_a_detector_that_fails(tmp_path):
    return folded(tmp_path, Blind(ValueError("no device")))


@raises("lag", "warning")
def detects_too_slowly(tmp_path):
    return folded(tmp_path, Blind(), late_us=1_500_000)


@raises("overload")
def folds_too_slowly(tmp_path):
    return folded(tmp_path, Blind(), heard_late_us=2_500_000)


@raises("no video")
def has_a_camera_that_never_sends(tmp_path):
    with Station(tmp_path, video=f"udp://{HOST}:{free_port()}") as station:
        return judged_health(station.health())


@raises("video")
def has_a_camera_that_stops(tmp_path):
    port = free_port()
    with Station(tmp_path, video=f"udp://{HOST}:{port}") as station:
        with Camera(port, coded(100)):
            assert until(lambda: station.video.stream.received)
        assert until(lambda: station.health().video == "stalled")
        return judged_health(station.health(), 5.0)


@raises("video contest")
def has_two_cameras_on_one_port(tmp_path):
    port = free_port()
    with Station(tmp_path, video=f"udp://{HOST}:{port}") as station, Camera(port, coded(1000)):
        assert until(lambda: station.video.stream.received)
        first = station.video.stream.sender
        with Camera(port, coded(1000)):
            assert until(lambda: station.health().video_rival)
            health = station.health()
            assert health.video_sender == str(first) != health.video_rival
            # who is taken instead is listened to from its next key frame on
            assert station.video.take_rival() == health.video_rival
            assert until(lambda: station.health().video_sender == health.video_rival)
            assert until(lambda: station.health().video_rival == health.video_sender)
    assert any(health.video_rival in event.text for event in station.events)
    return judged_health(health, 5.0)


@raises("undecoded", "warning")
def has_a_camera_with_a_bad_link(tmp_path):
    rng = np.random.default_rng(6)

    def spoil(data):
        body = bytearray(data)
        for _ in range(20):
            body[rng.integers(200, len(body)) if len(body) > 200 else 0] ^= 0x55
        return [bytes(body)]

    port = free_port()
    with Station(tmp_path, video=f"udp://{HOST}:{port}") as station:
        with Camera(port, coded(100)[:20]):
            assert until(lambda: station.video.stream.received)
        with Camera(port, coded(100), spoil=spoil):
            assert until(lambda: station.health().undecoded)
            return judged_health(station.health(), 5.0)


@raises("video clock", "warning")
def has_a_camera_that_dates_its_frames_late(tmp_path):
    mission = replace(MISSION, clock=replace(MISSION.clock, video_offset_s="auto"))
    return Scene(mission=mission).run(12, filmed=True, video_late_s=0.3).came


def turned_camera(**angles):
    """Whether vehicles are seen by a camera that looks straight down and north, while the mission says otherwise."""
    mission = replace(MISSION, camera=replace(MISSION.camera, **angles))
    return Scene(mission=mission).run(9, filmed=True).came


@raises("camera heading", "warning")
def has_a_camera_that_is_mounted_turned():
    came = turned_camera(yaw_deg=90.0)
    assert came["camera heading", "warning"].text.endswith(": 90° counterclockwise")
    return came


@raises("camera pitch", "warning")
def has_a_camera_that_looks_down_more_steeply_than_told():
    came = turned_camera(pitch_deg=-75.0)
    assert came["camera pitch", "warning"].text.endswith("° below it")
    return came


class OtherFilm(Scene):
    """A scene beside the film of another road."""

    def boxes(self):
        found = super().boxes()
        return replace(found, cx=1280.0 - found.cx + 150.0, cy=found.cy + 120.0)


class MirroredFilm(Scene):
    """A scene whose picture is mirrored."""

    def boxes(self):
        seen = super().boxes()
        return replace(seen, cx=1280.0 - seen.cx, angle=np.pi - seen.angle, heading=-seen.heading % (2.0 * np.pi))


@raises("camera mirrored", "warning")
def has_a_mirrored_picture():
    return MirroredFilm().run(4, filmed=True).came


@raises("no match")
def has_the_film_of_another_flight():
    return OtherFilm().run(5, filmed=True).came


@raises("match not known", "warning")
def films_others_while_the_fleet_is_elsewhere():
    far = [Vehicle(i, shift_m=400.0) for i in (UGV, OTHER)]
    came = Scene(*far).run(12, filmed=True).came
    assert ("no match", "alarm") not in came, "no evidence is none against it"
    return came


class Misled:
    """An exchange with another camera that has the same boxes, from a time on each surely as the next vehicle."""

    def __init__(self, uav_id, from_us):
        exchange = ViewExchange()
        self.own, self.other = exchange.join(UAV), exchange.join(uav_id)
        self.contradictions, self.first_seen, self.from_us = self.own.contradictions, self.own.first_seen, from_us

    def answers(self, frame, origin, system_ids, mine):
        n = len(system_ids)
        p = np.full_like(mine.p, 0.01)
        p[np.arange(len(p)), (np.argmax(mine.p, axis=1) + (mine.t_us > self.from_us)) % n] = 1.0 - 0.01 * n
        self.other.answers(frame, origin, system_ids, replace(mine, p=p, fit=1.0))
        return self.own.answers(frame, origin, system_ids, mine)


@raises("views differ")
def has_another_camera_that_names_others():
    scene = Scene(mission=replace(MISSION, view=(View(system_id=77, name="North"),)))
    scene.pipeline.naming.exchange = Misled(77, T0 + 6 * S)
    came = scene.run(13, filmed=True).came
    assert " by North; " in came["views differ", "alarm"].text
    return came


def test_there_is_a_case_for_every_alarm():
    assert set(CASES) == {(rule.key, rule.level) for rule in RULES}


LONG = (
    *("has_a_slow_clock", "is_filmed_elsewhere", "has_a_camera_that_is_mounted_turned", "is_at_the_edge_of_its_radio"),
    *("has_a_camera_that_looks_down_more_steeply_than_told", "has_a_camera_that_dates_its_frames_late"),
    *("has_another_camera_that_names_others", "has_the_film_of_another_flight", "has_a_mirrored_picture"),
    *("films_others_while_the_fleet_is_elsewhere", "is_beyond_the_edge_of_its_radio", "is_never_heard"),
    *("is_flooded_while_its_receiver_hangs", "has_two_cameras_on_one_port", "has_a_camera_with_a_bad_link"),
    *("hears_no_more", "has_a_camera_that_stops", "is_played_again", "never_has_a_position", "loses_its_fix"),
    *("fails_its_arming_checks", "has_a_broken_compass"),
)
"""Flights of many seconds, films in which it takes time to be known, and processes that are waited for."""


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.slow] * (case.__name__ in LONG)) for case in dict.fromkeys(CASES.values())],
    ids=lambda case: case.__name__,
)
def test_an_alarm_is_raised_by_what_comes_in(case, request):
    names = case.__code__.co_varnames[: case.__code__.co_argcount]
    came = case(**{name: request.getfixturevalue(name) for name in names})
    expected = {alarm for alarm, registered in CASES.items() if registered is case}
    texts = {(rule.key, rule.level): rule for rule in RULES}
    for key, level in expected:
        rule = texts[key, level]
        found = [alarm for (found, at), alarm in came.items() if found.startswith(key) and at == level]
        assert any(rule.text in alarm.text and alarm.advice == rule.advice for alarm in found), (key, sorted(came))


@pytest.mark.slow
@pytest.mark.parametrize(("ppm", "wrong"), [(200.0, False), (350.0, True), (-2000.0, True), (5000.0, True)])
def test_a_clock_that_drifts_is_an_alarm_and_its_positions_are_dated_right_all_the_same(ppm, wrong):
    scene = Scene(Vehicle(UGV, drift_ppm=ppm)).run(100)
    assert (("clock 11", "warning") in scene.came) == wrong and len(scene.came) == wrong
    (place, _), state = scene.vehicles[0].place(scene.t_us), scene.pipeline.fleet.at(scene.t_us)
    assert np.hypot(*(state.p_enu[0, :2] - place)) < 0.1
