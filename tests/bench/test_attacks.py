"""The attacks' harness: it counts right, it sees a failure, and a few quick attacks are held."""

from __future__ import annotations

import json
import math
import socket
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink import mavutil

from bench.attacks import doors, streams, takeover
from bench.attacks.__main__ import ATTACKS, main
from bench.attacks.actors import rover
from bench.attacks.handed import commands, files
from bench.attacks.records import frames, read_events, recorded, sender_of
from bench.attacks.report import AttackRow, page
from bench.attacks.run import Flown, Options, false_position_s, fly
from bench.attacks.stage import TRUE, PacketSchedule, SenderFactory, StageCounts
from bench.attacks.wire import ComponentEncoder, redated
from bench.rows import read, write
from tests.support.ports import free_port

DEAF = """#!{python}
import pathlib, signal, sys
folder = pathlib.Path(sys.argv[sys.argv.index("--sessions") + 1]) / "session"
folder.mkdir(parents=True)
for name in ("telemetry.tlog", "events.jsonl"):
    (folder / name).touch()
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
print(f"recording in {{folder}}: stop with Ctrl-C", flush=True)
signal.pause()
"""
"""A station that begins a recording and receives nothing."""
SWARM = Path("sitl_logs/ardupilot-swarm")
START_US = 1_790_000_000_000_000


@pytest.fixture
def station(tmp_path):
    """The real one, of this environment."""
    gcs = (sys.executable, "-c", "from gcs.cli.app import main; main()")
    return Options(gcs=gcs, python=sys.executable, quick=True, folder=tmp_path)


@pytest.fixture
def deaf(tmp_path):
    gcs = tmp_path / "gcs"
    gcs.write_text(DEAF.format(python=sys.executable))
    gcs.chmod(0o755)
    return Options(gcs=(str(gcs),), python=sys.executable, quick=True, folder=tmp_path)


def write_log(session: Path, packets: list[bytes], events: list[dict[str, object]] | None = None) -> None:
    session.mkdir(exist_ok=True)
    records = ((START_US + k).to_bytes(8, "big") + raw for k, raw in enumerate(packets))
    (session / "telemetry.tlog").write_bytes(b"".join(records))
    (session / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events or []))


def event(t_s: float, text: str, level: str = "alarm", system_id: int = 11) -> dict[str, object]:
    time_us = START_US + round(t_s * 1e6)
    return {"time_us": time_us, "level": level, "kind": "vehicle", "system_id": system_id, "text": text}


def flown(
    options: Options, session: Path, sent: StageCounts, places: dict[int, tuple[float, float]], contested: bool = False
) -> Flown:
    """A flight of 30 s after which each of these places was believed throughout."""
    rows = {
        str(i): {"place": list(place), "state": "ok", "contested": contested, "beat": True}
        for i, place in places.items()
    }
    done = Flown(options=options, session=session, sent=sent, exit_code=0, flown_s=30.0)
    done.__dict__["_folded"] = [{"t_s": k / 5.0, "rows": rows} for k in range(150)]
    return done


def test_records_are_those_that_pymavlink_reads():
    ours = list(frames(SWARM))
    log = mavutil.mavlink_connection(str(SWARM / "telemetry.tlog"), dialect="ardupilotmega")
    for t_us, raw in ours[:1000]:
        message = log.recv_msg()
        assert bytes(message.get_msgbuf()) == raw and message.get_srcSystem() == sender_of(raw)
        assert abs(message._timestamp * 1e6 - t_us) <= 1.0
    log.close()
    assert len(ours) == 16_301


def test_packets_are_counted_for_whoever_sent_them_first(tmp_path):
    encoder, sent = ComponentEncoder(11), StageCounts()
    packets = [encoder.parameter(k) for k in range(4)]
    for raw in packets:
        sent.owners[raw][TRUE, 11] += 1
    for raw in packets[:2]:
        sent.owners[raw]["again", 11] += 1
    write_log(tmp_path, [*packets[:3], packets[0], encoder.parameter(99.0)])
    found = recorded(tmp_path, sent)
    assert found == Counter({(TRUE, 11): 3, ("again", 11): 1, ("unknown", 0): 1})


def test_a_log_that_is_none_is_no_result(tmp_path):
    (tmp_path / "telemetry.tlog").write_bytes(bytes(100))
    with pytest.raises(ValueError, match="no record at byte 0"):
        list(frames(tmp_path))


def test_only_the_date_of_a_recorded_frame_moves():
    moved = [(raw, redated(raw, 5_000_000)) for _, raw in frames(SWARM)][:400]
    changed = [(raw, now) for raw, now in moved if raw != now]
    assert changed and all(int.from_bytes(raw[7:10], "little") == 2 for raw, _ in changed)
    for raw, now in changed:
        assert raw[4:10] == now[4:10]
        assert int.from_bytes(now[10:18], "little") - int.from_bytes(raw[10:18], "little") == 5_000_000


def test_a_false_place_counts_from_when_it_could_be_known(tmp_path, deaf):
    true = rover(11)
    east, north = true.east_m + 1000.0, true.north_m
    write_log(tmp_path / "session", [])
    false = flown(deaf, tmp_path / "session", StageCounts(start_us=START_US), {11: (east, north)})
    assert false_position_s(false.estimates(11), true, 1000.0, 6.0, 16.0) == pytest.approx(10.2)
    contested = flown(deaf, tmp_path / "session", StageCounts(start_us=START_US), {11: (east, north)}, contested=True)
    assert false_position_s(contested.estimates(11), true, 1000.0, 6.0, 16.0) == 0.0
    right = flown(deaf, tmp_path / "session", StageCounts(start_us=START_US), {11: (true.east_m, true.north_m)})
    assert false_position_s(right.estimates(11), true, 1000.0, 6.0, 16.0) == 0.0


@pytest.mark.parametrize(
    ("believed", "alarm_s", "lost", "held"),
    [(False, 4.0, 0, True), (True, 4.0, 0, False), (False, math.nan, 0, False), (False, 9.0, 0, False),
     (False, 4.0, 1, False)],
)  # fmt: skip
def test_a_takeover_is_held_only_with_an_alarm_in_time_and_nothing_lost(tmp_path, deaf, believed, alarm_s, lost, held):
    case, encoder, sent = takeover.CASES[0], ComponentEncoder(11), StageCounts(start_us=START_US)
    packets = [encoder.parameter(k) for k in range(10)]
    for raw in packets:
        sent.owners[raw][TRUE, 11] += 1
        sent.count[TRUE, 11] += 1
    events = [] if math.isnan(alarm_s) else [event(alarm_s, "two senders use system id 11")]
    write_log(tmp_path / "session", packets[lost:], events)
    place = (1e3, 0.0) if believed else (rover(11).east_m, rover(11).north_m)
    row = takeover.judge(flown(deaf, tmp_path / "session", sent, {11: place}), case)
    assert row.held == held
    assert row.lost == lost and (row.believed_s > 20.0) == believed


def test_a_deaf_station_holds_nothing(deaf, monkeypatch):
    monkeypatch.setattr(streams, "WAIT_S", 0.2)
    monkeypatch.setattr(streams, "SERIAL_FRAMES", 20)
    row = streams.over_serial(deaf)
    assert (row.sent, row.lost, row.held) == (20, 20, False)


def test_what_cannot_be_judged_is_not_held(deaf, monkeypatch, capsys):
    monkeypatch.setitem(ATTACKS, "components", lambda options: [][0])
    assert main(["components", "--gcs", deaf.gcs[0]]) == 1
    assert "IndexError" in capsys.readouterr().out


def test_a_file_of_a_stranger_is_refused_in_a_line_by_the_real_command(station):
    row = files.open_file(station, 0, "a pipe", files.CASES["a key is a pipe"])
    assert row.held and "11.key: cannot be read: not a regular file" in row.note


@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("raise ValueError", "traceback"),
        ("import signal; signal.pause()", "not over in time"),
        ("import os; os.abort()", "signal 6"),
        ("import time; much = b'x' * (1 << 27); time.sleep(1.0)", "MB;"),
    ],
)
def test_a_command_that_breaks_on_a_file_is_not_held(station, monkeypatch, does, said):
    monkeypatch.setattr(files, "MOST_S", 5.0)
    monkeypatch.setattr(files, "MOST_MB", 100.0)
    broken = replace(station, gcs=(sys.executable, "-c", does))
    row = files.open_file(broken, 0, "a pipe", files.CASES["a key is a pipe"])
    assert not row.held and said in row.note


@pytest.mark.slow
@pytest.mark.parametrize("leaves", [False, True])
def test_a_killed_export_is_held_only_if_it_left_something_behind(tmp_path, monkeypatch, leaves):
    monkeypatch.setattr(commands, "YOUNG_S", 0.0)
    begin = f"touch {tmp_path}/.aside-1; exec sleep 60" if leaves else "exit 0"
    script = f'case "$*" in *.mp4) {begin};; *) rm -f .aside-*; touch a.geojson;; esac'
    options = Options(gcs=("sh", "-c", script, "gcs"), python=sys.executable)
    held, note = commands.CASES["exports that SIGTERM and SIGKILL end"](options, tmp_path)
    assert held == leaves, note


@pytest.mark.slow
def test_what_a_door_lets_through_is_seen(station, monkeypatch):
    held, note = doors._ended_often(station)
    assert held and note.endswith(", sealed")
    monkeypatch.setattr(doors, "_sealed", lambda _: False)
    assert not doors._ended_often(replace(station, folder=station.folder / "again"))[0]


def test_names_that_are_none_are_refused(capsys):
    assert main(["nonsense"]) == 2 and "nonsense" in capsys.readouterr().err
    assert main(["--list"]) == 0 and "late-links" in capsys.readouterr().out


def test_results_are_kept_and_compared(tmp_path):
    rows = [
        AttackRow(attack="a", case="b|c", sent=10, lost=2, held=False, note="x"),
        AttackRow(attack="a", case="d", false_sent=5, alarm_s=1.25, held=True),
    ]
    write(tmp_path / "rows.csv", AttackRow, rows)
    before = read(tmp_path / "rows.csv", AttackRow)
    assert [row.summary for row in before] == [row.summary for row in rows]
    text = page(rows, "T", "w", before)
    assert r"| b\|c | 10 | 2 | 0 | – | – | – | **not held** | x | not held; 2 lost; x |" in text
    assert "1 of 2 cases held." in text and "alarm 1.2 s" in text


@pytest.mark.slow
def test_a_real_flight_is_heard_told_and_ended(station):
    """The whole path in one flight: what is sent is recorded to the packet, told, and not hidden by three bytes."""
    port = free_port(socket.SOCK_STREAM)
    rows: list[AttackRow] = []

    def beats(encoder: ComponentEncoder, new_sender: SenderFactory) -> PacketSchedule:
        party = (TRUE, encoder.system_id)
        return PacketSchedule(party=party, make=lambda t_s: [encoder.heartbeat()], send=new_sender(), rate_hz=20.0)

    done = fly(
        station,
        "heard",
        [13],
        lambda new_sender: [beats(ComponentEncoder(i), new_sender) for i in (1, 13)],
        2.5,
        more=["-l", f"tcpin:127.0.0.1:{port}"],
        during=lambda flight, stage: rows.extend(streams.poison(port, flight.session)),
    )
    assert done.exit_code == 0
    assert [(row.case, row.lost) for row in rows] == [(row.case, 0) for row in rows] and len(rows) == 2
    assert done.recorded == done.sent.count | {("unknown", 0): 2 * streams.GOOD}
    assert done.sent.count[TRUE, 1] >= 15
    assert {row.system_id for row in read_events(done.session, done.sent)} >= {1, 13}
