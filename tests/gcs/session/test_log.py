import struct
from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import SessionError
from gcs.playback.analysis import Analysis
from gcs.playback.discovery import discover
from gcs.session.clock_steps import ClockSteps
from gcs.session.log import SessionLog
from gcs.session.session import open_session
from gcs.session.tables import read_table
from infra.session_format import TableFormat
from infra.wall_clock import ClockWatch
from mavlink.errors import TlogError
from mavlink.protocol.encoder import COPTER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.tlog.log import Tlog
from mavlink.tlog.writer import TlogWriter
from tests.support.video_senders import steady, write_clip

T0 = 1_790_000_000_000_000
HOUR_US = 3_600_000_000


def heartbeats(count, step_us=10_000):
    speakers = [MavlinkEncoder(1), MavlinkEncoder(2), MavlinkEncoder(3)]
    return [
        Packet(T0 + k * step_us, speakers[k % 3].heartbeat(**({"kind": COPTER} if k % 3 == 0 else {})))
        for k in range(count)
    ]


PACKETS = heartbeats(300)


def raw(packets):
    return b"".join(struct.pack(">Q", packet.t_us) + packet.raw for packet in packets)


def write(folder, *segments):
    for k, packets in enumerate(segments):
        (folder / (f"telemetry.{k}.tlog" if k else "telemetry.tlog")).write_bytes(
            packets if isinstance(packets, bytes) else raw(packets)
        )
    return SessionLog(folder / "telemetry.tlog")


def test_one_undamaged_file_is_read_as_it_is(tmp_path):
    log = write(tmp_path, PACKETS)
    assert list(log.packets()) == PACKETS
    assert (len(log), log.start_us, log.stop_us) == (300, T0, PACKETS[-1].t_us)
    assert log.warnings == ()


@pytest.mark.parametrize(
    "parts",
    [
        [PACKETS[:100], PACKETS[100:]],  # a size limit: nothing twice
        [PACKETS[:100], PACKETS[80:]],  # a failed sync: the last twenty again
        [PACKETS[:100], PACKETS[80:120], PACKETS[80:]],  # and once more
        [PACKETS[:100], PACKETS[80:90], PACKETS[80:]],  # the second segment failed while it was filled
        [PACKETS[:100], b"", PACKETS[80:]],  # nothing of it came on the disk
        [PACKETS[:100], raw(PACKETS[80:90])[:-4], PACKETS[80:]],  # torn, and could not be cut
        [raw(PACKETS[:95]) + bytes(500), PACKETS[90:]],  # the power was cut: zeros at the end
    ],
)
def test_segments_are_one_log_and_each_record_counts_once(tmp_path, parts):
    log = write(tmp_path, *parts)
    assert list(log.packets()) == PACKETS


def test_more_than_nine_segments_stay_in_order(tmp_path):
    assert list(write(tmp_path, *[PACKETS[k : k + 25] for k in range(0, 300, 25)]).packets()) == PACKETS


def test_a_segment_that_cannot_be_read_is_said(tmp_path):
    log = write(tmp_path, b"", PACKETS)
    assert list(log.packets()) == PACKETS
    assert log.warnings == (f"{tmp_path / 'telemetry.tlog'}: empty file",)
    (tmp_path / "telemetry.1.tlog").write_bytes(b"")
    with pytest.raises(TlogError, match="empty file"):
        SessionLog(tmp_path / "telemetry.tlog")


def test_a_flight_with_frames_and_a_dead_radio_is_a_recording_too(tmp_path):
    (tmp_path / "session.toml").write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n")
    (tmp_path / "frames.csv").write_text("frame,time_us\n" + "".join(f"{k},{T0 + k * 40_000}\n" for k in range(10)))
    with pytest.raises(TlogError, match="empty file"):
        write(tmp_path, b"")
    write_clip(tmp_path / "video.mp4", steady(10))
    (tmp_path / "detections.csv").write_text("frame,cx,cy,w,h,angle,score,heading\n")
    log = write(tmp_path, b"", b"")
    assert (len(log), log.start_us, log.stop_us, list(log.packets())) == (0, 0, 0, [])
    assert log.warnings == ("telemetry.tlog: nothing was received in flight; there is only the video",)
    analysis = Analysis(open_session(tmp_path))
    assert [snapshot.t_us for snapshot in analysis.snapshots()] == [T0 + k * 40_000 for k in range(10)]
    analysis.close()


def test_a_session_whose_first_segment_is_gone_is_one_still(tmp_path):
    write(tmp_path, PACKETS[:100], PACKETS[100:])
    (tmp_path / "telemetry.tlog").unlink()
    assert list(SessionLog(open_session(tmp_path).tlog).packets()) == PACKETS[100:]


def test_a_log_of_another_name_stands_alone(tmp_path):
    write(tmp_path, PACKETS[:100], PACKETS[100:])
    (tmp_path / "telemetry.tlog").rename(tmp_path / "flight.tlog")
    (tmp_path / "telemetry.1.tlog").rename(tmp_path / "flight.1.tlog")
    (tmp_path / "refused.csv").write_text("not ours")
    assert list(SessionLog(tmp_path / "flight.tlog").packets()) == PACKETS[:100]


def recorded(folder, packets, **more):
    with TlogWriter(folder / "telemetry.tlog", **more) as writer:
        for packet in packets:
            writer.write(packet)
    return SessionLog(folder / "telemetry.tlog")


def some_forged():
    kinds = {7: Auth.BAD, 50: Auth.UNSIGNED, 51: Auth.REPLAYED, 290: Auth.FUTURE, 291: Auth.HELD}
    return [replace(packet, auth=kinds.get(k, Auth.OPEN)) for k, packet in enumerate(PACKETS)]


def test_what_was_refused_in_flight_is_refused_again(tmp_path):
    log = recorded(tmp_path, some_forged())
    assert list(log.packets()) == some_forged()
    assert log.warnings == ("refused.csv: 5 records were rejected in flight and are left out",)
    assert len(list(log.accepted_packets(0))) == 295


def test_nobody_is_discovered_by_forged_heartbeats(tmp_path):
    ghost = Packet(T0, MavlinkEncoder(200).heartbeat(), auth=Auth.BAD)
    mission = discover(recorded(tmp_path, [ghost, *PACKETS]))
    assert (mission.uav.system_id, mission.ugv_ids) == (1, (2, 3))


def test_the_fold_leaves_refused_records_out(tmp_path):
    """A forged flight of the vehicle is in the log; the snapshots know nothing of it."""

    def flight(folder, forged):
        folder.mkdir()
        true, liar = MavlinkEncoder(2), MavlinkEncoder(2)
        uav = MavlinkEncoder(1)
        packets = []
        for k in range(100):
            t_us, place = T0 + k * 100_000, (47.0, 8.0 + k * 1e-6, 500.0, 0.0)
            packets.append(Packet(t_us, uav.global_position_int(k * 100, 47.0, 8.0, 540.0, 40.0, (0, 0, 0), 0.0)))
            packets.append(Packet(t_us, true.global_position_int(k * 100, *place, (0, 0, 0), 0.0)))
            packets.append(Packet(t_us, [uav.heartbeat(COPTER), true.heartbeat()][k % 2]))
            if forged:
                lie = liar.global_position_int(k * 100, 47.0005, 8.0, 500.0, 0.0, (0, 0, 0), 0.0)
                packets.append(Packet(t_us, lie, auth=Auth.BAD))
        recorded(folder, packets)
        analysis = Analysis(open_session(folder))
        return [(row.p_enu.tolist(), row.position_state) for s in analysis.snapshots() for row in s.vehicles]

    honest, attacked = flight(tmp_path / "honest", False), flight(tmp_path / "attacked", True)
    assert np.array_equal(np.array([p for p, _ in honest]), np.array([p for p, _ in attacked]), equal_nan=True)
    assert [state for _, state in honest] == [state for _, state in attacked]


def test_lost_records_never_make_a_forged_one_believed(tmp_path):
    recorded(tmp_path, some_forged())
    data = raw(PACKETS)
    size = len(raw(PACKETS[:1]))
    (tmp_path / "telemetry.tlog").write_bytes(data[: 10 * size] + data[13 * size :])
    log = SessionLog(tmp_path / "telemetry.tlog")
    assert [packet for packet in log.packets() if packet.auth] == [packet for packet in some_forged() if packet.auth]


def test_numbers_go_on_over_segments(tmp_path):
    recorded(tmp_path, some_forged())
    write(tmp_path, PACKETS[:60], PACKETS[40:])
    assert list(SessionLog(tmp_path / "telemetry.tlog").packets()) == some_forged()


class Clocks:
    def __init__(self):
        self.mono_us, self.offset_us = 1_000_000, T0 - 1_000_000

    def watch(self):
        return ClockWatch(lambda: (self.mono_us + self.offset_us) * 1000, lambda: self.mono_us * 1000)


@pytest.mark.parametrize("steps_us", [(HOUR_US,), (-HOUR_US,), (HOUR_US, -HOUR_US), (-HOUR_US, 70_000, 1_500_000)])
@pytest.mark.parametrize("hole", [False, True])
def test_a_clock_that_is_set_never_reorders_a_replay(tmp_path, steps_us, hole):
    clocks = Clocks()
    frames = []
    with TlogWriter(tmp_path / "telemetry.tlog", clock=clocks.watch()) as writer:
        for k, packet in enumerate(PACKETS):
            if k and k % 70 == 0 and k // 70 <= len(steps_us):
                clocks.offset_us += steps_us[k // 70 - 1]
            clocks.mono_us += 10_000
            writer.write(replace(packet, t_us=clocks.mono_us + clocks.offset_us))
            if k % 10 == 5:
                frames.append((k, clocks.mono_us + clocks.offset_us))
    first_us = T0 + 10_000
    wanted = np.arange(300) * 10_000 + first_us
    if hole and 70_000 not in steps_us:  # small steps are found by record number alone
        path, size = tmp_path / "telemetry.tlog", len(raw(PACKETS[:1]))
        data = path.read_bytes()
        path.write_bytes(data[: 20 * size] + data[25 * size :])
        wanted = np.delete(wanted, np.s_[20:25])
    log = SessionLog(tmp_path / "telemetry.tlog")
    assert [packet.t_us for packet in log.packets()] == wanted.tolist()
    assert any(f"the clock was set {len(steps_us)} times" in text for text in log.warnings)
    times = log.steps.correct_frames(np.array([t for _, t in frames]), log.start_us)
    if 70_000 not in steps_us:
        assert times.tolist() == [first_us + 10_000 * k for k, _ in frames]


def boots(packets_us):
    """Packets of two vehicles that tell their time since boot, stamped by another clock."""
    speakers = [MavlinkEncoder(1), MavlinkEncoder(2)]
    return [Packet(t_us, speakers[k % 2].attitude(5000 + 10 * k, 0.0, 0.0, 0.0)) for k, t_us in enumerate(packets_us)]


def bare(folder, packets):
    (folder / "flight.tlog").write_bytes(raw(packets))
    return SessionLog(folder / "flight.tlog")


@pytest.mark.parametrize("step_us", [HOUR_US, -HOUR_US, 30_000_000, -30_000_000, 1000 - T0])
def test_the_vehicles_clocks_tell_when_that_of_a_foreign_log_was_set(tmp_path, step_us):
    stamps = [T0 + 10_000 * k + (step_us if k >= 500 else 0) for k in range(1000)]
    log = bare(tmp_path, boots(stamps))
    assert [p.t_us for p in log.packets()] == pytest.approx([T0 + 10_000 * k for k in range(1000)], abs=20_000)
    assert log.warnings == (
        "the vehicles' clocks: the clock was set 1 times; all times are those of the first setting",
    )


@pytest.mark.parametrize("years", [1 / 12, -1 / 12, 3])
def test_flights_in_one_file_follow_one_another(tmp_path, years):
    later = [replace(p, t_us=p.t_us + round(years * 365 * 24 * HOUR_US)) for p in heartbeats(300)]
    log = bare(tmp_path, PACKETS + later)
    assert [p.t_us - T0 for p in log.packets()] == [10_000 * k + (k >= 300) * 990_000 for k in range(600)]
    said = "flight.tlog: time leaps by half an hour back or a day ahead 1 times, which is closed up"
    assert log.warnings == (said,)


def test_a_pause_of_hours_stays_in_the_times(tmp_path):
    later = [replace(p, t_us=p.t_us + 5 * HOUR_US) for p in heartbeats(300)]
    log = bare(tmp_path, PACKETS + later)
    assert [p.t_us for p in log.packets()] == [p.t_us for p in PACKETS + later]
    assert log.warnings == ()


def test_a_computer_whose_clock_was_set_from_1970_in_flight(tmp_path):
    clocks = Clocks()
    clocks.offset_us = 0
    frames = []
    with TlogWriter(tmp_path / "telemetry.tlog", clock=clocks.watch()) as writer:
        for k, packet in enumerate(PACKETS):
            if k == 70:
                clocks.offset_us = T0
            clocks.mono_us += 10_000
            writer.write(replace(packet, t_us=clocks.mono_us + clocks.offset_us))
            frames.append(clocks.mono_us + clocks.offset_us)
    log = SessionLog(tmp_path / "telemetry.tlog")
    wanted = [1_010_000 + 10_000 * k for k in range(300)]
    assert [packet.t_us for packet in log.packets()] == wanted
    assert log.steps.correct_frames(np.array(frames), log.start_us).tolist() == wanted


def test_frames_that_all_came_after_the_step():
    for step_us in (HOUR_US, -HOUR_US):
        new_us = T0 + 60_000_000 + step_us
        steps = ClockSteps(record=np.array([5]), t_us=np.array([new_us]), step_us=np.array([step_us]))
        stamps = new_us + np.arange(1, 5) * 100_000
        assert (steps.correct_frames(stamps, T0) == stamps - step_us).all()


def test_a_clock_nobody_set_changes_nothing():
    stamps = np.arange(5)
    assert (ClockSteps.none().correct_records(stamps) == stamps).all()
    assert (ClockSteps.none().correct_frames(stamps, 0) == stamps).all()


def test_tables_in_segments_count_each_row_once(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,\n2,5\n3,\n")
    (tmp_path / "t.1.csv").write_text("a,b\n2,5\n3,\nx,y\n")
    (tmp_path / "t.2.csv").write_text("a,b\n3,\n4,7\n")
    (tmp_path / "t.old.csv").write_text("no segment")
    table = read_table(tmp_path / "t.csv", TableFormat("t.csv", "a,b", frozenset("b")))
    assert table["a"].tolist() == [1, 2, 3, 4]
    assert table.skipped == 1
    (tmp_path / "t.3.csv").write_text("b\n")
    with pytest.raises(SessionError, match="column 'a' is missing"):
        read_table(tmp_path / "t.csv", TableFormat("t.csv", "a,b", frozenset("b")))


def test_every_segment_is_a_log_of_its_own(tmp_path):
    write(tmp_path, PACKETS[:100], PACKETS[80:])
    assert len(Tlog.open(tmp_path / "telemetry.1.tlog").index) == 220


@pytest.mark.parametrize(
    ("steps", "stamps", "told", "wanted"),
    [
        ([], [1, 2], None, [1, 2]),
        ([(3605, 3600)], [1, 4, 3606, 3609], None, [1, 4, 6, 9]),
        ([(-3595, -3600)], [1, 4, -3594, -3591], None, [1, 4, 6, 9]),
        # a small step back, and nothing said shortly before it: the event that tells of it is the first
        ([(60, -20)], [1, 61, 70], 1, [1, 81, 90]),
        ([(3605, 3600), (10, -3600)], [1, 3606, 11, 12], None, [1, 6, 11, 12]),
    ],
)
def test_events_keep_their_order_when_the_clock_is_set(steps, stamps, told, wanted):
    new_s, step_s = np.array(steps, dtype=np.int64).reshape(-1, 2).T
    known = ClockSteps(record=np.zeros(len(steps), np.int64), t_us=T0 + new_s * 1_000_000, step_us=step_s * 1_000_000)
    stamped_us, tells = T0 + np.array(stamps) * 1_000_000, np.arange(len(stamps)) == (-1 if told is None else told)
    assert ((known.correct_events(stamped_us, tells) - T0) // 1_000_000).tolist() == wanted
