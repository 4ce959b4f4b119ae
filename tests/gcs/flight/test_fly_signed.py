"""A signed fleet in front of ``gcs fly``: started late, killed, started again, and recordings played in between."""

import csv
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import pytest

from gcs.cli.fly import fly
from gcs.errors import GcsError
from mavlink.protocol.packet import Auth
from mavlink.signing.journal import StreamJournal
from mavlink.signing.keys import write_key
from mavlink.tlog.log import Tlog
from tests.support.command_line import Terminal
from tests.support.ports import free_port
from tests.support.receiving import recorded
from tests.support.signed_vehicles import ArduPilot, S, Vehicle, secret_of
from tests.support.waiting import until

MISSION = """
[uav]
system_id = 1
[[ugv]]
system_id = 11
[[ugv]]
system_id = 12
[signing]
keys = "keys"
"""


def children(pid):
    """Processes that a process has started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(path.parent.name))
    return found


class Place:
    """Flights one after the other, with the same keys, and the vehicles that speak to them."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "mission.toml").write_text(MISSION)
        for system_id in (1, 11, 12):
            write_key(folder / "keys", system_id, secret_of(system_id))
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.elsewhere = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.process = self.session = self.port = None

    def start(self, *extra):
        before = set(self.folder.glob("sessions/*/telemetry.tlog"))
        self.port = free_port()
        command = [sys.executable, "-c", "from gcs.cli.app import main; main()", "fly", self.folder / "mission.toml"]
        command += ["-l", f"udpin:127.0.0.1:{self.port}", "--sessions", self.folder / "sessions", "--headless", *extra]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

        def new():
            assert self.process.poll() is None, self.process.stderr.read()
            return set(self.folder.glob("sessions/*/telemetry.tlog")) - before

        assert until(new, 120.0)
        self.session = new().pop().parent

    def kill(self):
        """All its processes at once, as a system does that has no memory left."""
        station = self.process.pid
        for pid in [*children(station), station]:
            os.kill(pid, signal.SIGKILL)
        self.process.communicate()

    def end(self):
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=120)

    def speak(self, vehicles, seconds):
        rate_hz = vehicles[0].rate_hz
        began = time.monotonic()
        for k in range(round(seconds * rate_hz)):
            for vehicle in vehicles:
                self.out.sendto(vehicle.frame(k, time.time_ns() // 1000), ("127.0.0.1", self.port))
            time.sleep(max(0.0, began + (k + 1) / rate_hz - time.monotonic()))

    def play(self, frames):
        for k, raw in enumerate(frames):
            self.elsewhere.sendto(raw, ("127.0.0.1", self.port))
            if k % 20 == 19:
                time.sleep(0.02)

    def judged(self, count, refused):
        """System and verdict of each record, in order, once there are so many and so many of them refused."""
        found = self.judged_at_least(count, refused)
        assert len(found) == count
        return found

    def refused(self):
        """Records that are noted as refused, with the reason."""
        path = self.session / "refused.csv"
        if not path.exists():
            return {}
        with path.open() as file:
            rows = [row for row in file if row.endswith("\n")]  # the last may be half written
        return {int(row["record"]): Auth(int(row["auth"])) for row in csv.DictReader(rows)}

    def judged_at_least(self, count, refused):
        """The same, of a station that says something itself."""
        path = self.session / "telemetry.tlog"
        # what is refused is noted after it is recorded
        until(lambda: len(self.refused()) >= refused and len(recorded(self.session)) >= count)
        packets = list(Tlog.open(path).packets())
        verdicts = [Auth.GOOD] * len(packets)
        for record, verdict in self.refused().items():
            verdicts[record] = verdict
        return [(packet.system_id, verdict, packet.raw) for packet, verdict in zip(packets, verdicts, strict=True)]

    def tells(self, words):
        """Whether an event comes to say something."""
        return until(lambda: words in (self.session / "events.jsonl").read_text())


@pytest.fixture
def place(tmp_path):
    place = Place(tmp_path)
    try:
        yield place
    finally:
        if place.process.poll() is None:
            place.kill()
        place.out.close()
        place.elsewhere.close()
        StreamJournal(tmp_path / "keys").close(needed=False)


def driving(system_id, **options):
    """A rover that was switched on half an hour ago and armed for all but the first minutes."""
    start_us = time.time_ns() // 1000 - 1800 * S
    vehicle = Vehicle(ArduPilot(start_us, key_set_us=start_us - 86_400 * S), system_id, **options)
    vehicle.runs(start_us, 1800, arms_after_s=120)
    return vehicle


@pytest.mark.slow
def test_a_fleet_that_has_long_been_driving_is_believed_at_once_and_after_a_kill(place):
    told, untold = driving(11), driving(12, system_time=False)
    place.start()
    place.speak([told, untold], 4.0)
    first = place.judged(96, 7 + 48)
    of = {i: [verdict for system_id, verdict, _ in first if system_id == i] for i in (11, 12)}
    # its first SYSTEM_TIME is its eighth packet
    assert of[11] == [Auth.HELD] * 7 + [Auth.GOOD] * 41
    assert of[12] == [Auth.HELD] * 48
    held = "nothing proves that its packets are made now: held (127.0.0.1:"
    assert place.tells(f"system 12: signatures 28 min behind, {held}")
    place.kill()

    place.start("--accept-late", "12")
    place.play([raw for system_id, _, raw in first if system_id == 11])
    place.speak([told, untold], 1.0)
    place.play([raw for _, _, raw in first])
    counts = Counter((i, verdict) for i, verdict, _ in place.judged(48 + 24 + 96, 96 + 48))
    # what was held had never been believed: it is the operator's word that counts
    assert counts == {(11, Auth.REPLAYED): 96, (11, Auth.GOOD): 12, (12, Auth.GOOD): 12, (12, Auth.REPLAYED): 48}
    assert place.tells("UGV-12: signed packets are accepted without a proof in this flight")
    recording = [raw for _, _, raw in place.judged(48 + 24 + 96, 96 + 48)]
    place.end()

    place.start()
    place.play(recording)
    place.speak([told, untold], 1.0)
    counts = Counter((i, verdict) for i, verdict, _ in place.judged(168 + 24, 108 + 60))
    assert counts == {(11, Auth.REPLAYED): 108, (11, Auth.GOOD): 12, (12, Auth.GOOD): 12, (12, Auth.REPLAYED): 60}


@pytest.mark.slow
def test_an_operator_believes_a_held_vehicle_by_a_key_and_a_second_one(tmp_path):
    for system_id in (1, 11, 12):
        write_key(tmp_path / "keys", system_id, secret_of(system_id))
    vehicle, sent = driving(11, system_time=False), 0
    terminal = Terminal(tmp_path, mission=MISSION)

    def speaks_until(is_true, seconds=120.0):
        """The vehicle speaks until something is true of what the screen has shown since."""
        nonlocal sent
        seen, end = b"", time.monotonic() + seconds
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not is_true(seen) and time.monotonic() < end:
                out.sendto(vehicle.frame(sent, time.time_ns() // 1000), ("127.0.0.1", terminal.port))
                sent += 1
                if select.select([terminal.keeper], [], [], 1.0 / vehicle.rate_hz)[0]:
                    seen += os.read(terminal.keeper, 65536)
        assert is_true(seen), seen[-3000:]

    try:
        terminal.read_until(b"NAME")
        (session,) = terminal.sessions.iterdir()
        speaks_until(lambda seen: b"its packets are held" in seen)
        os.write(terminal.keeper, b"b")
        speaks_until(lambda seen: b"Accept" in seen)
        os.write(terminal.keeper, b"y")
        told = "UGV-11: signed packets that were held are accepted without a proof"
        speaks_until(lambda seen: told in (session / "events.jsonl").read_text())
        accepted = sent
        speaks_until(lambda seen: sent >= accepted + 24)
        assert until(lambda: len(recorded(session)) == sent)
        with (session / "refused.csv").open() as file:
            assert max(int(row["record"]) for row in csv.DictReader(file)) < accepted + 2
    finally:
        terminal.process.send_signal(signal.SIGTERM)
        drained = threading.Thread(target=terminal.drain, daemon=True)
        drained.start()
        terminal.process.wait(timeout=120)
        os.close(terminal.keeper)
        StreamJournal(tmp_path / "keys").close(needed=False)


@pytest.mark.slow
def test_a_uav_that_is_held_is_asked_where_this_station_may_speak(place):
    """Only a living autopilot raises its timestamps to the one in our heartbeat."""
    uav = driving(1, system_time=False)
    place.out.setblocking(False)
    place.start("--command")
    heard = []
    end = time.monotonic() + 60.0
    k = 0
    while time.monotonic() < end and (not heard or k < heard[0] + 24):
        place.out.sendto(uav.frame(k, time.time_ns() // 1000), ("127.0.0.1", place.port))
        k += 1
        time.sleep(1.0 / uav.rate_hz)
        try:
            raw = place.out.recv(2048)
        except BlockingIOError:
            continue
        assert raw[2] & 1, "it is signed"
        heard.append(k)
        uav.clock.hears(int.from_bytes(raw[-12:-6], "little"))
    assert heard, "nobody asked"
    verdicts = [verdict for system_id, verdict, _ in place.judged_at_least(k, heard[0]) if system_id == 1]
    assert verdicts[: heard[0]] == [Auth.HELD] * heard[0]
    assert set(verdicts[heard[0] + 5 :]) == {Auth.GOOD}


def test_only_vehicles_of_the_mission_can_be_accepted(tmp_path):
    (tmp_path / "mission.toml").write_text(f"{MISSION}\n[[view]]\nsystem_id = 2\n")
    (tmp_path / "keys").mkdir()
    with pytest.raises(GcsError, match="--accept-late 13: no vehicle of the mission; it has 1, 2, 11, 12"):
        fly(tmp_path / "mission.toml", link=["udpin:127.0.0.1:1"], accept_late=[13], headless=True)
    assert not (tmp_path / "sessions").exists()
