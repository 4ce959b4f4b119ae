"""A vehicle whose position jumps: what its autopilot and the frame say of it, and what becomes of the names."""

import math
import struct
from dataclasses import replace
from functools import cache
from itertools import islice

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.tlog.log import Tlog
from tests.support.bundled import SWARM, with_packets, with_payload

WHO, UAV, FRAMES, BEGIN_S, END_S = 3, 1, 280, 25.0, 33.0
"""Seconds of the log; its frames begin at 15 s, ten a second."""
POSITION, RECEIVER = 33, 24
AIDED, GLITCH = 0x033F, 0x833F


def moved(raw, east_m):
    """The same GLOBAL_POSITION_INT or GPS_RAW_INT, so many metres farther east."""

    def move(payload):
        at = 4 if raw[7] == POSITION else 8
        lat, lon = struct.unpack_from("<ii", payload, at)
        lon += round(east_m / (111_320.0 * math.cos(math.radians(lat * 1e-7))) * 1e7)
        struct.pack_into("<i", payload, at + 4, lon)

    return with_payload(raw, move)


def with_fault(folder, east_m, messages, ratio, who=WHO):
    """A copy of the session in which a vehicle is wrong for eight seconds, and its filter says so where it is asked."""
    speaker, start_us = MavlinkEncoder(who), log_start_us()

    def go_wrong(packet):
        wrong = BEGIN_S <= (packet.t_us - start_us) * 1e-6 < END_S
        hit = packet.system_id == who and packet.message_id in messages and wrong
        yield replace(packet, raw=moved(packet.raw, east_m)) if hit else packet
        if ratio and packet.system_id == who and packet.message_id == 0:
            told = (GLITCH, ratio) if wrong else (AIDED, 0.01)
            status = ardupilotmega.MAVLink_ekf_status_report_message(told[0], 0.01, told[1], 0.01, 0.01, 0.0)
            yield replace(packet, t_us=packet.t_us + 1, raw=speaker.pack(status))

    return with_packets(SWARM, folder, go_wrong)


@cache
def log_start_us():
    return int(Tlog.open(SWARM / "telemetry.tlog").index.t_us[0])


def folded(folder):
    """By time of the log: alarms by key, and names with confidences by box."""
    rows, start_us = [], log_start_us()
    for snapshot in islice(Analysis(open_session(folder)).snapshots(images=False), FRAMES):
        names = [(box.system_id, box.confidence) for box in snapshot.boxes]
        rows.append(((snapshot.t_us - start_us) * 1e-6, {alarm.key for alarm in snapshot.alarms}, names))
    return rows


@pytest.fixture(scope="module")
def well():
    return folded(SWARM)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("east_m", "messages", "ratio", "key"),
    [
        (111.0, (POSITION, RECEIVER), 27.0, f"doubted {WHO}"),
        (15.0, (RECEIVER,), 0.0, f"doubted {WHO}"),
        (15.0, (POSITION, RECEIVER), 0.0, f"conflict {WHO}"),
    ],
    ids=["111 m, told by its filter", "15 m of the receiver", "15 m that only the frame contradicts"],
)
def test_a_wrong_position_is_an_alarm_while_it_lasts_and_costs_no_other_name(
    tmp_path, well, east_m, messages, ratio, key
):
    rows = folded(with_fault(tmp_path, east_m, messages, ratio))
    times = [t_s for t_s, keys, _ in rows if key in keys]
    # the way back is believed after a second, and an alarm stays for three
    assert BEGIN_S < min(times) < BEGIN_S + 3.0 and END_S - 0.5 < max(times) < END_S + 1.0 + 5.0
    assert set().union(*(keys for _, keys, _ in rows)) == {key}
    doubted = key.startswith("doubted")
    for (t_s, keys, names), (_, _, expected) in zip(rows, well, strict=True):
        if t_s > 20.0:
            assert [i for i, _ in names if i != WHO] == [i for i, _ in expected if i != WHO], t_s
        # the last frames wait for telemetry of after the end
        if doubted and key in keys and t_s < END_S - 0.2:
            assert all(confidence < 0.9 for i, confidence in names if i == WHO), t_s
    assert [i for i, _ in rows[-1][2]] == [i for i, _ in well[-1][2]]


@pytest.mark.slow
@pytest.mark.parametrize("east_m", [15.0, 55.0])
def test_a_step_of_the_uavs_position_costs_no_name(tmp_path, well, east_m):
    rows = folded(with_fault(tmp_path, east_m, (POSITION, RECEIVER), 0.0, UAV))
    for (t_s, _, names), (_, _, expected) in zip(rows, well, strict=True):
        assert [i for i, _ in names] == [i for i, _ in expected] or t_s < 20.0, t_s
