"""The loss that is reported is what the link loses: not what a filter leaves out, nor what an old channel once lost."""

import math
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.reception.reception import Reception

T0, S = 1_790_000_000_000_000, 1_000_000
HEARTBEAT, ATTITUDE, POSITION, HUD = 0, 30, 33, 74
REGULAR = {HEARTBEAT, ATTITUDE, POSITION}


def sent(seconds, *, start=0.0, versions=(2,)):
    """What a vehicle sends: heartbeats at 1 Hz, attitudes at 10, places at 5, and more that carries no time at 20."""
    speakers = [MavlinkEncoder(11, version=version) for version in versions]
    seq, rng = 0, random.Random(2)
    for tick in range(round(start * 20), round((start + seconds) * 20)):
        # radios and busy autopilots shift what they send
        t_us, boot_ms = T0 + tick * 50_000 + rng.randrange(20_000), 60_000 + tick * 50 + rng.randrange(5)
        made = [(HUD, lambda one: one.pack(dialect.MAVLink_vfr_hud_message(4.0, 4.0, 90, 20, 1.0, 0.0)))]
        if tick % 2 == 0:
            made.append((ATTITUDE, lambda one, ms=boot_ms: one.attitude(ms, 0.0, 0.0, 1.0)))
        if tick % 4 == 0:
            place = (47.4, 8.5, 400.0, 0.0, (1.0, 1.0, 0.0), 1.0)
            made.append((POSITION, lambda one, ms=boot_ms, place=place: one.global_position_int(ms, *place)))
        if tick % 20 == 0:
            made.append((HEARTBEAT, MavlinkEncoder.heartbeat))
        for message_id, make in made:
            speaker = speakers[seq % len(speakers)]
            speaker._mav.seq = seq % 256
            seq += 1
            yield t_us, message_id, make(speaker)


def loss(packets, keep, reception=None, **where):
    reception = reception or Reception()
    for t_us, message_id, raw in packets:
        if keep(message_id):
            reception.add_packet(Packet(t_us, raw, **where), message_id)
    return reception.loss


@pytest.mark.parametrize("passed", [REGULAR, {HEARTBEAT}, {ATTITUDE, HUD}, {HEARTBEAT, POSITION}])
def test_a_filter_loses_nothing(passed):
    assert loss(sent(30), lambda message_id: message_id in passed) <= 0.02


@pytest.mark.slow_but_first
@pytest.mark.parametrize("share", [0.1, 0.4, 0.7])
@pytest.mark.parametrize("passed", [REGULAR | {HUD}, REGULAR])
@pytest.mark.parametrize("versions", [(2,), (1, 2)])
def test_what_the_way_swallows_is_the_loss_with_and_without_a_filter(share, passed, versions):
    rng = random.Random(1)
    found = loss(sent(60, versions=versions), lambda message_id: message_id in passed and rng.random() >= share)
    assert found == pytest.approx(share, abs=0.08)


def test_messages_of_an_unknown_dialect_are_not_lost():
    # their numbers are missing, since nobody can tell whether they are whole
    assert loss(sent(30), lambda message_id: message_id != HUD) <= 0.02


def test_a_hole_is_no_loss_before_it_is_known_whether_it_is_one():
    assert math.isnan(loss(sent(0.5), lambda message_id: message_id in REGULAR))
    assert loss(sent(0.5), lambda message_id: True) == 0.0
    assert math.isnan(Reception().loss)


def test_two_links_that_bring_the_same_lose_each_what_they_lose():
    rng, reception = random.Random(1), Reception()
    for t_us, message_id, raw in sent(40):
        reception.add_packet(Packet(t_us, raw, 0, 1), message_id)
        if rng.random() >= 0.4:
            reception.add_packet(Packet(t_us + 30_000, raw, 1, 2), message_id)
    first, second = reception.channels(T0 + 40 * S)
    assert first.loss == 0.0 and second.loss == pytest.approx(0.4, abs=0.06)
    assert reception.loss == pytest.approx(0.2, abs=0.06)


def test_the_loss_of_a_channel_that_is_no_longer_used_does_not_count():
    rng, reception = random.Random(1), Reception()
    assert loss(sent(20), lambda _: rng.random() >= 0.5, reception, peer=1) > 0.4
    assert loss(sent(15, start=20), lambda _: True, reception, peer=2) == 0.0


def test_a_silence_and_a_restart_are_no_loss():
    reception = Reception()
    loss(sent(10), lambda message_id: message_id in REGULAR, reception)
    loss(sent(10, start=60), lambda message_id: message_id in REGULAR, reception)
    rebooted = ((t_us + 100 * S, message_id, raw) for t_us, message_id, raw in sent(10))
    assert loss(rebooted, lambda message_id: message_id in REGULAR, reception) <= 0.02


def test_a_rate_that_changes_and_extra_heartbeats_are_no_loss():
    reception, most, seen = Reception(), 0.0, 0
    for t_us, message_id, raw in sent(60):
        # attitudes once a second at first; the heartbeat is repeated at every change of the mode
        seen += message_id == ATTITUDE
        if message_id == HUD or (message_id == ATTITUDE and seen < 300 and seen % 10):
            continue
        reception.add_packet(Packet(t_us, raw), message_id)
        if message_id == HEARTBEAT and seen % 100 < 10:
            extra = MavlinkEncoder(11)
            extra._mav.seq = raw[4] + 1
            reception.add_packet(Packet(t_us + 300_000, extra.heartbeat(custom_mode=seen)), HEARTBEAT)
        most = max(most, 0.0 if math.isnan(reception.loss) else reception.loss)
    assert most < 0.1
