import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from mavlink.errors import SigningError
from mavlink.protocol import decode
from mavlink.protocol.dialect import DEFINITIONS, RADIO_STATUS
from mavlink.protocol.framing import FrameCounts, checksum, split
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.keys import Key, KeyRing
from mavlink.signing.signer import Signer
from mavlink.signing.streams import AHEAD, BEHIND, MAX_STREAMS, SECOND, Streams
from mavlink.signing.verifier import STATE_MESSAGES, Verifier, without_secret
from tests.support.signed_vehicles import NOW, T0, Sender, Still, ring_of, secret_of, verifier

S = 1_000_000


def judged(checker, packets):
    """How often each verdict was given."""
    counts = dict.fromkeys(Auth, 0)
    for packet in packets:
        counts[checker.check(packet)] += 1
    return {verdict: count for verdict, count in counts.items() if count}


# What is right


def test_what_pymavlink_signs_is_good():
    sender = Sender()
    assert judged(verifier(7), [sender.packet() for _ in range(2000)]) == {Auth.GOOD: 2000}


def test_pymavlink_believes_what_we_sign():
    signer = Signer(Key(secret_of(7)))
    parser = ardupilotmega.MAVLink(None)
    parser.signing.secret_key = secret_of(7)
    parser.signing.timestamp = NOW
    plain = Sender(signs=False)
    messages = [
        ardupilotmega.MAVLink_heartbeat_message(10, 3, 129, 4, 4, 3),
        ardupilotmega.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
        ardupilotmega.MAVLink_statustext_message(6, b"zeros are cut off"),
    ]
    for k in range(300):
        frame = signer.sign(plain.frame(messages[k % 3]), T0, link_id=3)
        assert split(frame) == ([frame], FrameCounts(good=1))
        (message,) = parser.parse_buffer(frame)
        assert message.get_type() == messages[k % 3].get_type()
        assert message.get_signed()
        assert message.get_link_id() == 3
    assert parser.signing.badsig_count == 0
    assert signer.newest == NOW + 299


def test_a_signer_follows_the_clock_and_never_repeats():
    signer = Signer(Key(secret_of(7)), newest=NOW + 5)
    frame = Sender(signs=False).frame()
    clock_s = (0, 0, 1, 1, 50, 0)
    stamps = [int.from_bytes(signer.sign(frame, T0 + t * S)[-12:-6], "little") - NOW for t in clock_s]
    assert stamps == [6, 7, SECOND, SECOND + 1, 50 * SECOND, 50 * SECOND + 1]


def test_a_signer_signs_nothing_of_others():
    signer = Signer(Key(secret_of(7)))
    with pytest.raises(SigningError, match="signed already"):
        signer.sign(Sender(8).frame(), T0)
    with pytest.raises(SigningError, match="MAVLink 1"):
        signer.sign(Sender(version=1).frame(), T0)
    unknown = Sender(signs=False).frame()
    with pytest.raises(SigningError, match="unknown"):
        signer.sign(unknown[:7] + b"\xff\xff\xff" + unknown[10:], T0)


# Verify before anything changes


def test_one_forged_frame_from_the_far_future_changes_nothing():
    checker, sender = verifier(7), Sender()
    assert checker.check(sender.packet()) is Auth.GOOD
    forged = Sender(secret=b"x" * 32, timestamp=2**48 - 1).packet()
    assert checker.check(forged) is Auth.BAD
    sender.mav.signing.timestamp = NOW + 1
    assert judged(checker, [sender.packet() for _ in range(2000)]) == {Auth.GOOD: 2000}
    assert len(checker.streams) == 1
    assert checker.streams.proven == NOW + 2000 - AHEAD


def test_nothing_that_is_refused_is_remembered():
    checker = verifier(7, 8)
    for sender in (
        Sender(secret=secret_of(8)),
        Sender(signs=False),
        Sender(version=1),
        Sender(timestamp=NOW + 610 * SECOND),
        Sender(timestamp=NOW - 70 * SECOND),
        Sender(99),
    ):
        assert checker.check(sender.packet()) > Auth.GOOD
    assert len(checker.streams) == 0
    assert checker.streams.proven == 0


# Replay


def test_replayed_frames_are_never_believed():
    checker, sender = verifier(7), Sender()
    heard = [sender.packet() for _ in range(2000)]
    assert judged(checker, heard) == {Auth.GOOD: 2000}
    assert judged(checker, heard) == {Auth.REPLAYED: 2000}
    random.Random(1).shuffle(heard)
    assert judged(checker, [replace(p, link=9, peer=4, t_us=T0 + 30 * S) for p in heard]) == {Auth.REPLAYED: 2000}


def test_a_stream_is_a_system_a_component_and_a_link_id():
    checker = verifier(7)
    for component_id, link_id in ((1, 0), (1, 1), (154, 0), (154, 1)):
        sender = Sender(7, component_id, link_id=link_id)
        heard = [sender.packet() for _ in range(50)]
        assert judged(checker, heard) == {Auth.GOOD: 50}
        assert judged(checker, heard) == {Auth.REPLAYED: 50}


def test_old_captures_of_streams_never_heard():
    for behind_s, verdict in ((0, Auth.GOOD), (59, Auth.GOOD), (61, Auth.HELD), (30 * 86400, Auth.HELD)):
        sender = Sender(timestamp=NOW - behind_s * SECOND)
        assert verifier(7).check(sender.packet()) is verdict
    assert verifier(7).check(Sender(timestamp=NOW - BEHIND).packet()) is Auth.GOOD
    assert verifier(7).check(Sender(timestamp=NOW - BEHIND - 1).packet()) is Auth.HELD


def test_a_known_stream_may_be_slow():
    # no clock, one more with each frame: behind by hours, and still the next of its stream
    checker, sender = verifier(7), Sender()
    assert judged(checker, [sender.packet(t_us=T0 + k * 60 * S) for k in range(100)]) == {Auth.GOOD: 100}


def test_overtaken_frames_are_refused_by_the_rule():
    sender = Sender()
    heard = [sender.packet() for _ in range(80)]
    swapped = [heard[k ^ 1] for k in range(80)]
    assert judged(verifier(7), swapped) == {Auth.GOOD: 40, Auth.REPLAYED: 40}


# The future


def test_how_far_ahead_a_clock_may_be():
    assert AHEAD == 605 * SECOND  # ten starts of an ArduPilot in a row
    for ahead, verdict in ((59.95, Auth.GOOD), (60.95, Auth.GOOD), (605.0, Auth.GOOD), (605.01, Auth.FUTURE)):
        assert verifier(7).check(Sender(timestamp=NOW + round(ahead * SECOND)).packet()) is verdict
    assert verifier(7).check(Sender(timestamp=NOW + 10 * 365 * 86400 * SECOND).packet()) is Auth.FUTURE


def test_a_minute_ahead_keeps_nobody_else_out():
    # an ArduPilot is heard first, then vehicles that are on time, and late by up to a minute
    checker = verifier(7, 8, 9)
    assert checker.check(Sender(7, timestamp=NOW + 5_995_000).packet()) is Auth.GOOD
    assert checker.check(Sender(8, timestamp=NOW - 30_000).packet()) is Auth.GOOD
    assert checker.check(Sender(9, timestamp=NOW - 59 * SECOND).packet()) is Auth.GOOD


def test_steps_into_the_future_do_not_carry_the_clock_along():
    checker = verifier(7)
    verdicts = [checker.check(Sender(timestamp=NOW + k * 400 * SECOND).packet()) for k in range(5)]
    assert verdicts == [Auth.GOOD, Auth.GOOD, Auth.FUTURE, Auth.FUTURE, Auth.FUTURE]


def test_a_computer_clock_that_is_set_back_silences_nobody():
    steady = Still()
    checker, sender = Verifier(ring_of(7), steady_ns=steady), Sender()
    assert checker.check(sender.packet()) is Auth.GOOD
    for k in range(1, 200):
        steady.ns = k * 1_000_000_000
        packet = sender.packet(timestamp=NOW + k * SECOND, t_us=T0 + (k - 3600) * S)
        assert checker.check(packet) is Auth.GOOD


def test_a_computer_without_a_clock_starts_from_what_was_proven():
    streams = Streams()
    streams.proven = NOW
    old = Sender(timestamp=NOW - 61 * SECOND)
    assert Verifier(ring_of(7), streams=streams, steady_ns=Still()).check(old.packet(t_us=S)) is Auth.HELD
    assert Verifier(ring_of(7), streams=streams, steady_ns=Still()).check(Sender().packet(t_us=S)) is Auth.GOOD


# Keyed by default


@pytest.mark.parametrize("version", [1, 2])
def test_unsigned_frames_are_refused(version):
    sender = Sender(version=version, signs=False)
    assert verifier(7).check(sender.packet()) is Auth.UNSIGNED
    assert verifier(default=secret_of(0)).check(sender.packet()) is Auth.UNSIGNED


def test_a_signature_that_was_taken_off_is_missed():
    signed = Sender().frame()
    bare = signed[:2] + b"\0" + signed[3:-13]
    for raw in (bare, signed[:2] + b"\0" + signed[3:]):
        assert verifier(7).check(Packet(T0, raw)) is Auth.UNSIGNED
    mended = bare[:-2] + checksum(bare, DEFINITIONS[30][1]).to_bytes(2, "little")
    assert split(mended)[1] == FrameCounts(good=1)
    assert verifier(7).check(Packet(T0, mended)) is Auth.UNSIGNED


def test_every_vehicle_has_its_own_key():
    ids = range(1, 101)
    checker = verifier(*ids)
    for j in ids:
        for i in ids:
            verdict = checker.check(Sender(i, secret=secret_of(j)).packet())
            assert verdict is (Auth.GOOD if i == j else Auth.BAD), (i, j)


def test_a_fleet_key_is_for_those_without_their_own():
    fleet = secret_of("fleet")
    checker = verifier(7, default=fleet)
    assert checker.check(Sender(7, secret=fleet).packet()) is Auth.BAD
    assert checker.check(Sender(7).packet()) is Auth.GOOD
    assert checker.check(Sender(8, secret=fleet).packet()) is Auth.GOOD
    assert checker.check(Sender(8, secret=secret_of(7)).packet()) is Auth.BAD
    assert checker.check(Sender(8, signs=False).packet()) is Auth.UNSIGNED


def test_systems_without_a_key():
    signed, unsigned, old = Sender(8), Sender(8, signs=False), Sender(8, version=1)
    packets = [sender.packet() for sender in (signed, unsigned, old)]
    assert judged(verifier(7), packets) == {Auth.UNSIGNED: 3}
    assert judged(verifier(7, keyless="open"), packets) == {Auth.OPEN: 3}
    assert judged(verifier(), packets) == {Auth.OPEN: 3}
    # what has a key must sign, whatever the others may
    assert verifier(7, keyless="open").check(Sender(7, signs=False).packet()) is Auth.UNSIGNED


def test_modems_may_come_unsigned_and_only_when_listed():
    radio = ardupilotmega.MAVLink_radio_status_message(180, 170, 100, 40, 40, 0, 0)
    for system_id in (51, 7):
        for version in (1, 2):
            packet = Sender(system_id, 68, version=version, signs=False).packet(radio)
            assert packet.message_id == RADIO_STATUS
            assert verifier(7).check(packet) is Auth.OPEN
            assert verifier(7, unsigned=()).check(packet) is Auth.UNSIGNED
    # a wrong signature is worse than none
    assert verifier(7).check(Sender(7, 68, secret=b"x" * 32).packet(radio)) is Auth.BAD
    assert verifier(7).check(Sender(51, 68).packet(radio)) is Auth.UNSIGNED


def test_nothing_that_makes_up_a_vehicle_can_be_listed():
    assert frozenset(decode._MAKERS) - {109, 166} == STATE_MESSAGES
    for message_id in STATE_MESSAGES:
        with pytest.raises(SigningError, match="cannot come unsigned"):
            Verifier(ring_of(7), unsigned=(RADIO_STATUS, message_id))


def test_unknown_messages_are_judged_like_known_ones():
    header = bytes([0xFD, 3, 1, 0, 9, 7, 1]) + (60_001).to_bytes(3, "little")
    covered = header + b"abc" + b"\x12\x34" + b"\0" + NOW.to_bytes(6, "little")
    good = covered + Key(secret_of(7)).signature(covered)
    assert verifier(7).check(Packet(T0, good)) is Auth.GOOD
    assert verifier(7).check(Packet(T0, good[:-1] + bytes([good[-1] ^ 1]))) is Auth.BAD
    assert verifier(7).check(Packet(T0, good[:2] + b"\0" + good[3:-13])) is Auth.UNSIGNED


# Many streams


def test_four_thousand_streams_and_more():
    checker = verifier(*range(1, 101))
    senders = [Sender(1 + k % 100, 1 + k // 100 % 64, link_id=k // 6400) for k in range(8192)]
    first = [sender.packet() for sender in senders]
    assert judged(checker, first) == {Auth.GOOD: 8192}
    assert len(checker.streams) == 8192
    assert judged(checker, first) == {Auth.REPLAYED: 8192}
    assert judged(checker, [sender.packet() for sender in senders]) == {Auth.GOOD: 8192}


def test_who_fills_the_table_pays_for_it():
    streams = Streams()
    streams.admit(1, 1, 0, 100, 0)
    for k in range(MAX_STREAMS + 5000):
        streams.admit(9, k >> 8 & 0xFF, k & 0xFF, 200 + k, 0)
    streams.admit(2, 1, 0, 300, 0)
    assert len(streams) == MAX_STREAMS
    assert len(list(streams.rows())) == MAX_STREAMS
    assert (streams.newest(1, 1, 0), streams.newest(2, 1, 0)) == (100, 300)


# Anything at all


GOOD_FRAMES = [Sender(link_id=k).frame() for k in range(4)]


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(GOOD_FRAMES), st.data())
def test_a_changed_frame_is_never_good(frame, data):
    kind = data.draw(st.sampled_from(["flip", "cut", "longer", "replace"]))
    place = data.draw(st.integers(0, len(frame) - 1))
    changed = bytearray(frame)
    if kind == "flip":
        changed[place] ^= data.draw(st.integers(1, 255))
    elif kind == "cut":
        changed = changed[: max(place, 1)]
    elif kind == "longer":
        changed[place:place] = data.draw(st.binary(min_size=1, max_size=20))
    else:
        changed[place : place + 6] = data.draw(st.binary(min_size=6, max_size=6))
    if bytes(changed) != frame:
        checker = verifier(7, default=secret_of("fleet"), unsigned=())
        assert checker.check(Packet(T0, bytes(changed))) > Auth.GOOD
        assert len(checker.streams) == 0


@settings(max_examples=300, deadline=None)
@given(st.binary(min_size=1, max_size=60), st.sampled_from([b"", b"\xfd", b"\xfe", b"\xfd\x05\x01"]))
def test_rubbish_is_judged_without_an_error(rubbish, start):
    checker = verifier(default=secret_of("fleet"), unsigned=())
    assert checker.check(Packet(T0, start + rubbish)) > Auth.GOOD


# SETUP_SIGNING


@pytest.mark.parametrize("secret", [secret_of(5), b"k" * 20 + bytes(12), bytes(32)])
@pytest.mark.parametrize("signs", [True, False])
def test_a_key_sent_to_a_vehicle_is_not_recorded(secret, signs):
    sender = Sender(255, 190, signs=signs)
    packet = sender.packet(ardupilotmega.MAVLink_setup_signing_message(7, 1, list(secret), 12345))
    packet = replace(packet, link=2, peer=3, auth=Auth.GOOD)
    clean = without_secret(packet)
    assert (clean.t_us, clean.link, clean.peer, clean.auth) == (packet.t_us, 2, 3, Auth.GOOD)
    assert secret.rstrip(b"\0")[:4] not in clean.raw or not any(secret)
    assert not clean.signed
    assert split(clean.raw) == ([clean.raw], FrameCounts(good=1))
    (message,) = ardupilotmega.MAVLink(None).parse_buffer(clean.raw)
    assert (message.get_type(), message.target_system, message.target_component) == ("SETUP_SIGNING", 7, 1)
    assert message.initial_timestamp == 12345
    assert message.secret_key == [255] * 32
    assert (message.get_srcSystem(), message.get_seq()) == (255, packet.seq)


def test_other_messages_are_recorded_as_they_are():
    assert without_secret(Sender().packet()) is None
    assert without_secret(Sender(version=1).packet()) is None


def test_an_empty_ring_leaves_everything_open():
    checker = Verifier(KeyRing())
    assert not checker.ring
    assert judged(checker, [Sender().packet(), Sender(version=1).packet(), Sender(8, signs=False).packet()]) == {
        Auth.OPEN: 3
    }
