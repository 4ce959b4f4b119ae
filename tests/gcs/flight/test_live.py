"""A flight as it is flown: the command in a process of its own, a simulated fleet on the loopback, bounded in time."""

import contextlib
import json
import signal
import subprocess
import sys
import threading
import time
import tomllib
from dataclasses import replace

import numpy as np
import psutil
import pytest

from gcs.cli.identify import identify_into
from gcs.fold.detector_factory import fingerprints
from gcs.mission.mission import DetectorChoice
from gcs.session.frame_tables import read_times
from gcs.session.session import open_session
from mavlink.tlog.log import Tlog
from sim.live import play
from sim.world.presets import nominal
from sim.world.scenario import ScenarioCamera
from tests.support.ports import free_port
from tests.support.waiting import until
from vision.video.video import VideoFile

SMALL = ScenarioCamera(width=640, height=360, fx=400.0, fy=400.0, cx=320.0, cy=180.0)
SCENARIO = replace(nominal(3), camera=SMALL, duration_s=60.0)
MISSION = """
[uav]
system_id = 1
{ugvs}
[camera]
width = 1280
height = 720
fx = 800.0
fy = 800.0
cx = 640.0
cy = 360.0
"""
"""Described for frames twice as large as the stream's."""


class Field:
    """A flight process and the fleet that talks to it."""

    def __init__(self, folder, *extra):
        self.folder = folder
        self.telemetry, self.video = free_port(), free_port()
        ugvs = "".join(f"[[ugv]]\nsystem_id = {i}\n" for i in SCENARIO.ugv_ids)
        (folder / "mission.toml").write_text(MISSION.format(ugvs=ugvs))
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-c", "from gcs.cli.app import main; main()", "fly", folder / "mission.toml"),
                *("-l", f"udpin:127.0.0.1:{self.telemetry}", "-v", f"udp://127.0.0.1:{self.video}"),
                *("--sessions", folder / "sessions", "--headless", *extra),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.session = None

    def recording(self):
        for _ in range(1200):
            found = list((self.folder / "sessions").glob("*/telemetry.tlog"))
            if found:
                return found[0].parent
            assert self.process.poll() is None, self.process.stderr.read()
            time.sleep(0.1)
        raise AssertionError("no recording within two minutes")

    def fly(self, duration_s, stop=None):
        return play(
            SCENARIO,
            f"udpout:127.0.0.1:{self.telemetry}",
            f"udp://127.0.0.1:{self.video}?pkt_size=1316",
            duration_s,
            stop=stop,
        )

    @contextlib.contextmanager
    def flying(self):
        """The fleet moves meanwhile, a minute at most; gives what it sent, once it is over."""
        stop, sent = threading.Event(), []
        player = threading.Thread(target=lambda: sent.append(self.fly(SCENARIO.duration_s, stop)))
        player.start()
        try:
            yield sent
        finally:
            stop.set()
            player.join(timeout=120)


@pytest.fixture
def field(tmp_path):
    """Flies until its test is over, however that ends."""
    field = Field(tmp_path)
    try:
        field.session = field.recording()
        yield field
    finally:
        field.process.kill()
        field.process.communicate()


def frames_us(session):
    return [int(row.split(",")[1]) for row in (session / "frames.csv").read_text().splitlines()[1:]]


def newest_us(session):
    """Times of the newest packet and of the newest frame recorded, 0 before the first."""
    log = session / "telemetry.tlog"
    packets_us = Tlog.open(log).index.t_us if log.stat().st_size else []
    return max(packets_us, default=0), max(frames_us(session), default=0)


def records(session):
    return len(Tlog.open(session / "telemetry.tlog").index)


def is_named(session):
    """Whether there are five seconds of film, and most of the boxes seen in it have been named."""
    time.sleep(0.2)  # between looks, which take the processor from the flight
    path = session / "identity.jsonl"
    rows = path.read_text().splitlines(keepends=True) if path.exists() else []
    named = [json.loads(row)["system_id"] is not None for row in rows if row.endswith("\n")]
    times_us = frames_us(session)
    return sum(named) > 0.6 * len(named) > 0 and times_us[-1] - times_us[0] > 5_000_000


def test_every_packet_and_frame_is_kept(field, tmp_path):
    with field.flying() as sent:
        assert until(lambda: is_named(field.session))
    (sent,) = sent
    assert until(lambda: records(field.session) == sum(sent.packets.values()))
    assert until(lambda: len(frames_us(field.session)) >= 0.6 * sent.frames)
    field.process.send_signal(signal.SIGINT)
    stdout, stderr = field.process.communicate(timeout=120)
    assert "Traceback" not in stderr
    assert f"{sum(sent.packets.values())} packets received" in stdout
    assert records(field.session) == sum(sent.packets.values())
    film = VideoFile.open(field.session / "video.mkv")
    times = read_times(field.session / "frames.csv")
    assert (times.skipped, times.unordered) == (0, 0)
    assert len(times.times_us) == film.n
    assert film.n >= 0.6 * sent.frames
    film.close()
    assert "ended" in (field.session / "session.toml").read_text()
    same_again(field.session, tmp_path / "again")
    notes = tomllib.loads((field.session / "session.toml").read_text())["session"]
    assert notes["keys"] == {} and notes["models"] == fingerprints(DetectorChoice())
    events = [json.loads(line) for line in (field.session / "events.jsonl").read_text().splitlines()]
    well = [event["time_us"] for event in events if event["text"] == "video ok"]
    assert well and well[0] >= times.times_us[0], "the video was called well before any of it had come"


def looked_again(session, out):
    """Rows that a flight wrote, and those of a later look at its recording."""
    identify_into(open_session(session), out)
    return ((folder / "identity.jsonl").read_text().splitlines() for folder in (session, out))


def same_again(session, out):
    """A later look at the recording says the same of every box; most must have been named."""
    live, again = looked_again(session, out)
    assert again == live
    assert sum(json.loads(row)["system_id"] is not None for row in live) > 0.5 * len(live)


def oldest(flight, package):
    """The first of a flight's processes that runs a package's module: it works, the next is its spare."""

    def runs_it(process):
        return any(word.startswith(package) for word in process.as_dict(["cmdline"], ad_value=[])["cmdline"])

    return min(filter(runs_it, psutil.Process(flight.pid).children(recursive=True)), key=psutil.Process.create_time)


@pytest.mark.slow
def test_a_flight_whose_processes_were_killed_is_the_same_again(field, tmp_path):
    told = {
        "mavlink.ingest": "another process took over",
        "vision.stream": "the video's process was started again",
    }
    with field.flying():
        for package, words in told.items():
            assert until(lambda: min(newest_us(field.session)) > 0)
            frames = len(frames_us(field.session))
            assert until(lambda frames=frames: len(frames_us(field.session)) > frames + 30)
            oldest(field.process, package).kill()
            assert until(lambda words=words: words in (field.session / "events.jsonl").read_text())
        assert until(lambda: is_named(field.session))
    field.process.send_signal(signal.SIGINT)
    field.process.communicate(timeout=120)
    same_again(field.session, tmp_path / "again")


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [3.0, 4.3])
def test_a_kill_loses_at_most_the_last_second(field, after_s):
    with field.flying():
        time.sleep(after_s)
        # it is killed while it keeps up: a machine that is held up records later
        assert until(lambda: min(newest_us(field.session)) > time.time_ns() // 1000 - 1_000_000)
        # and once there is a film of more than what a kill may lose
        assert until(lambda: max(frames_us(field.session)) - min(frames_us(field.session)) > 1_500_000)
        packet_us, frame_us = newest_us(field.session)
        field.process.kill()
    field.process.communicate(timeout=60)
    log = Tlog.open(field.session / "telemetry.tlog")
    assert log.index.t_us.max() >= packet_us
    assert not log.index.damage or log.index.damage[-1].stop == log.index.counts.size_bytes
    for system_id in set(log.index.system_id.tolist()):
        numbers = log.index.seq[log.index.system_id == system_id]
        assert (np.diff(numbers) == 1).all(), "none is missing"
    film = VideoFile.open(field.session / "video.mkv")
    times = read_times(field.session / "frames.csv").times_us
    assert sum(1 for _ in film.frames()) >= 1
    assert times[min(film.n, len(times)) - 1] > frame_us - 2_500_000
    film.close()
    live, again = looked_again(field.session, field.folder / "again")
    assert again[: len(live)] == live, "what was said before the kill is said again"
