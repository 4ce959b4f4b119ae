import math
import os
import socket
import subprocess
import sys
import time

import pytest

from mavlink.errors import LinkError, SigningError, TlogError
from mavlink.ingest.ingest import Ingest
from mavlink.ingest.plan import Outputs, Signing
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import Auth
from mavlink.signing.keys import write_key
from tests.support.frames import heartbeats
from tests.support.ports import free_port
from tests.support.receiving import HOST, is_free, recorded, wait_for
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sockets are lent to another process")


def test_poison_costs_nobody_anything(started, sender, tmp_path):
    ingest, port = started()
    frames, packets = heartbeats(2000), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for k, frame in enumerate(frames):
            if k % 10 == 0:
                stranger.sendto((b"\xfd\xff\x00", b"\xfd\xff\x01")[k // 10 % 2], (HOST, port))
            sender.sendto(frame, (HOST, port))
            if k % 100 == 99:  # no more on the way than any system's buffer holds
                packets += wait_for(ingest, k - 100 - len(packets))
    packets += wait_for(ingest, 2000 - len(packets))
    assert [packet.raw for packet in packets] == frames
    assert {packet.auth for packet in packets} == {Auth.OPEN} and len({packet.peer for packet in packets}) == 1
    ingest.stop()
    assert recorded(tmp_path) == frames
    counts = ingest.health().links[0].counts
    # 200 of poison at once are a flood, of which not all are let in
    assert (counts.packets, counts.junk_bytes + 3 * counts.turned_away, counts.dropped) == (2000, 600, 0)


def test_unknown_messages_are_recorded_and_make_nobody_known(started, sender):
    ingest, port = started()
    unknown = bytearray(MavlinkEncoder(1).heartbeat())
    unknown[7:10] = (60_000).to_bytes(3, "little")
    unknown[-2:] = checksum(bytes(unknown), 77).to_bytes(2, "little")
    sender.sendto(bytes(unknown), (HOST, port))
    packets = wait_for(ingest, 1)
    assert [packet.message_id for packet in packets] == [60_000]
    assert until(lambda: ingest.health().links[0].counts.unknown == 1)
    assert ingest.health().links[0].peers == 0


def test_garbage_gets_no_answer(started, sender):
    ingest, port = started()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind((HOST, 0))
        for data in (b"\xfd\xff\x00", b"hello", MavlinkEncoder(1).heartbeat()[:-1] + b"\xff"):
            stranger.sendto(data, (HOST, port))
        sender.sendto(MavlinkEncoder(1).heartbeat(), (HOST, port))
        wait_for(ingest, 1)
        for _ in range(3):
            ingest.send(0, b"to those who are known")
        sender.settimeout(60.0)
        assert sender.recv(100) == b"to those who are known"
        stranger.settimeout(0.2)
        with pytest.raises(TimeoutError):
            stranger.recv(100)
    with pytest.raises(LinkError, match="no link 1"):
        ingest.send(1, b"x")


def test_with_keys_only_those_who_have_them_are_believed_and_answered(started, sender, tmp_path):
    keys, secret = tmp_path / "keys", bytes(range(1, 33))
    keys.mkdir(mode=0o700)
    write_key(keys, 1, secret)
    ingest, port = started(signing=Signing(keys=str(keys)))
    good, forger = MavlinkEncoder(1, key=secret), MavlinkEncoder(1, key=bytes(32 * [9]))
    ticks = int((time.time() - 1_420_070_400) * 100_000)
    good._mav.signing.timestamp = forger._mav.signing.timestamp = ticks
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind((HOST, 0))
        replayed = good.heartbeat()
        sender.sendto(replayed, (HOST, port))
        wait_for(ingest, 1)
        for data in (forger.heartbeat(), MavlinkEncoder(1).heartbeat(), replayed):
            stranger.sendto(data, (HOST, port))
        packets = wait_for(ingest, 3)
        assert [packet.auth for packet in packets] == [Auth.BAD, Auth.UNSIGNED, Auth.REPLAYED]
        assert ingest.health().links[0].peers <= 1
        where = f"{HOST}:{stranger.getsockname()[1]}"
        assert until(lambda: ingest.address(0, packets[0].peer) == where), "an operator is told where a forger is"
        sender.sendto(good.heartbeat(), (HOST, port))
        assert [packet.auth for packet in wait_for(ingest, 1)] == [Auth.GOOD]
        ingest.send(0, b"known")
        sender.settimeout(60.0)
        assert sender.recv(100) == b"known"
        stranger.settimeout(0.2)
        with pytest.raises(TimeoutError):
            stranger.recv(100)
    ingest.stop()
    assert ingest.health().refused == 3
    rows = (tmp_path / "refused.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows[1:]] == ["1", "2", "3"]
    assert [int(row.split(",")[1]) for row in rows[1:]] == [packet.t_us for packet in packets]
    assert len(recorded(tmp_path)) == 5


def test_the_address_of_a_tcp_client_is_known(started, tmp_path):
    port = free_port(socket.SOCK_STREAM)
    ingest = started(f"tcpin:{HOST}:{port}")
    with socket.create_connection((HOST, port)) as client:
        client.sendall(MavlinkEncoder(1).heartbeat())
        (packet,) = wait_for(ingest, 1)
        where = f"{HOST}:{client.getsockname()[1]}"
        assert until(lambda: ingest.address(0, packet.peer) == where)
        assert ingest.address(0, packet.peer + 1) == ingest.address(1, packet.peer) == ""
    ingest.stop()
    assert where in (tmp_path / "senders.csv").read_text()


def test_a_key_is_never_recorded_or_handed_over(started, sender, tmp_path):
    from pymavlink.dialects.v20 import ardupilotmega

    ingest, port = started()
    secret = bytes(range(100, 132))
    sender.sendto(MavlinkEncoder(255).pack(ardupilotmega.MAVLink_setup_signing_message(1, 1, secret, 5)), (HOST, port))
    packets = wait_for(ingest, 1)
    assert packets[0].message_id == 256 and secret[:8] not in packets[0].raw
    ingest.stop()
    assert secret[:8] not in (tmp_path / "telemetry.tlog").read_bytes()


def test_what_comes_goes_on_to_other_programs(started, sender):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((HOST, 0))
        other.settimeout(60.0)
        ingest, port = started(outputs=Outputs(urls=(f"udpout:{HOST}:{other.getsockname()[1]}?ro",)))
        frame = MavlinkEncoder(1).heartbeat()
        sender.sendto(frame, (HOST, port))
        assert other.recv(300) == frame
        assert until(lambda: [output.sent for output in ingest.health().outputs] == [1])


def test_a_second_station_on_the_port_is_told_who_has_it(started, tmp_path):
    _, port = started()
    with pytest.raises(LinkError, match=f"UDP port {port} is in use by process {os.getpid()} ") as caught:
        Ingest([f"udpin:{HOST}:{port}"], tmp_path / "second.tlog")
    assert "\n" not in str(caught.value) and not (tmp_path / "second.tlog").exists()


def test_a_log_is_never_overwritten(tmp_path):
    (tmp_path / "telemetry.tlog").write_bytes(b"a flight")
    with pytest.raises(TlogError, match="never overwritten"):
        Ingest([f"udpin:{HOST}:{free_port()}"], tmp_path / "telemetry.tlog")
    assert (tmp_path / "telemetry.tlog").read_bytes() == b"a flight"


@pytest.mark.parametrize("url", ["/dev/ttyNowhere,57600", "tcp:nowhere..bad:5760", "udpout:nowhere..bad:1", "nonsense"])
def test_what_cannot_be_opened_is_said_in_one_line(url, tmp_path):
    with pytest.raises(LinkError) as caught:
        Ingest([url], tmp_path / "telemetry.tlog")
    assert "\n" not in str(caught.value)


def test_the_process_imports_nothing_heavy():
    heavy = "numpy cv2 textual rich onnxruntime pyproj scipy av typer"
    code = f"import sys, mavlink.ingest.worker; print([m for m in '{heavy}'.split() if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_keys_that_cannot_be_used_are_said_before_the_flight(tmp_path):
    (tmp_path / "keys").mkdir(mode=0o700)
    with pytest.raises(SigningError, match="no key in it"):
        Ingest([f"udpin:{HOST}:{free_port()}"], tmp_path / "a.tlog", signing=Signing(keys=str(tmp_path / "keys")))


def test_stopping_twice_and_reading_after_it(started, sender):
    ingest, port = started()
    sender.sendto(MavlinkEncoder(1).heartbeat(), (HOST, port))
    wait_for(ingest, 1)
    assert until(lambda: math.isfinite(ingest.health().links[0].counts.silent_s))
    ingest.stop()
    ingest.stop()
    assert ingest.read(0.0) == [] and ingest.health().packets == 1
    with pytest.raises(LinkError, match="has ended"):
        ingest.send(0, b"x")


@pytest.mark.parametrize("out", ["udpout:{host}:{port}", "udpout:localhost:{port}?ro"])
def test_an_output_into_a_port_of_our_own_is_refused(tmp_path, out):
    port = free_port()
    with pytest.raises(LinkError, match="own udpin"):
        Ingest(
            [f"udpin:0.0.0.0:{port}"],
            tmp_path / "telemetry.tlog",
            outputs=Outputs(urls=(out.format(host=HOST, port=port),)),
        )
    assert is_free(port) and list(tmp_path.iterdir()) == []


def test_a_link_given_twice_is_told_as_that(tmp_path):
    url = f"udpin:{HOST}:{free_port()}"
    with pytest.raises(LinkError, match="given twice"):
        Ingest([url, url], tmp_path / "telemetry.tlog")
