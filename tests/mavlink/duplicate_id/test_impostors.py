"""Two senders of one system id, and what only looks like it."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.fleet.fleet import Fleet
from mavlink.protocol.encoder import COPTER, GCS, NO_AUTOPILOT, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.flights import FIELD, T0, UAV, UGV, Air, S, Sender

BEGIN = T0 + 5 * S

IMPOSTORS = {
    "another address, another place": Sender(peer=2, shift=(-80.0, 0.0), starts_us=BEGIN, phase_us=100_000),
    "another address, ten metres beside": Sender(peer=2, shift=(10.0, 0.0), starts_us=BEGIN, phase_us=100_000),
    "another link, fifteen metres ahead": Sender(link=1, peer=2, shift=(0.0, 15.0), starts_us=BEGIN, phase_us=50_000),
    "another kind": Sender(peer=2, kind=COPTER, starts_us=BEGIN, phase_us=400_000, places=False),
    "another autopilot": Sender(peer=2, autopilot=12, starts_us=BEGIN, phase_us=400_000, places=False),
    "heartbeats alone, of the same kind in another mode": Sender(
        peer=2, mode=4, starts_us=BEGIN, phase_us=400_000, places=False
    ),
    "switched on four seconds later, at the same place": Sender(
        peer=2, booted_us=T0 - 56 * S, starts_us=BEGIN, phase_us=50_000, clocked=True
    ),
    "another boot time": Sender(peer=2, booted_us=T0 - 3000 * S, starts_us=BEGIN, phase_us=50_000),
    "four seconds behind, elsewhere": Sender(
        peer=2, booted_us=T0 - 56 * S, shift=(50.0, 0.0), starts_us=BEGIN, phase_us=50_000
    ),
    "same address, another count of packets, beside": Sender(
        seq=130, shift=(12.0, 0.0), starts_us=BEGIN, phase_us=100_000
    ),
    "a log without addresses, elsewhere": Sender(seq=77, shift=(300.0, 0.0), starts_us=BEGIN, phase_us=100_000),
    "same place, turned away": Sender(peer=2, yaw=2.0, starts_us=BEGIN, phase_us=0),
    "once a second, elsewhere": Sender(peer=2, shift=(-80.0, 0.0), starts_us=BEGIN, phase_us=500_000, rate_hz=1),
    "once a second, another boot time": Sender(
        peer=2, booted_us=T0 - 999 * S, starts_us=BEGIN, phase_us=500_000, rate_hz=1
    ),
    "with a tenth of all lost": Sender(peer=2, shift=(20.0, 5.0), starts_us=BEGIN, phase_us=100_000, loss=0.1),
}


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("name", "rate_hz"),
    # attitudes once a second are too far apart to be compared
    [(name, hz) for name in IMPOSTORS for hz in (5.0, 1.0) if hz > 1 or name != "same place, turned away"],
)
def test_an_impostor_is_found_within_two_seconds_and_both_are_quarantined(name, rate_hz):
    impostor = Sender(**{k: v for k, v in vars(IMPOSTORS[name]).items() if k not in ("speaker", "rng")})
    air = Air(Sender(rate_hz=rate_hz, clocked=impostor.clocked), impostor).run(4.9)
    assert not air.alarms and air.fleet.at(air.now_us).valid.all()
    air.run(4.1)
    first_us = BEGIN + impostor.phase_us
    assert air.contested_us, "never found"
    assert air.contested_us - first_us <= 2 * S
    state = air.fleet.at(air.now_us)
    assert state.valid.tolist() == [False, True]
    assert air.status().position_state == "contested" and state.contested == {UGV}
    assert air.reports == []
    assert len(air.alarms) == 1 and air.alarms[0].startswith("two senders use system id 11: ")
    assert "udp address 1" in air.alarms[0] or "both on udp" in air.alarms[0]
    if impostor.peer == 2:
        assert ("radio address 2" if impostor.link else "udp address 2") in air.alarms[0]


def test_a_second_address_that_agrees_is_reported_and_not_rejected():
    air = Air(Sender(), Sender(peer=2, seq=140, phase_us=100_000, starts_us=BEGIN)).run(9)
    texts = [n.text for n in air.notices if n.level == "warning"]
    assert texts == ["system 11 sends from two addresses (udp address 1 and udp address 2)"] or texts == [
        "system 11 sends from two addresses (udp address 2 and udp address 1)"
    ]
    assert not air.contested_us


def test_released_when_it_has_been_alone_for_some_seconds():
    air = Air(Sender(), Sender(peer=2, shift=(-80.0, 0.0), phase_us=100_000, starts_us=BEGIN, ends_us=BEGIN + 5 * S))
    air.run(10)
    assert air.status().contested
    air.run(4)
    assert air.status().contested
    air.run(2)
    assert not air.status().contested and air.status().position_state == "ok"
    assert [n.text for n in air.notices if "one sender again" in n.text] == [
        "system id 11 has one sender again: udp address 1"
    ]
    assert air.fleet.at(air.now_us).p_enu[0, :2] == pytest.approx(air.senders[2].place(air.now_us)[:2], abs=0.5)
    air.run(2)
    assert len(air.alarms) == 1


def test_an_impostor_of_the_aircraft_takes_its_camera_away():
    air = Air(Sender(UAV, peer=2, kind=COPTER, up=40.0, speed=0.0, yaw=2.0, starts_us=BEGIN, beats=False))
    air.run(8)
    uav = air.fleet.at(air.now_us).uav
    assert not uav.position_valid and not uav.attitude_valid
    assert len(air.alarms) == 1


def version(speaker, uid=0, uid2=b""):
    zeros = [0] * 8
    message = ardupilotmega.MAVLink_autopilot_version_message(
        0, 0, 0, 0, 0, zeros, zeros, zeros, 0, 0, uid, list(uid2.ljust(18, b"\0"))
    )
    return speaker.pack(message)


def test_another_hardware_id_is_found_at_once():
    air = Air(Sender()).run(5)
    real, other = air.senders[2].speaker, MavlinkEncoder(UGV)
    air.fleet.add_packet(Packet(air.now_us, version(real, uid=0xAB), 0, 1))
    assert air.fleet.add_packet(Packet(air.now_us, version(real, uid=0xAB, uid2=b"\x12\x34"), 0, 1)) == ()
    (alarm,) = air.fleet.add_packet(Packet(air.now_us, version(other, uid=0xCD, uid2=b"\x56\x78"), 0, 2))
    assert alarm.level == "alarm" and "hardware id 1234 and 5678: udp address 1 and udp address 2" in alarm.text
    assert air.run(30).status().contested
    assert not air.run(35).status().contested


def test_another_board_after_a_reboot_is_reported_and_accepted():
    air = Air(Sender(ends_us=BEGIN), Sender(peer=2, booted_us=BEGIN, starts_us=BEGIN + 2 * S)).run(5)
    air.fleet.add_packet(Packet(air.now_us, version(MavlinkEncoder(UGV), uid=1), 0, 1))
    air.run(4)
    said = air.fleet.add_packet(Packet(air.now_us, version(MavlinkEncoder(UGV), uid=2), 0, 2))
    assert [n.level for n in said] == ["warning"] and "another autopilot since it has rebooted" in said[0].text
    assert not air.status().contested and air.status().hardware == "2"


HARMLESS = {
    "a reboot with a new source port": [
        Sender(ends_us=BEGIN), Sender(peer=2, booted_us=BEGIN + S, starts_us=BEGIN + int(1.3 * S)),
    ],
    "a reboot with a second link half a second behind": [
        Sender(ends_us=BEGIN), Sender(peer=2, booted_us=BEGIN, starts_us=BEGIN + 500_000),
        Sender(link=1, ends_us=BEGIN, delay_us=500_000, seq=99),
    ],
    "two radios with counts of their own": [Sender(), Sender(link=1, peer=1, seq=140, phase_us=50_000)],
    "two radios into one port": [Sender(), Sender(peer=2, seq=140, phase_us=100_000)],
    "two radios, one 300 ms behind": [Sender(), Sender(link=1, peer=2, seq=9, phase_us=100_000, delay_us=300_000)],
    "the same bytes over two links": [Sender(), Sender(link=1, delay_us=50_000)],
    "the same bytes ten seconds late": [Sender(), Sender(link=1, delay_us=10 * S)],
    "first-hand news ten seconds late": [Sender(loss=0.3), Sender(link=1, delay_us=10 * S, loss=0.1)],
    "ten seconds late across a reboot": [
        Sender(ends_us=BEGIN, loss=0.2), Sender(link=1, ends_us=BEGIN, delay_us=10 * S),
        Sender(peer=2, booted_us=BEGIN, starts_us=BEGIN + S),
    ],
    "another mode, and a radio ten seconds behind": [
        Sender(changed_us=BEGIN), Sender(link=1, seq=99, delay_us=10 * S, changed_us=BEGIN, phase_us=500_000),
    ],
    "another mode, and a radio two seconds behind": [
        Sender(changed_us=BEGIN), Sender(peer=2, seq=99, delay_us=2 * S, changed_us=BEGIN, phase_us=500_000),
    ],
    "its own time over two radios, one ten seconds behind": [
        Sender(clocked=True), Sender(link=1, delay_us=10 * S, seq=99, clocked=True),
    ],
    "its own time across a reboot with a radio ten seconds behind": [
        Sender(ends_us=BEGIN, clocked=True), Sender(link=1, ends_us=BEGIN, delay_us=10 * S, seq=9, clocked=True),
        Sender(peer=2, booted_us=BEGIN, starts_us=BEGIN + S, clocked=True),
    ],
    "a new address after roaming": [Sender(ends_us=BEGIN), Sender(peer=2, seq=100, starts_us=BEGIN)],
    "two addresses for a second while roaming": [
        Sender(ends_us=BEGIN + S), Sender(peer=2, seq=100, starts_us=BEGIN, phase_us=100_000),
    ],
    "a lossy link": [Sender(loss=0.7)],
    "a second radio three seconds behind, half of all lost": [
        Sender(loss=0.5, rate_hz=4), Sender(link=1, loss=0.5, rate_hz=4, delay_us=3 * S, seq=211),
    ],
    "a second radio ten seconds behind a slow and lossy first": [
        Sender(loss=0.4, rate_hz=2), Sender(link=1, loss=0.1, rate_hz=2, delay_us=10 * S, seq=99, starts_us=T0 + 2 * S),
    ],
    "the wrap of the boot clock": [Sender(booted_us=T0 + 7 * S - (1 << 32) * 1000)],
    "the wrap of the boot clock on two links": [
        Sender(booted_us=T0 + 7 * S - (1 << 32) * 1000),
        Sender(booted_us=T0 + 7 * S - (1 << 32) * 1000, link=1, seq=50, phase_us=100_000),
    ],
    "a station relayed by everybody": [
        Sender(), *(Sender(255, peer=p, kind=GCS, autopilot=NO_AUTOPILOT, places=False) for p in (1, 2, 3, 4)),
    ],
    "a signed vehicle and an unsigned impostor": [
        Sender(auth=Auth.GOOD), Sender(peer=2, shift=(-80.0, 0.0), kind=COPTER, auth=Auth.UNSIGNED, seq=9),
    ],
    "a signed vehicle and one with another key": [
        Sender(auth=Auth.GOOD), Sender(peer=2, shift=(-80.0, 0.0), auth=Auth.BAD, seq=9),
    ],
}  # fmt: skip


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", HARMLESS)
def test_nothing_else_is_taken_for_an_impostor(name):
    senders = [Sender(**{k: v for k, v in vars(s).items() if k not in ("speaker", "rng")}) for s in HARMLESS[name]]
    air = Air(*senders).run(22)
    assert not air.contested_us
    assert not any("two senders" in n.text for n in air.notices)
    state = air.fleet.at(air.now_us)
    assert state.p_enu[0, :2] == pytest.approx(senders[0].place(air.now_us)[:2], abs=2.0)
    assert state.valid[0] or max(sender.loss for sender in senders) >= 0.4


def test_the_mode_is_that_of_the_quickest_radio():
    air = Air(Sender(changed_us=BEGIN), Sender(link=1, seq=99, delay_us=10 * S, changed_us=BEGIN)).run(30)
    texts = [notice.text for notice in air.notices if notice.system_id == UGV]
    assert [text for text in texts if text.startswith("mode")] == ["mode HOLD"]


def test_a_silent_radio_leaves_the_mode_to_the_one_that_is_behind():
    first = Sender(ends_us=T0 + 20 * S)
    air = Air(first, Sender(link=1, seq=99, delay_us=10 * S, changed_us=T0 + 25 * S)).run(40)
    assert air.status().mode == "HOLD" and air.status().heartbeat_age_s < 1.5


def test_heartbeats_over_a_new_address_are_no_duplicates_of_those_whose_numbers_have_come_round():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV)
    for k in range(
        20 * 32
    ):  # 256 packets in eight seconds: a heartbeat has the number of the one before the last seven
        t_us, peer = T0 + k * S // 32, 1 + (k > 320)
        raw = speaker.attitude(50_000 + k * 1000 // 32, 0.0, 0.0, 0.0) if k % 32 else speaker.heartbeat(ROVER)
        fleet.add_packet(Packet(t_us, raw, 0, peer))
        assert fleet.at(t_us).vehicles[1].heartbeat_age_s < 2.5
    assert fleet.at(t_us).vehicles[1].copies <= 1


def test_a_companion_that_sends_the_time_is_not_the_autopilot():
    air = Air(Sender(clocked=True)).run(1)
    companion = MavlinkEncoder(UGV, 191)
    for k in range(20):
        air.run(0.5)
        air.notices += air.fleet.add_packet(Packet(air.now_us, companion.system_time(4000 + k, 1000 * S), 0, 1))
    assert abs(air.status().clock_error_s) < 1 and not air.alarms
    assert not any("date" in notice.text for notice in air.notices)


def test_addresses_are_reported_where_they_are_known():
    known = {(0, 1): "10.0.0.4:14550", (1, 2): "10.0.0.9:5000"}
    fleet = Fleet(
        UAV, [UGV], origin=FIELD, links=("udp", "radio"), address=lambda link, peer: known.get((link, peer), "")
    )
    air = Air(Sender(), Sender(link=1, peer=2, kind=COPTER, starts_us=BEGIN, phase_us=400_000))
    air.fleet = fleet
    air.run(9)
    assert air.alarms[0].endswith(": 10.0.0.4:14550 on udp and 10.0.0.9:5000 on radio")


@pytest.mark.slow
def test_clock_readings_of_two_senders_are_no_drift():
    senders = [
        Sender(),
        Sender(peer=2, booted_us=T0 - 61 * S, shift=(-80.0, 0.0), starts_us=BEGIN, ends_us=BEGIN + 5 * S),
    ]
    air = Air(*senders)
    for _ in range(50):
        air.run(2)
        for sender in senders:
            if sender.starts_us <= air.now_us < sender.ends_us:
                answer = sender.speaker.timesync(
                    (air.now_us - sender.booted_us) * 1000, (air.now_us - 6000 // sender.peer) * 1000
                )
                air.notices += air.fleet.add_packet(Packet(air.now_us, answer, 0, sender.peer))
    assert abs(air.status().drift_ppm) < 100
    assert not air.status().clock_fault


def test_loss_rate_and_age_are_reported_for_each_link():
    air = Air(Sender(), Sender(link=1, peer=3, seq=140, phase_us=50_000, loss=0.5, rate_hz=1)).run(35)
    status = air.status()
    first, second = status.channels
    assert (first.link, first.peer, second.link, second.peer) == (0, 1, 1, 3)
    assert first.loss == 0.0 and second.loss == pytest.approx(0.5, abs=0.2)
    assert first.rate_hz == pytest.approx(11.0, rel=0.15) and second.rate_hz == pytest.approx(1.5, rel=0.5)
    assert status.link in (0, 1) and first.age_s < 0.3
    air.senders[2].ends_us = air.now_us
    air.run(10)
    assert air.status().link == 1
    assert air.status().channels[0].rate_hz < 1.2


def test_a_flood_of_forged_heartbeats_makes_few_notices():
    air = Air(Sender()).run(5)
    forger, rng, said = MavlinkEncoder(UGV), np.random.default_rng(3), []
    for k in range(5000):
        raw = forger.heartbeat(int(rng.integers(0, 16)), autopilot=int(rng.integers(0, 8)), custom_mode=k)
        said += air.fleet.add_packet(Packet(air.now_us + k * 400, raw, 0, 2))
    assert len(said) < 40
    assert next(n.text for n in said if n.level == "alarm").startswith("two senders use system id 11")


def test_thousands_of_addresses_stay_bounded():
    fleet, speaker = Fleet(UAV, [UGV], origin=FIELD), MavlinkEncoder(UGV)
    for peer in range(5000):
        fleet.add_packet(Packet(T0 + peer * 1000, speaker.heartbeat(), 0, peer))
    assert len(fleet.at(T0 + 5 * S).vehicles[1].channels) <= 16
    assert math.isfinite(fleet.at(T0 + 5 * S).vehicles[1].loss)
