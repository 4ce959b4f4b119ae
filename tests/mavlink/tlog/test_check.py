import json
import struct

import numpy as np
import pytest
from typer.testing import CliRunner

from gcs.cli.tlog import app
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.check import check
from mavlink.tlog.log import Tlog

T0 = 1_790_000_000_000_000
SECOND = 1_000_000


def flight(seconds=30, *, system_id=1, speed=1.0, boots=(), start_us=T0, hz=20, version=2, key=None):
    """Packets of one sender whose clock runs ``speed`` times as fast as the stamps and begins anew at ``boots``."""
    speaker, packets, booted = MavlinkEncoder(system_id, version=version, key=key), [], -5.0
    for i in range(seconds * hz):
        t = i / hz
        if t in boots:
            booted = t - 1.0
        boot_ms = round((t - booted) * speed * 1000)
        frame = speaker.attitude(boot_ms, 0.1, 0.2, 0.3) if i % 5 else speaker.heartbeat()
        packets.append(Packet(start_us + round(t * SECOND), frame))
    return packets


def record(packet, order=">"):
    return struct.pack(f"{order}Q", packet.t_us) + packet.raw


def written(tmp_path, data, name="made.tlog"):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else b"".join(map(record, data)))
    return path


def checked(tmp_path, data):
    return check(Tlog.open(written(tmp_path, data), any_file=True))


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_whole_flight_is_whole(tmp_path):
    packets = flight(key=b"k" * 32) + flight(system_id=2, version=1)
    found = checked(tmp_path, sorted(packets, key=lambda p: p.t_us))
    assert found.whole and not found.several_writers
    assert (found.records, found.whole_records, found.damaged_bytes) == (1200, 1200, 0)
    assert (found.version_1, found.version_2, found.signed) == (600, 600, 600)
    assert [(c.system_id, c.boots, c.steps) for c in found.clocks] == [(1, 1, ()), (2, 1, ())]
    assert found.speed == pytest.approx(1.0, abs=0.02)


def test_compressed_time_is_told(tmp_path):
    assert checked(tmp_path, flight(speed=26.0)).speed == pytest.approx(26.0, rel=0.02)
    result = run("check", written(tmp_path, flight(speed=26.0), "fast.tlog"))
    assert "time is compressed: the senders' clocks run 26." in result.output
    assert result.exit_code == 0  # every byte of it is as it was written


def test_restarts_are_counted_and_wraps_are_none(tmp_path):
    (clock,) = checked(tmp_path, flight(boots=(10.0, 20.0))).clocks
    assert clock.boots == 3
    speaker = MavlinkEncoder(1)
    wrap = [Packet(T0 + i * 50_000, speaker.attitude((2**32 - 5000 + i * 50) % 2**32, 0, 0, 0)) for i in range(300)]
    (clock,) = check(Tlog.open(written(tmp_path, wrap, "wrap.tlog"))).clocks
    assert clock.boots == 1


@pytest.mark.parametrize("by_s", [3600, -3600, 5, -5])
def test_a_set_clock_is_told_once_with_its_place(tmp_path, by_s):
    packets = [Packet(p.t_us + (by_s * SECOND if i >= 300 else 0), p.raw) for i, p in enumerate(flight())]
    found = checked(tmp_path, packets)
    ((step,),) = (clock.steps for clock in found.clocks)
    assert step.by_s == pytest.approx(by_s, abs=0.1)
    assert step.row in (300, 301)  # the first attitude with the new time
    assert found.far_backward_steps == (by_s < 0)


def test_late_traffic_is_no_set_clock(tmp_path):
    packets = flight()
    late = [Packet(packets[310].t_us, p.raw) if 200 <= i < 310 else p for i, p in enumerate(packets)]
    assert [clock.steps for clock in checked(tmp_path, late).clocks] == [()]


def test_two_programs_in_one_file_are_told(tmp_path):
    one, other = (b"".join(map(record, flight(system_id=i))) for i in (1, 2))
    blocks = [part[k : k + 1000] for k in range(0, len(one), 1000) for part in (one, other)]
    found = checked(tmp_path, b"".join(blocks))
    assert found.several_writers and found.torn_by_others > 5
    assert found.times_crossed > 5
    assert "several programs wrote this file at once" in run("check", written(tmp_path, b"".join(blocks), "b")).output


def test_a_hole_is_not_taken_for_another_program(tmp_path):
    data = b"".join(map(record, flight()))
    found = checked(tmp_path, data[:3000] + data[5011:9000] + bytes(700) + data[9700:])
    assert not found.several_writers
    assert not found.whole


def test_frames_cut_by_the_program_that_wrote_them(tmp_path):
    packets = flight(version=1)
    data = b"".join(struct.pack("<Q", p.t_us) + p.raw[: p.raw[1]] for p in packets)
    found = checked(tmp_path, data)
    assert (found.records, found.time_source) == (0, "little-endian")
    assert found.cut_short == pytest.approx(len(packets), abs=2)
    result = run("check", written(tmp_path, data, "short.tlog"))
    assert result.exit_code == 5
    assert "each without its last eight bytes" in result.output


def test_what_is_no_log_is_not_whole(tmp_path):
    result = run("check", written(tmp_path, b"hello, I am no log" * 50))
    assert result.exit_code == 5
    assert "no MAVLink frame: is it a log?" in result.output


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"\x1f\x8b\x08\x00", "a packed file (gzip): unpack it first"),
        (b"PK\x03\x04", "a packed file (zip)"),
        (b"\xfd7zXZ\x00", "a packed file (xz)"),
        (b"\xd4\xc3\xb2\xa1", "a capture of a network (pcap)"),
        (b"\xa3\x95\x80", "the log that an ArduPilot keeps on board"),
        (b"ULog\x01\x12\x35", "the log that a PX4 keeps on board"),
    ],
)
def test_other_kinds_of_files_are_named(tmp_path, head, said):
    path = written(tmp_path, head + bytes(500))
    assert f"it begins like {said}" in run("check", path).output
    assert f"it begins like {said}" in str(run("info", path).exception)


def test_a_log_that_was_sent_as_text_is_told(tmp_path):
    data = b"".join(map(record, flight(60)))
    assert data.count(b"\n") > 32
    result = run("check", written(tmp_path, data.replace(b"\n", b"\r\n")))
    assert "each line feed follows a carriage return" in result.output
    assert "several programs" not in result.output
    assert "carriage return" not in run("check", written(tmp_path, data, "good.tlog")).output


def test_stamps_in_milliseconds_are_told(tmp_path):
    packets = [Packet(p.t_us // 1000, p.raw) for p in flight()]
    assert checked(tmp_path, packets).speed == pytest.approx(1000, rel=0.02)


def test_text_with_a_time_for_each_byte(tmp_path):
    text = b"".join(struct.pack(">Q", T0 + i) + bytes([byte]) for i, byte in enumerate(b"Init ArduCopter V4.6\r\n"))
    (damage,) = checked(tmp_path, text + b"".join(map(record, flight(2)))).damage
    assert (damage.start, damage.stop, damage.reason) == (0, len(text), "text, each byte with a time stamp")


def test_check_as_json_says_the_same(tmp_path):
    data = b"".join(map(record, flight()))
    path = written(tmp_path, data[:3000] + bytes(100) + data[3100:])
    result = run("check", path, "--json")
    assert result.exit_code == 5
    table = json.loads(result.output)
    found = check(Tlog.open(path))
    assert table["whole"] is False
    assert table["records"] == found.records
    assert [(d["start"], d["stop"]) for d in table["damage"]] == [(d.start, d.stop) for d in found.damage]
    assert table["clocks"][0]["speed"] == pytest.approx(1.0, abs=0.02)


def test_several_logs_are_checked_at_once(tmp_path):
    good = [written(tmp_path, flight(2, start_us=T0 + i), f"{i}.tlog") for i in range(2)]
    bad = written(tmp_path, b"".join(map(record, flight(2))) + bytes(9), "bad.tlog")
    assert run("check", *good).exit_code == 0
    result = run("check", *good, bad, "--json")
    assert result.exit_code == 5
    assert [json.loads(line)["whole"] for line in result.output.splitlines()] == [True, True, False]


def test_json_of_a_log_without_times_has_no_nan(tmp_path):
    path = written(tmp_path, b"".join(p.raw for p in flight()))
    result = run("check", path, "--json")
    assert result.exit_code == 0
    assert json.loads(result.output)["speed"] is None
    assert "NaN" not in result.output


def test_repair_writes_what_is_whole_and_leaves_the_original(tmp_path):
    packets = flight()
    data = b"".join(map(record, packets))
    path = written(tmp_path, data[:3000] + b"noise" + data[3000:7000] + bytes(300) + data[7300:-4])
    before, out = path.read_bytes(), tmp_path / "out.tlog"
    result = run("repair", path, out)
    assert result.exit_code == 0
    assert path.read_bytes() == before
    old, new = Tlog.open(path), Tlog.open(out)
    assert list(new.packets()) == list(old.packets())
    assert check(new).whole
    assert f"{len(old.index)} messages written" in result.output
    assert "places that hold no whole message" in result.output
    assert {p.raw for p in new.packets()} < {p.raw for p in packets}


def test_repair_never_overwrites(tmp_path):
    path, out = written(tmp_path, flight(2)), written(tmp_path, b"mine", "out.tlog")
    assert "never overwritten" in str(run("repair", path, out).exception)
    assert out.read_bytes() == b"mine"
    assert "never overwritten" in str(run("repair", path, path).exception)
    assert Tlog.open(path).index.damage == ()


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"".join(p.raw for p in flight(2)), "only their order is real"),
        (b"".join(record(p, "<") for p in flight(2)), "are now big-endian"),
        (
            b"".join(struct.pack(">Q", 7 if i == 9 else p.t_us) + p.raw for i, p in enumerate(flight(2))),
            "no usable time",
        ),
        (b"".join(b"\xff" * 8 + p.raw for p in flight(2)), "no time could be right"),
    ],
)
def test_repair_says_what_became_of_times(tmp_path, data, said):
    path, out = written(tmp_path, data), tmp_path / "out.tlog"
    result = run("repair", path, out)
    assert said in result.output
    assert np.array_equal(Tlog.open(out).index.t_us, Tlog.open(path).index.t_us)


def test_messages_in_bursts_do_not_make_time_run_slower(tmp_path):
    encoder = MavlinkEncoder(1)
    packets = [
        Packet(T0 + second * SECOND + each * 300, encoder.attitude(5000 + 1000 * second, 0.0, 0.0, 0.0))
        for second in range(20)
        for each in range(27)
    ]
    log = Tlog.open(written(tmp_path, packets))
    assert check(log).speed == pytest.approx(1.0, abs=0.01)
