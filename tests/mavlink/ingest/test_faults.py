"""Receiving that dies, hangs, is flooded or loses its line."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter

import pytest

from infra.files.segment import segments
from mavlink.ingest.plan import Signing
from mavlink.links.udp import MIN_BUFFER_BYTES
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.signing.keys import write_key
from tests.support.frames import heartbeats
from tests.support.ports import free_port
from tests.support.receiving import HOST, bearable, carry, is_free, read_to, recorded, send, steady, wait_for
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sockets are lent to another process")


def test_death_of_the_process_loses_nothing(started, sender, tmp_path):
    ingest, port = started()
    assert until(lambda: ingest.supervisor.spare is not None)
    rate = bearable(ingest, 1500)
    frames = heartbeats(int(2 * rate))
    thread = threading.Thread(target=steady, args=(sender, port, frames[:-1], rate))
    thread.start()
    packets = wait_for(ingest, int(0.6 * rate))
    first = ingest.pid
    os.kill(first, signal.SIGKILL)
    thread.join()
    assert until(lambda: ingest.health().restarts == 1)
    sender.sendto(frames[-1], (HOST, port))
    packets += read_to(ingest, frames[-1])
    health, texts = ingest.health(), [notice.text for notice in ingest.notices()]
    assert health.restarts == 1 and ingest.pid != first and health.gap_s > 0.0
    gap = f"nothing received for {health.gap_s:.1f} s"
    assert any("died (signal 9" in text and gap in text for text in texts)
    ingest.stop()
    log = recorded(tmp_path)
    # what is in one process's hands when it is killed, one batch, may be lost; here it never is all of a batch
    assert len(log) >= len(frames) - 256 and log == [frame for frame in frames if frame in set(log)]
    assert {packet.raw for packet in packets} <= set(log)
    assert len(segments(tmp_path / "telemetry.tlog")) == 2
    assert ingest.health().packets == len(log)


def test_senders_keep_their_numbers_and_are_known_when_another_process_takes_over(started):
    ingest, port = started()
    socks = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    try:
        for k, sock in enumerate(socks):
            sock.sendto(MavlinkEncoder(k + 1).heartbeat(), (HOST, port))
            sock.settimeout(60.0)
        numbers = {packet.system_id: packet.peer for packet in wait_for(ingest, 3)}
        assert until(lambda: ingest.health().links[0].peers == 3)
        told = [ingest.address(0, numbers[k + 1]) for k in range(3)]
        assert told == [f"{HOST}:{sock.getsockname()[1]}" for sock in socks]
        assert ingest.address(0, 99) == ingest.address(1, 1) == ""
        os.kill(ingest.pid, signal.SIGKILL)
        assert until(lambda: ingest.health().restarts == 1)
        ingest.send(0, b"the second alone", numbers[2])
        assert socks[1].recv(100) == b"the second alone"
        ingest.send(0, b"all")
        assert [sock.recv(100) for sock in socks] == [b"all"] * 3
        for k, sock in reversed(list(enumerate(socks))):
            sock.sendto(MavlinkEncoder(k + 1).heartbeat(), (HOST, port))
        assert {packet.system_id: packet.peer for packet in wait_for(ingest, 3)} == numbers
    finally:
        for sock in socks:
            sock.close()


def test_a_process_that_hangs_is_replaced_and_loses_nothing(started, sender, tmp_path):
    ingest, port = started()
    assert until(lambda: ingest.supervisor.spare is not None)
    rate = bearable(ingest, 2000)
    frames = heartbeats(int(1.5 * rate))
    sender.sendto(frames[0], (HOST, port))
    packets = wait_for(ingest, 1)
    os.kill(ingest.pid, signal.SIGSTOP)
    steady(sender, port, frames[1:], rate)
    packets += wait_for(ingest, len(frames) - 1)
    assert [packet.raw for packet in packets] == frames
    health = ingest.health()
    assert health.restarts == 1
    assert any("showed no life" in notice.text for notice in ingest.notices())
    ingest.stop()
    assert recorded(tmp_path) == frames


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts what it drops")
def test_what_the_system_drops_while_a_process_hangs_is_counted(started, sender):
    size, junk = 60_000, bytes(60_000)
    ingest, port = started()
    sender.sendto(heartbeats(1)[0], (HOST, port))
    wait_for(ingest, 1)
    os.kill(ingest.pid, signal.SIGSTOP)
    sent = 2 * ingest.health().links[0].buffer_bytes // size
    for _ in range(sent):
        sender.sendto(junk, (HOST, port))

    def counts():
        return ingest.health().links[0].counts

    assert until(lambda: counts().junk_bytes // size + counts().dropped >= sent)
    assert counts().dropped > 0 and counts().junk_bytes // size + counts().dropped == sent


def test_how_far_it_has_heard_stands_still_while_nobody_receives(started, sender, monkeypatch):
    """What came meanwhile is not known yet, so nobody may be called silent for it."""
    # on a busy machine another process could take over between the looks
    monkeypatch.setattr("mavlink.ingest.ingest.HUNG_S", 600.0)
    ingest, port = started()
    sender.sendto(heartbeats(1)[0], (HOST, port))
    packet, *_ = wait_for(ingest, 1)

    def heard_us():
        ingest.read(0.06)
        return ingest.heard_us

    assert until(lambda: heard_us() > packet.t_us) and until(lambda: heard_us() > time.time() * 1e6 - 400_000)
    os.kill(ingest.pid, signal.SIGSTOP)
    stopped_us = time.time() * 1e6
    for _ in range(5):
        assert heard_us() <= stopped_us
    os.kill(ingest.pid, signal.SIGKILL)
    assert until(lambda: heard_us() > stopped_us + 500_000), "another process takes over"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")
def test_a_station_that_stalls_or_dies_takes_no_record_with_it(sender, tmp_path):
    port = free_port()
    code = (
        "import sys, time; from pathlib import Path; from mavlink.ingest.ingest import Ingest\n"
        f"i = Ingest(['udpin:{HOST}:{port}'], Path(sys.argv[1]) / 'telemetry.tlog'); print(i.pid, flush=True)\n"
        "n = 0\n"
        "while n < 2001: n += len(i.read(0.2))\n"
        "print(n, flush=True); time.sleep(60)\n"
    )
    station = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        pid = int(station.stdout.readline())
        frames = heartbeats(2001)
        station.send_signal(signal.SIGSTOP)
        log, record_bytes = tmp_path / "telemetry.tlog", 8 + len(frames[0])
        send(sender, port, frames[:2000], lambda: log.stat().st_size // record_bytes)
        station.send_signal(signal.SIGCONT)
        sender.sendto(frames[2000], (HOST, port))
        assert station.stdout.readline() == "2001\n"
        assert until(lambda: log.stat().st_size == len(frames) * record_bytes)
        assert recorded(tmp_path) == frames
    finally:
        station.kill()
        station.wait()
        station.stdout.close()
    assert until(lambda: not os.path.exists(f"/proc/{pid}"))  # noqa: PTH110
    assert until(lambda: is_free(port))


def test_who_does_not_read_loses_packets_that_are_counted_and_in_the_log(started, sender, tmp_path):
    ingest, port = started(ring_bytes=8192)
    frames = heartbeats(1000)
    send(sender, port, frames, lambda: ingest.health().packets)
    assert ingest.health().packets == 1000
    packets = wait_for(ingest, 1)
    assert until(lambda: packets.extend(ingest.read(0.01)) or len(packets) + ingest.health().overrun >= 1000)
    assert 0 < len(packets) < 1000
    assert ingest.health().overrun == 1000 - len(packets)
    ingest.stop()
    assert recorded(tmp_path) == frames


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's socket filters")
def test_a_flood_of_strangers_costs_no_known_vehicle_a_packet(started, sender, tmp_path):
    ingest, port = started(system_ids=range(1, 21))
    if ingest.health().links[0].buffer_bytes < MIN_BUFFER_BYTES:
        pytest.skip("this system grants too small a receive buffer: see net.core.rmem_max")
    code = (
        "import socket\n"
        "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        "while True:\n"
        f"    for data in (b'\\xfd\\xff\\x00', b'junk' * 9, bytes(30)): s.sendto(data, ('{HOST}', {port}))\n"
    )
    frames = heartbeats(4000)
    packets = carry(ingest, sender, port, frames[:100])
    flood = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert until(lambda: ingest.health().links[0].narrow)
        thread = threading.Thread(target=steady, args=(sender, port, frames[100:-1], 1000))
        thread.start()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rebooted:
            # a vehicle that comes back on a new port in the middle of it
            back = MavlinkEncoder(7).heartbeat(custom_mode=99_999)

            def is_heard():
                rebooted.sendto(back, (HOST, port))
                packets.extend(ingest.read(0.05))
                return back in {packet.raw for packet in packets}

            assert until(is_heard)
        thread.join()
    finally:
        flood.kill()
        flood.wait()
    sender.sendto(frames[-1], (HOST, port))
    packets += read_to(ingest, frames[-1])
    seen = Counter(packet.raw for packet in packets)
    assert [frame for frame in frames if not seen[frame]] == []
    counts = ingest.health().links[0].counts
    assert counts.turned_away > 1000
    assert until(lambda: not ingest.health().links[0].narrow)
    assert len(recorded(tmp_path)) >= 4000


def test_tcp_comes_back_and_holds_up_nobody(started, sender):
    with socket.create_server((HOST, 0)) as server:
        udp, tcp = free_port(), server.getsockname()[1]
        ingest = started(f"udpin:{HOST}:{udp}", f"tcp:{HOST}:{tcp}")
        for system_id in (1, 2):
            server.settimeout(60.0)
            peer, _ = server.accept()
            with peer:
                peer.sendall(MavlinkEncoder(system_id).heartbeat()[:9])
                time.sleep(0.1)
                peer.sendall(MavlinkEncoder(system_id).heartbeat()[9:] + MavlinkEncoder(system_id).heartbeat())
                assert [(p.system_id, p.link) for p in wait_for(ingest, 2)] == [(system_id, 1)] * 2
                ingest.send(1, b"answer")
                peer.settimeout(60.0)
                assert peer.recv(100) == b"answer"
    sender.sendto(MavlinkEncoder(9).heartbeat(), (HOST, udp))
    assert [(p.system_id, p.link) for p in wait_for(ingest, 1)] == [(9, 0)]
    assert until(lambda: not ingest.health().links[1].connected)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals on this system")
def test_a_serial_port_that_is_unplugged_comes_back(started, tmp_path):
    def plug_in():
        controller, device = os.openpty()
        port = tmp_path / "radio"
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(device))
        return controller, device

    ends = plug_in()
    ingest = started(f"serial:{tmp_path}/radio:57600")
    try:
        os.write(ends[0], MavlinkEncoder(3).heartbeat())
        assert [p.system_id for p in wait_for(ingest, 1)] == [3]
        for end in ends:
            os.close(end)
        (tmp_path / "radio").unlink()
        assert until(lambda: not ingest.health().links[0].connected)
        ends = plug_in()
        assert until(lambda: ingest.health().links[0].connected)
        os.write(ends[0], MavlinkEncoder(4).heartbeat())
        assert [p.system_id for p in wait_for(ingest, 1)] == [4]
        assert ingest.health().restarts == 0
    finally:
        ingest.stop()
        for end in ends:
            os.close(end)


def test_records_are_numbered_over_all_processes(started, sender, tmp_path):
    keys, secret = tmp_path / "keys", bytes(range(1, 33))
    keys.mkdir(mode=0o700)
    write_key(keys, 1, secret)
    ingest, port = started(signing=Signing(keys=str(keys)))
    numbers, sent = [], 0
    for life in range(3):
        for k in range(10):
            sender.sendto(MavlinkEncoder(1).heartbeat(custom_mode=100 * life + k), (HOST, port))
            numbers.append(sent + k)
        sent += 10
        assert len(wait_for(ingest, 10)) == 10
        if life < 2:
            os.kill(ingest.pid, signal.SIGKILL)
            assert until(lambda now=life: ingest.health().restarts == now + 1)
    ingest.stop()
    assert len(recorded(tmp_path)) == 30  # in as many segments as there were processes that came to write
    tables = segments(tmp_path / "refused.csv")
    rows = [row.split(",") for table in tables for row in table.read_text().splitlines()[1:]]
    assert [int(row[0]) for row in rows] == numbers
    assert ingest.health().refused == 30
