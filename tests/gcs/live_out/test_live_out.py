"""A flight that tells others keeps all its packets, whatever becomes of those it tells."""

import json
import os
import signal
import socket
import threading
import time
from contextlib import ExitStack
from dataclasses import replace

import psutil
import pytest

from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.live_out import live_out
from gcs.live_out.live_out import LiveOut
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import parse_publish_url
from tests.support.bundled import SWARM
from tests.support.command_line import OnTerminal, Terminal, heartbeat
from tests.support.ports import free_port, udp_socket
from tests.support.snapshots import TWO_UGVS, box, snapshot
from tests.support.waiting import until

SOURCE = SinkSource(name="flight")


class Station:
    """Shows another snapshot whenever it is asked."""

    def __init__(self):
        self.frame = 0

    def latest(self):
        self.frame += 1
        return snapshot(self.frame, boxes=[box(1, 2)])


@pytest.fixture
def tell():
    said = []
    with ExitStack() as stack:

        def begin(latest, *urls):
            return stack.enter_context(
                LiveOut(latest, tuple(map(parse_publish_url, urls)), SOURCE, lambda text, level: said.append(text))
            ), said

        yield begin


def newest(reader):
    """The last of the datagrams that wait, None without any."""
    data = None
    try:
        while True:
            data = reader.recv(70_000)
    except BlockingIOError:
        return json.loads(data) if data else None


def url_of(reader):
    return f"json+udp://127.0.0.1:{reader.getsockname()[1]}"


@pytest.mark.slow
def test_a_flight_loses_nothing_with_a_hung_a_dead_and_a_slow_sink(tmp_path, tell, monkeypatch):
    monkeypatch.setattr(live_out, "PATIENCE_S", 5.0)
    port, served = free_port(), free_port(socket.SOCK_STREAM)
    plan = FlightPlan(mission=TWO_UGVS, links=(f"udpin:127.0.0.1:{port}",), video="", sessions=tmp_path)
    flight = Flight(plan)
    with udp_socket() as first, udp_socket() as second, ExitStack() as closing:
        try:
            urls = url_of(first), url_of(second)
            telling, said = tell(flight.latest, *urls, f"json+tcp://127.0.0.1:{served}")
            hung, dead, _ = (outlet.supervisor.process.pid for outlet in telling.outlets)
            assert until(lambda: newest(first)) and until(lambda: newest(second))
            assert until(lambda: telling.outlets[2].latest.error == "" and _connects(served, closing))
            os.kill(hung, signal.SIGSTOP)
            os.kill(dead, signal.SIGKILL)
            seen, sent = flight.latest(), 0
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
                while sent < 2000 or not all(outlet.supervisor.restarts for outlet in telling.outlets[:2]):
                    vehicle.sendto(heartbeat(), ("127.0.0.1", port))
                    sent += 1
                    time.sleep(0.001)
                    assert sent < 120_000, "the processes were not replaced"
            assert until(lambda: flight.packets == sent)
            assert until(lambda: flight.latest().t_us - seen.t_us > 1_000_000)
            newest(first), newest(second)
            assert until(lambda: newest(first)) and until(lambda: newest(second)), "both are told again"
            assert until(lambda: len(said) == 4)
        finally:
            flight.stop()
    assert flight.lost == ()
    assert any("showed no life" in line and urls[0] in line for line in said)
    assert any("died (signal 9)" in line and urls[1] in line for line in said)
    assert sum("is told again" in line for line in said) == 2


def _connects(port, closing):
    """A client that never reads."""
    try:
        return closing.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60))
    except OSError:
        return None


@pytest.mark.slow
def test_memory_does_not_grow_while_nobody_takes_anything(tell):
    station = Station()
    with udp_socket() as reader:
        telling, _ = tell(station.latest, url_of(reader))
        assert until(lambda: newest(reader))
        child = psutil.Process(telling.outlets[0].supervisor.process.pid)
        child.suspend()
        before, frame = psutil.Process().memory_info().rss, station.frame
        assert until(lambda: station.frame > frame + 300)
        assert psutil.Process().memory_info().rss - before < 20 << 20
        child.resume()
        newest(reader)
        assert until(lambda: (newest(reader) or {"frame": 0})["frame"] > frame + 300), "what waited is not told"


def test_each_address_is_told_what_is_newest(tell):
    with udp_socket() as first, udp_socket() as second:
        tell(lambda: replace(snapshot(7, boxes=[box(1, 2)])), url_of(first), url_of(second))
        told = [until(lambda reader=reader: newest(reader)) for reader in (first, second)]
        assert told == [True, True]


def test_trouble_is_reported_once_and_its_end_too(tell):
    port = free_port(socket.SOCK_STREAM)
    with socket.create_server(("127.0.0.1", port)) as taken:
        _, said = tell(Station().latest, f"json+tcp://127.0.0.1:{port}")
        assert until(lambda: said)
        time.sleep(1.0)
        assert len(said) == 1
        assert "ddress already in use" in said[0]
        taken.close()
        lines = threading.Thread(target=_read_a_line, args=(port,), daemon=True)
        lines.start()
        assert until(lambda: len(said) == 2)
        lines.join(60)
    assert said[1] == f"json+tcp://127.0.0.1:{port}: is told again"
    assert not lines.is_alive()


def _read_a_line(port):
    while True:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=60) as client, client.makefile() as lines:
                for _ in range(200):
                    lines.readline()
                return
        except OSError:
            time.sleep(0.1)


def test_processes_end_with_it(tell):
    with udp_socket() as reader:
        telling, said = tell(Station().latest, url_of(reader))
        assert until(lambda: newest(reader))
        pid = telling.outlets[0].supervisor.process.pid
        telling.close()
        assert until(lambda: not psutil.pid_exists(pid))
        assert said == []


def test_a_flight_tells_on_the_command_line(tmp_path):
    with udp_socket() as reader:
        terminal = Terminal(tmp_path, "--headless", "--publish", url_of(reader))
        try:
            terminal.read_until(b"stop with Ctrl-C")
            terminal.send(10)
            told = []
            assert until(lambda: told.append(newest(reader)) or told[-1])
            code, session = terminal.ended(signal.SIGTERM)
            os.close(terminal.keeper)
            assert code == 0
            assert (told[-1]["source"], told[-1]["replayed"]) == (session.name, False)
            assert [row["system_id"] for row in told[-1]["vehicles"]] == [1, 11]
        finally:
            if terminal.process.poll() is None:
                terminal.process.kill()
                terminal.process.wait()


@pytest.mark.slow
def test_a_replay_tells_on_the_command_line():
    with udp_socket() as reader:
        replay = OnTerminal("replay", SWARM, "--publish", url_of(reader))
        try:
            reading = threading.Thread(target=replay.drain, daemon=True)  # who writes to a full terminal waits
            reading.start()
            told = []
            assert until(lambda: told.append(newest(reader)) or (told[-1] or {}).get("replayed"))
            assert told[-1]["source"] == SWARM.name
        finally:
            replay.process.kill()
            replay.process.wait()
