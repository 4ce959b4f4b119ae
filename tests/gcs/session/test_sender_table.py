"""Who sent each record: written in flight, read back for a replay."""

from __future__ import annotations

import random
import socket
import struct
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gcs.playback.analysis import Analysis
from gcs.session.log import RecordSenders, SessionLog
from gcs.session.session import open_session
from mavlink.ingest.receiver import LastSenders
from mavlink.links.batch import Batch
from mavlink.protocol.encoder import COPTER, MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.writer import TlogWriter
from tests.support.receiving import HOST, wait_for

T0 = 1_790_000_000_000_000
HEAD = "record,t_us,system_id,link,peer,address,name\n"
NAMES = ("udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600")


def noted(folder, packets):
    """A log whose senders are noted as the receiving process notes them."""
    senders = LastSenders()
    with TlogWriter(folder / "telemetry.tlog") as writer:
        for packet in packets:
            number = writer.write(packet)
            for _, system_id in senders.changes(packet.link, Batch([packet.t_us], [packet.raw], [packet.peer])):
                address = f"10.0.0.{packet.peer}:1" if packet.link == 0 else ""
                writer.write_sender(
                    number, packet.t_us, system_id, packet.link, packet.peer, address, NAMES[packet.link]
                )
    return SessionLog(folder / "telemetry.tlog")


def crowd(count, seed=3):
    """Five vehicles over two links and three addresses, in any order; some speak MAVLink 1."""
    rng, speakers = random.Random(seed), [MavlinkEncoder(i, version=1 + (i != 4)) for i in range(1, 6)]
    return [
        Packet(T0 + 1000 * k, rng.choice(speakers).heartbeat(), rng.randrange(2), rng.randrange(1, 4))
        for k in range(count)
    ]


def test_every_record_is_given_back_with_its_sender(tmp_path):
    packets = crowd(400)
    log = noted(tmp_path, packets)
    assert list(log.packets()) == packets
    assert log.senders.names == NAMES
    assert (log.senders.address(0, 2), log.senders.address(1, 2), log.senders.address(7, 7)) == ("10.0.0.2:1", "", "")
    assert log.warnings == ()


def test_a_vehicle_that_stays_where_it_is_takes_one_row(tmp_path):
    speakers = [MavlinkEncoder(i) for i in (1, 2, 3)]
    noted(tmp_path, [Packet(T0 + k, speakers[k % 3].heartbeat(), 0, k % 3 + 1) for k in range(90)])
    rows = (tmp_path / "senders.csv").read_text().splitlines()
    assert rows[0] + "\n" == HEAD and len(rows) == 4
    assert rows[1] == f"0,{T0},1,0,1,10.0.0.1:1,{NAMES[0]}"


def test_where_records_are_lost_times_tell(tmp_path):
    packets = crowd(300)
    noted(tmp_path, packets)
    kept = packets[:40] + packets[60:]
    data = b"".join(struct.pack(">Q", packet.t_us) + packet.raw for packet in kept)
    (tmp_path / "telemetry.tlog").write_bytes(data)
    assert list(SessionLog(tmp_path / "telemetry.tlog").packets()) == kept


def test_rows_that_cannot_be_read_are_counted_and_the_rest_holds(tmp_path):
    packets = crowd(100)
    noted(tmp_path, packets)
    with (tmp_path / "senders.csv").open("a") as table:
        table.write("what\n1,2,3\n-1,2,3,4,5,a,b\n7,9999999999999999999999,1,0,1,a,b\n\n")
    log = SessionLog(tmp_path / "telemetry.tlog")
    assert list(log.packets()) == packets
    assert log.warnings == ("senders.csv: 4 rows cannot be read and are left out",)


@given(st.binary(max_size=400))
@example(b"x" * 140_000)
@example(b'0,1,2,3,4,"')
def test_no_table_however_torn_keeps_a_log_from_being_read(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "senders.csv"
        path.write_bytes(HEAD.encode() + data)
        heard = RecordSenders.read(path, T0 + np.arange(3), np.array([1, 2, 1], dtype=np.uint8))
    assert heard.link.shape == heard.peer.shape == (3,) and heard.link.min() >= 0 <= heard.peer.min()


def test_records_before_the_first_row_came_from_nobody_known(tmp_path):
    (tmp_path / "senders.csv").write_text(HEAD + f"2,{T0 + 2},7,1,4,,radio\n")
    t_us, system_id = T0 + np.arange(4), np.array([7, 8, 7, 7], dtype=np.uint8)
    heard = RecordSenders.read(tmp_path / "senders.csv", t_us, system_id)
    assert heard.peer.tolist() == [0, 0, 4, 4] and heard.link.tolist() == [0, 0, 1, 1]
    assert heard.names == ("link 0", "radio")


@pytest.mark.parametrize("count", [0, 1])
def test_a_table_without_rows_or_records_is_no_trouble(tmp_path, count):
    (tmp_path / "senders.csv").write_text(HEAD + f"0,{T0},7,1,4,,radio\n" * count)
    heard = RecordSenders.read(tmp_path / "senders.csv", np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.uint8))
    assert len(heard.link) == 0 and heard.skipped == 0


def two_of_one_id(ingest, port, rounds=25):
    """A vehicle and one that says the same from another address, by turns for three seconds."""
    uav, true, liar = MavlinkEncoder(1), MavlinkEncoder(2), MavlinkEncoder(2)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        for sock in (one, other):
            sock.bind((HOST, 0))
            sock.connect((HOST, port))
        for k in range(rounds):
            one.send(uav.heartbeat(COPTER))
            one.send(true.heartbeat(custom_mode=4))
            other.send(liar.heartbeat(custom_mode=4, status=k % 3 + 3))
            assert len(wait_for(ingest, 3)) == 3
            time.sleep(0.1)
        return other.getsockname()[1]


def test_a_replay_names_the_address_of_a_second_sender(started, tmp_path):
    (tmp_path / "session.toml").write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n")
    ingest, port = started()
    second = two_of_one_id(ingest, port)
    ingest.stop()
    analysis = Analysis(open_session(tmp_path))
    told = [event.text for snapshot in analysis.snapshots() for event in snapshot.events if event.system_id == 2]
    analysis.close()
    assert any(f"{HOST}:{second} on {ingest.names[0]}" in text for text in told), told
