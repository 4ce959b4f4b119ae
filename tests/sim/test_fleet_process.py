"""The fake fleet: what it sends is real MAVLink, counted exactly, and each trouble is the trouble it is said to be."""

import json
import math
import socket
import subprocess
import sys
from collections import Counter
from itertools import takewhile

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.framing import split
from mavlink.protocol.packet import Packet
from sim.faults.fault_traffic import UNKNOWN_SENDER, FaultTraffic, traffic
from sim.fleet_process import _parser, fleet_of, main, read_keys, system_ids

START_US = 1_795_170_792_000_000
KEY = bytes(range(32))


def sent(seconds, *words, key=None):
    arguments = _parser().parse_args(["--to", "127.0.0.1:1", *words])
    plan = FaultTraffic(
        fleet=fleet_of(arguments),
        rate_hz=arguments.rate,
        keys=dict.fromkeys(system_ids(245), key) if key else {},
        flood_hz=arguments.flood,
        garbage_hz=arguments.garbage,
        replayed=frozenset(arguments.replay),
        banner=arguments.banner,
    )
    return list(takewhile(lambda datagram: datagram.t_s < seconds, traffic(plan, START_US)))


def folded(datagrams, ids=range(11, 18)):
    fleet, notes = Fleet(1, ids), []
    for datagram in datagrams:
        frames, _ = split(datagram.raw)
        for raw in frames:
            notes += fleet.add_packet(Packet(START_US + int(datagram.t_s * 1e6), raw))
    return fleet, {notice.text for notice in notes}


def test_a_quiet_fleet_is_believed_wholly():
    datagrams = sent(4.0, "--vehicles", "8", "--rate", "160")
    assert len(datagrams) == 640
    assert [d.t_s for d in datagrams] == sorted(d.t_s for d in datagrams)
    assert Counter(d.label for d in datagrams) == dict.fromkeys(map(str, system_ids(8)), 80)
    fleet, notes = folded(datagrams)
    state = fleet.at(START_US + 3_900_000)
    assert {vehicle.position_state for vehicle in state.vehicles} == {"ok"}
    assert all(vehicle.loss == 0 for vehicle in state.vehicles)
    assert not any("not used" in text for text in notes)


def test_frames_are_what_the_reference_makes_of_the_same_values():
    mav = ardupilotmega.MAVLink(None)
    mav.robust_parsing = False
    for datagram in sent(2.0, "--vehicles", "3", "--rate", "60", "--v1", "12", "--flood", "30"):
        (message,) = mav.parse_buffer(datagram.raw)
        again = ardupilotmega.MAVLink(None, srcSystem=message.get_srcSystem(), srcComponent=1)
        again.seq = message.get_seq()
        if datagram.raw[0] == 0xFD:
            assert message.pack(again) == datagram.raw
        else:
            # packing, the reference puts extensions into MAVLink 1 frames, which have none
            assert datagram.label == "12" and message.get_type() != "BAD_DATA"


def test_signatures_are_right_wrong_or_missing_as_asked():
    datagrams = sent(1.0, "--vehicles", "4", "--rate", "80", "--unsigned", "12", "--badly-signed", "13", key=KEY)
    mav = ardupilotmega.MAVLink(None)
    mav.robust_parsing = True
    mav.signing.secret_key = KEY
    # what is to be believed, by the reference
    mav.signing.timestamp = (START_US - 1_420_070_400_000_000) // 10
    good = Counter()
    for datagram in datagrams:
        for message in mav.parse_buffer(datagram.raw) or []:
            good[datagram.label] += message.get_type() != "BAD_DATA"
    assert good == {"1": 20, "11": 20, "12": 0, "13": 0}
    assert [len(d.raw) for d in datagrams if d.label == "12"] != [len(d.raw) for d in datagrams if d.label == "11"]


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (("--lie", "12:jump"), "position not used: farther than it can have driven"),
        (("--lie", "12:zero"), "position not used: no fix (0/0)"),
        (("--lie", "12:prefix"), "position not used: no fix (0/0)"),
        (("--duplicate", "12"), "two senders use system id 12"),
        (("--reboot", "12@6"), "system 12 has rebooted"),
    ],
)
def test_troubles_are_noticed(words, reported):
    datagrams = sent(14.0, "--vehicles", "4", "--rate", "80", *words)
    assert any(text.startswith(reported) for text in folded(datagrams, (11, 12, 13))[1])


def test_a_rebooted_vehicle_is_silent_then_begins_at_zero_from_another_port():
    datagrams = sent(10.0, "--vehicles", "2", "--rate", "40", "--reboot", "11@6", "--move-port", "1@3")
    assert [(d.t_s, d.outlet) for d in datagrams if not d.raw] == [(3.0, 0), (6.0, 1)]
    own = [d for d in datagrams if d.label == "11"]
    assert not [d for d in own if 6.0 <= d.t_s < 7.3]
    first = next(d for d in own if d.t_s >= 7.3 and d.raw[7] in (30, 33))
    assert 1300 <= int.from_bytes(first.raw[10:14], "little") < 1500
    assert [d.raw for d in datagrams if d.label == "boot words"][1] == b"Init Gyro"


def test_replayed_frames_are_the_same_bytes_ten_seconds_later():
    datagrams = sent(13.0, "--vehicles", "2", "--rate", "40", "--replay", "11")
    own = [d for d in datagrams if d.label == "11"]
    late = [d for d in datagrams if d.label == "replayed 11"]
    assert [d.raw for d in late] == [d.raw for d in own[: len(late)]]
    assert all(math.isclose(b.t_s - a.t_s, 10.0) for a, b in zip(own, late, strict=False))
    assert {d.outlet for d in late}.isdisjoint(d.outlet for d in own)


def test_garbage_comes_from_a_stranger_and_holds_no_good_frame():
    garbage = [d for d in sent(3.0, "--garbage", "100") if d.label == "garbage"]
    assert len(garbage) == 300 and {d.outlet for d in garbage} == {UNKNOWN_SENDER}
    assert sum(split(d.raw)[1].good for d in garbage) == 0


def test_the_process_says_exactly_what_it_sent():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inlet:
        inlet.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        inlet.bind(("127.0.0.1", 0))
        inlet.settimeout(0.5)
        words = ("--to", f"127.0.0.1:{inlet.getsockname()[1]}", "--vehicles", "5", "--rate", "200", "--duration", "2")
        done = subprocess.run([sys.executable, "-m", "sim.fleet_process", *words], capture_output=True, timeout=120)
        heard, ports = Counter(), {}
        try:
            while True:
                raw, sender = inlet.recvfrom(4096)
                heard[str(raw[5])] += 1
                ports[str(raw[5])] = sender[1]
        except TimeoutError:
            pass
    reported = json.loads(done.stdout)
    assert reported["packets"] == heard and reported["total"] == 400 and reported["refused"] == 0
    assert reported["ports"] == ports and len(set(ports.values())) == 5


def test_keys_are_those_that_gcs_keys_makes(tmp_path):
    (tmp_path / "11.key").write_text(KEY.hex() + "\n")
    (tmp_path / "fleet.key").write_bytes(KEY[::-1])
    assert read_keys(tmp_path, [1, 11]) == {1: KEY[::-1], 11: KEY}
    assert read_keys(tmp_path / "11.key", [1, 2]) == {1: KEY, 2: KEY}


def test_what_cannot_be_done_is_said(capsys, tmp_path):
    assert main(["--to", "127.0.0.1:1", "--duplicate", "99"]) == 2
    assert "99 is not in this fleet" in capsys.readouterr().err
    assert main(["--to", "127.0.0.1:1", "--sign", str(tmp_path / "none")]) == 2
    assert "is no key" in capsys.readouterr().err
