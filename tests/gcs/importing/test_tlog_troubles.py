"""Telemetry logs with the troubles that stations and companions make."""

import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import ImportFileError
from gcs.importing.fleet_log import open_fleet
from gcs.importing.ground_vehicles import read_ground_vehicles
from gcs.importing.sources import read_vehicle_logs
from mavlink.protocol.encoder import ROVER, MavlinkEncoder

T0 = 1_790_000_000_000_000
STEPS = 200
"""Of a fifth of a second."""


def path_of(k):
    return 47.1 + 4e-6 * k, 8.1, 430.0


def written(path: Path, *, set_back_s=0.0, companion=False, speed=1.0, stopped_s=0.0, systems=(11, 12, 13)):
    """A log of rovers, the recorder's clock set back in the middle, the clock of the first stopped for a while."""
    autopilots = {i: MavlinkEncoder(i) for i in systems}
    companions = {i: MavlinkEncoder(i, 191) for i in systems}
    with path.open("wb") as file:
        for k in range(STEPS):
            for system_id, speaker in autopilots.items():
                stamp = T0 + round(k * 200_000 / speed) + system_id
                stamp -= round(set_back_s * 1e6) if k >= STEPS // 3 else 0
                place = path_of(k)
                boot_ms = 60_000 + 200 * k
                if system_id == systems[0] and k >= STEPS // 3:
                    boot_ms -= round(stopped_s * 1000)
                frames = [speaker.global_position_int(boot_ms, *place, 0.0, (2.0, 0.0, 0.0), 0.0)]
                if k % 5 == 0:
                    frames.append(speaker.heartbeat(kind=ROVER))
                if companion:
                    elsewhere = (place[0] + 0.01, place[1], 100.0)
                    frames.append(
                        companions[system_id].global_position_int(5000 + 200 * k, *elsewhere, 0.0, (0.0, 0.0, 0.0), 0.0)
                    )
                file.writelines(struct.pack(">Q", stamp) + frame for frame in frames)
    return path


def assert_path(places, start_us):
    assert places.t_us == pytest.approx(start_us + np.arange(STEPS) * 200_000, abs=5000)
    assert places.lat_deg == pytest.approx(path_of(np.arange(STEPS))[0], abs=2e-7)
    assert places.alt_m == pytest.approx(430.0)


@pytest.mark.parametrize("set_back_s", [3600.0, -3600.0, 7.0])
def test_a_recorder_whose_clock_was_set_is_put_on_one_clock(set_back_s, tmp_path):
    fleet = open_fleet(written(tmp_path / "fleet.tlog", set_back_s=set_back_s))
    (said,) = fleet.assumptions()
    assert said.startswith(f"fleet.tlog: the recorder's clock was set by {-set_back_s:+.2f} s at byte ")
    start_us = T0 - round(set_back_s * 1e6)  # as it was for two thirds of the log
    assert_path(fleet.places(11), start_us + 11)
    assert_path(fleet.places(12), start_us + 12)
    stamps = [t_us for t_us, _ in fleet.records(())]
    assert min(stamps) == start_us + 11
    assert np.abs(np.diff(stamps)).max() <= 200_000
    assert [t_us for t_us, _ in fleet.records_of(11)] == [t_us for t_us in stamps if (t_us - start_us) % 100_000 == 11]
    (log, _, _) = read_vehicle_logs(tmp_path / "fleet.tlog")
    assert [f"fleet.tlog: {words}" for words in log.notes.assumed] == [said]


def test_a_whole_log_is_taken_as_it_is(tmp_path):
    fleet = open_fleet(written(tmp_path / "fleet.tlog"))
    assert fleet.assumptions() == ()
    assert (fleet.t_us == fleet.tlog.index.t_us).all()


def test_a_vehicle_whose_own_clock_stood_still_does_not_move_the_others(tmp_path):
    fleet = open_fleet(written(tmp_path / "fleet.tlog", stopped_s=9.9))
    assert fleet.assumptions() == ()
    assert_path(fleet.places(11), T0 + 11)
    assert_path(fleet.places(12), T0 + 12)


def test_what_a_companion_reports_is_not_where_the_vehicle_is(tmp_path):
    fleet = open_fleet(written(tmp_path / "fleet.tlog", companion=True))
    assert_path(fleet.places(11), T0 + 11)


def test_stamps_that_run_faster_than_the_vehicles_are_refused(tmp_path):
    path = written(tmp_path / "fleet.tlog", speed=10.0)
    with pytest.raises(ImportFileError, match=r"fleet\.tlog: the vehicles' clocks run 10 times as fast as the stamps"):
        open_fleet(path)


def test_a_vehicle_with_a_receiver_alone(tmp_path):
    speaker = MavlinkEncoder(11)
    with (tmp_path / "rover.tlog").open("wb") as file:
        for k in range(STEPS):
            fix = speaker.gps_raw_int(T0 + k * 200_000, *path_of(k), hdop=0.8)
            file.writelines(struct.pack(">Q", T0 + k * 200_000) + frame for frame in (fix, speaker.heartbeat(ROVER)))
    (log,) = read_vehicle_logs(tmp_path / "rover.tlog")
    assert_path(log.places, T0)
    assert log.places.std_m == pytest.approx(1.2)
    assert log.notes.found[0] == f"telemetry log, {STEPS} fixes of the receiver alone"


def test_fixes_of_a_receiver_are_judged_like_positions(tmp_path):
    speaker = MavlinkEncoder(11)

    def log_of(rows):
        with (tmp_path / "rover.tlog").open("wb") as file:
            for k in rows:
                frames = [speaker.gps_raw_int(T0 + k * 200_000, *path_of(k)), speaker.heartbeat(kind=ROVER)]
                if k < 20:
                    none = dialect.MAVLink_gps_raw_int_message(k, 1, 0, 0, 0, 65535, 65535, 65535, 65535, 0)
                    frames[0] = speaker.pack(none)
                file.writelines(struct.pack(">Q", T0 + k * 200_000) + frame for frame in frames)
        return read_vehicle_logs(tmp_path / "rover.tlog")

    (log,) = log_of([*range(60), *range(90, STEPS), *range(STEPS - 1, STEPS)])
    assert len(log.places) == STEPS - 50
    assert log.notes.found[0] == f"telemetry log, {STEPS - 50} fixes of the receiver alone"
    assert log.notes.skipped == {"times without a fix": 20, "positions with the time of another": 1}
    assert log.notes.assumed[0].startswith("nothing was logged for 6.2 s after byte ")
    with pytest.raises(ImportFileError, match="its times begin again: byte "):
        log_of([*range(120), *range(60, STEPS)])


@pytest.mark.parametrize(
    ("component", "kind", "words"),
    [
        (2, ROVER, "components 1 and 2 are both its autopilot: two vehicles with one id? component 1 counts"),
        (1, 2, "its heartbeats are of a rover and of a copter: two vehicles with one id? it counts as a rover"),
        (191, 18, None),
    ],
)
def test_two_vehicles_with_one_system_id_are_told(component, kind, words, tmp_path):
    path, other = written(tmp_path / "fleet.tlog", systems=(11,)), MavlinkEncoder(11, component)
    end = struct.pack(">Q", T0 + STEPS * 200_000) + other.heartbeat(kind=kind)
    path.write_bytes(path.read_bytes() + end)
    assert open_fleet(path).assumptions() == ((f"fleet.tlog, system 11: {words}",) if words else ())
    assert read_vehicle_logs(path)[0].notes.assumed == ((words,) if words else ())
    assert open_fleet(path).assumptions(without=(11,)) == ()


def test_who_reports_positions_and_not_what_it_is_is_told(tmp_path):
    path, speaker = written(tmp_path / "fleet.tlog", systems=(11,)), MavlinkEncoder(14)
    report = speaker.global_position_int(60_000, *path_of(0), 0.0, (2.0, 0.0, 0.0), 0.0)
    path.write_bytes(path.read_bytes() + struct.pack(">Q", T0 + STEPS * 200_000) + report)
    said = "system 14, which reports positions, and in no heartbeat that it drives or flies"
    assert open_fleet(path).unnamed == (said,)
    (tmp_path / "alone.tlog").write_bytes(struct.pack(">Q", T0) + report)
    with pytest.raises(ImportFileError) as error:
        read_ground_vehicles(tmp_path / "alone.tlog", ())
    assert str(error.value).endswith(f"no ground vehicle reports a position in it ({said})")


@pytest.mark.parametrize("by_s", [0.3, -0.3])
def test_a_step_that_one_vehicle_alone_shows_may_be_its_own(by_s, tmp_path):
    fleet = open_fleet(written(tmp_path / "fleet.tlog", set_back_s=by_s, systems=(11,)))
    (said,) = fleet.assumptions()
    assert said.startswith(
        f"fleet.tlog: the recorder's clock, or that of system 11, was set by {-by_s:+.2f} s at byte "
    )
    assert_path(fleet.places(11), T0 + 11 - round(by_s * 1e6))


def test_a_gap_of_a_vehicle_that_is_given_twice_is_told_once(tmp_path):
    path = written(tmp_path / "fleet.tlog", systems=(11,))
    kept = [(t_us, raw) for t_us, raw in open_fleet(path).records(()) if not 5e6 < t_us - T0 < 25e6]
    path.write_bytes(b"".join(struct.pack(">Q", t_us) + raw for t_us, raw in kept))
    (said,) = read_ground_vehicles(path, [f"11={path}"]).assumed
    assert said == "fleet.tlog: nothing was logged for 20.2 s after byte 1137"


def unstamped(path, *, dated=True, late_us=0):
    """What a station wrote as it received it, without its clock, of rovers that were started at different times."""
    with path.open("wb") as file:
        for k in range(STEPS):
            for system_id in (11, 12):
                speaker, boot_ms = MavlinkEncoder(system_id), 60_000 * system_id + 200 * k
                file.write(speaker.global_position_int(boot_ms, *path_of(k), 0.0, (2.0, 0.0, 0.0), 0.0))
                if k % 5 == 0:
                    unix_us = T0 + 200_000 * k + (late_us if k > STEPS // 2 else 0)
                    clock = dialect.MAVLink_system_time_message(unix_us if dated else 0, boot_ms)
                    file.write(speaker.heartbeat(kind=ROVER) + speaker.pack(clock))
    return path


@pytest.mark.parametrize("suffix", ["rlog", "raw", "tlog"])
def test_a_log_without_stamps_has_the_vehicles_times(suffix, tmp_path):
    for log in read_vehicle_logs(unstamped(tmp_path / f"fleet.{suffix}")):
        assert_path(log.places, T0)
        assert log.notes.assumed[0] == ("no time stamps in it: times are by the vehicles' own clocks (SYSTEM_TIME)")


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        ({"dated": False}, "no vehicle tells the date"),
        ({"late_us": 3_600_000_000}, r"the dates of its vehicles \(SYSTEM_TIME\) step"),
    ],
)
def test_a_log_without_stamps_whose_vehicles_know_no_date_is_refused(trouble, words, tmp_path):
    with pytest.raises(ImportFileError, match=words):
        open_fleet(unstamped(tmp_path / "fleet.rlog", **trouble))


def test_damaged_bytes_of_a_log_are_counted(tmp_path):
    path = written(tmp_path / "fleet.tlog")
    assert "damaged bytes" not in open_fleet(path).skipped(())
    data = bytearray(path.read_bytes())
    data[3000:3600] = bytes(600)
    path.write_bytes(data)
    assert open_fleet(path).skipped(())["damaged bytes"] >= 600
