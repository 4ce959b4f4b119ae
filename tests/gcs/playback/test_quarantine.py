"""A real recording in which, for a while, somebody else speaks under the id of one of the vehicles."""

import csv
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs.playback.analysis import Analysis
from gcs.session.identity_log import IdentityLog
from gcs.session.session import open_session
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import checksum
from mavlink.tlog.log import Tlog

SWARM = Path("sitl_logs/ardupilot-swarm")
S = 1_000_000
BEGIN_S, END_S = 35, 50  # of the log
VICTIM, OTHER = 4, 6


def with_sender(raw, system_id):
    """A MAVLink 2 frame as if another system had sent it."""
    body = raw[:5] + bytes([system_id]) + raw[6 : 10 + raw[1]]
    return body + struct.pack("<H", checksum(body, DEFINITIONS[int.from_bytes(raw[7:10], "little")][1]))


def invaded(folder, message_ids):
    """A copy of the recording in which another rover also speaks as the victim; when that begins and ends."""
    shutil.copytree(SWARM, folder)
    packets = list(Tlog.open(SWARM / "telemetry.tlog").packets())
    begin_us, end_us = packets[0].t_us + BEGIN_S * S, packets[0].t_us + END_S * S
    rows = list(packets)
    for packet in packets:
        wanted = message_ids is None or packet.message_id in message_ids
        if (
            packet.system_id == OTHER
            and packet.message_id in DEFINITIONS
            and begin_us <= packet.t_us < end_us
            and wanted
        ):
            rows.append(replace(packet, t_us=packet.t_us + 37_000, raw=with_sender(packet.raw, VICTIM)))
    rows.sort(key=lambda packet: packet.t_us)
    with (folder / "telemetry.tlog").open("wb") as file:
        for packet in rows:
            file.write(struct.pack(">Q", packet.t_us) + packet.raw)
    return begin_us, end_us


def test_no_name_comes_out_of_quarantine(tmp_path):
    begin_us, end_us = invaded(tmp_path / "session", {0, 33})
    events = []
    with IdentityLog(tmp_path / "out") as log:
        for snapshot in Analysis(open_session(tmp_path / "session")).snapshots(images=False):
            log.write(snapshot)
            events += snapshot.events
    with (tmp_path / "out" / "identity.csv").open() as file:
        names = np.array([(int(row["time_us"]), int(row["system_id"] or 0)) for row in csv.DictReader(file)])
    alarms = [event for event in events if event.text.startswith(f"two senders use system id {VICTIM}")]
    assert len(alarms) == 1 and alarms[0].level == "alarm"
    found_us = alarms[0].t_us
    assert found_us - begin_us <= 2 * S
    named = names[names[:, 1] == VICTIM, 0]
    assert (named < begin_us).any()
    assert not ((named > found_us) & (named < end_us + 4 * S)).any()
    others = names[(names[:, 0] > found_us) & (names[:, 0] < end_us), 1]
    assert {2, 3, 5, 6, 7} <= set(others.tolist())
    released = [event.t_us for event in events if "one sender again" in event.text]
    assert len(released) == 1 and end_us + 4 * S < released[0] < end_us + 5 * S
