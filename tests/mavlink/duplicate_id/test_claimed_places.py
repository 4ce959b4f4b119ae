"""Places that cannot both be true are two senders within two seconds, whatever clock or component they come with."""

import math
from dataclasses import replace

import pytest

from tests.support.flights import SPEED, Claimant, Listener

PROMISED_S = 2.0
LATE_S = 12.0
"""A link may be so much later than another; what could be one is told apart once the paths have met."""
OFFSETS_S = (-120.0, -58.0, -13.0, -10.0, -5.0, -1.0, -0.3, 0.0, 1.0, 5.0, 10.0, 13.0, 58.0, 120.0)
DISTANCES_M = (2.0, 5.0, 20.0, 100.0, 245.0, 1000.0, 10_000.0)
NOISE_M = 3.0


def in_order(order, true, other):
    """The true one, the other, and when the second of them begins."""
    if order == "the other comes later":
        return true, replace(other, begins_s=11.13), 11.13
    if order == "the other was first":
        return replace(true, begins_s=3.13), other, 3.13
    return true, replace(other, begins_s=0.13), 0.13


def could_be_a_late_link(offset_s, distance_m):
    """Whether a vehicle may have driven from one place to the other in the time that is between their clocks.

    s = v t + ¼ a t² with 4 m/s²; a second of the time has gone by before the last places that can tell in two seconds.
    """
    apart_s = max(0.0, abs(offset_s) - 1.0)
    return 1.0 <= abs(offset_s) <= LATE_S and distance_m <= 2.0 * NOISE_M + SPEED * apart_s + apart_s * apart_s


ORDERS = ("the other comes later", "both at once", "the other was first")


@pytest.mark.slow_but_first
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 10.0])
def test_two_places_are_two_senders_within_two_seconds_whatever_their_clocks_say(order, rate_hz):
    slow, open_cells = {}, 0
    for offset_s in OFFSETS_S:
        for distance_m in DISTANCES_M:
            shift = (0.6 * distance_m, 0.8 * distance_m)
            true, other, begins_s = in_order(
                order,
                Claimant(rate_hz=rate_hz, says="pb"),
                Claimant(rate_hz=rate_hz, says="pb", peer=2, seq=100, ahead_s=offset_s, shift=shift),
            )
            undecided = distance_m <= NOISE_M or could_be_a_late_link(offset_s, distance_m)
            open_cells += undecided
            if undecided:
                continue
            listener = Listener().receive(true, other, until_s=begins_s + PROMISED_S + 0.01)
            if listener.contested_s > begins_s + PROMISED_S:
                slow[offset_s, distance_m] = listener.contested_s - begins_s
    assert slow == {}
    assert open_cells <= 26  # of 98: two metres, and what could be a link that is up to ten seconds late


@pytest.mark.slow_but_first
@pytest.mark.parametrize("order", ORDERS)
def test_what_could_be_a_late_link_is_told_once_the_paths_meet(order):
    """A link ten seconds late may bring a place fifty metres away; ten seconds later both paths have to be one."""
    for offset_s in (-10.0, -5.0, 5.0, 10.0):
        for distance_m in (10.0, 50.0):
            true, other, begins_s = in_order(
                order, Claimant(), Claimant(peer=2, ahead_s=offset_s, shift=(0.0, -distance_m))
            )
            listener = Listener().receive(true, other, until_s=begins_s + abs(offset_s) + PROMISED_S)
            assert listener.contested_s <= begins_s + abs(offset_s) + PROMISED_S, (offset_s, distance_m)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
def test_two_metres_within_the_noise_of_receivers_are_no_contest(rate_hz):
    other = Claimant(rate_hz=rate_hz, peer=2, seq=100, shift=(1.2, 1.6), begins_s=3.03)
    assert Listener().receive(Claimant(rate_hz=rate_hz), other, until_s=20.0).contested_s == math.inf
    noisy = (
        Claimant(rate_hz=rate_hz, noise_m=2.0),
        Claimant(rate_hz=rate_hz, link=1, seq=100, begins_s=0.03, noise_m=2.0),
    )
    assert Listener().receive(*noisy, until_s=30.0).contested_s == math.inf


@pytest.mark.slow_but_first
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("clock", ["zero", "half", "fast", "random"])
def test_a_clock_that_no_vehicle_has_hides_nobody(order, clock):
    for rate_hz in (1.0, 5.0, 10.0):
        for distance_m in (50.0, 245.0, 10_000.0):
            true, other, begins_s = in_order(
                order,
                Claimant(rate_hz=rate_hz),
                Claimant(rate_hz=rate_hz, peer=2, clock=clock, shift=(distance_m, 0.0)),
            )
            listener = Listener().receive(true, other, until_s=begins_s + 4.0)
            assert listener.contested_s <= begins_s + PROMISED_S, (rate_hz, distance_m)


@pytest.mark.parametrize("booted_s", [0.0, 2.9, -40.0])
def test_a_count_that_has_just_begun_hides_nobody(booted_s):
    """A program that counts from its own start looks like the vehicle after a reboot."""
    other = Claimant(peer=2, boots_s=booted_s, begins_s=3.03, shift=(245.0, 0.0))
    assert Listener().receive(Claimant(), other, until_s=8.0).contested_s <= 3.03 + PROMISED_S


WAYS = {"same address": (0, 1), "another address": (0, 2), "another link": (1, 1)}
SAYINGS = ("pb", "p", "pc", "pbagt", "b", "a", "n")


def taken_over(listener, true, since_s):
    """When a place far from the true one was believed."""
    return [
        t
        for t, _, (east, north), valid in listener.seen
        if valid and t > since_s and math.hypot(east - true.place(t)[0][0], north - true.place(t)[0][1]) > 10.0
    ]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("says", SAYINGS)
@pytest.mark.parametrize("component", [0, 2, 200])
def test_no_component_takes_a_vehicle_over(component, says):
    """Whatever it sends, from wherever: before the true one, beside it, or while that is silent for four seconds."""
    for link, peer in WAYS.values():
        for ahead_s in (0.0, -40.0):
            other = Claimant(component, link, peer, seq=99, shift=(1000.0, 0.0), ahead_s=ahead_s, says=says)
            cases = {
                "first": (Claimant(begins_s=3.0, says="pbagt"), other, 3.1),
                "beside": (Claimant(says="pbagt"), replace(other, begins_s=4.07), 4.07),
                "gap": (Claimant(says="pbagt", holes=((3.0, 7.0),)), replace(other, begins_s=4.03), 4.03),
            }
            for name, (true, false, since_s) in cases.items():
                listener = Listener().receive(true, false, until_s=9.0, look_s=0.5)
                case = link, peer, ahead_s, name
                assert taken_over(listener, true, since_s + PROMISED_S) == [], case
                assert (listener.contested_s <= since_s + PROMISED_S) == ("p" in says), case
                last = listener.look(8.99)
                assert last[3] == ("p" not in says) and last[1].contested == ("p" in says), case
                in_gap = [status.heartbeat_age_s for t, status, _, _ in listener.seen if 6.0 < t < 7.0]
                assert name != "gap" or min(in_gap) > 2.5, case


def test_another_component_never_ends_the_silence_of_a_vehicle_within_a_minute():
    true = Claimant(ends_s=5.0)
    other = Claimant(200, peer=2, begins_s=6.0, shift=(20.0, 0.0))
    listener = Listener().receive(true, other, until_s=70.0, look_s=1.0)
    ages = {round(t): status.heartbeat_age_s for t, status, _, _ in listener.seen}
    assert all(ages[t] == pytest.approx(t - 4.2, abs=0.1) for t in range(10, 64))
    assert not any(valid for t, _, _, valid in listener.seen if 8.0 < t < 64.0)
    assert "component 200 claims to be the autopilot too (udp address 2)" in " ".join(listener.texts())
    assert "component 200 is the autopilot now, 1 was before" in listener.texts()
    assert ages[69] < 1.5


def test_both_components_are_named():
    listener = Listener().receive(Claimant(), Claimant(200, 1, 2, begins_s=3.0, shift=(300.0, 0.0)), until_s=6.0)
    (told,) = [text for text in listener.texts() if "two senders" in text]
    assert "component 1 at udp address 1" in told and "component 200 at radio address 2" in told


def test_a_vehicle_that_only_beats_is_not_given_the_places_of_another():
    """As an autopilot does before anybody has asked for its positions."""
    listener = Listener().receive(
        Claimant(says="b"), Claimant(200, peer=2, says="pb", begins_s=3.0), until_s=12.0, look_s=0.5
    )
    assert not any(valid for _, _, _, valid in listener.seen)
    assert listener.contested_s < 7.0


def test_attitudes_alone_by_another_clock_are_told_once_the_paths_meet():
    for ahead_s in (-5.0, 8.0):
        other = Claimant(peer=2, says="a", ahead_s=ahead_s)
        listener = Listener().receive(Claimant(begins_s=3.0), other, until_s=14.0)
        assert listener.contested_s < 3.0 + abs(ahead_s) + PROMISED_S


def test_a_receiver_that_another_says_has_no_fix_keeps_its_own():
    for component in (1, 200):
        other = Claimant(component, peer=2, says="n", begins_s=3.0)
        listener = Listener().receive(Claimant(says="pbag"), other, until_s=10.0, look_s=0.5)
        assert all(valid for t, _, _, valid in listener.seen if t > 1.0)
        assert not any("GPS fix" in text for text in listener.texts())


def test_two_forged_packets_an_hour_apart_quarantine_nobody():
    for begins_s in (3.02, 9.52):
        forged = Claimant(200, peer=2, says="p", begins_s=begins_s, ends_s=begins_s + 0.1, shift=(1000.0, 0.0))
        listener = Listener().receive(Claimant(rate_hz=10.0), forged, until_s=15.0)
        assert listener.contested_s == math.inf


def test_many_addresses_hide_nobody():
    crowd = [
        Claimant(200, peer=2 + k, says="p", begins_s=3.0 + 0.02 * k, ends_s=3.05 + 0.02 * k, shift=(100.0 + k, 0.0))
        for k in range(200)
    ]
    assert Listener().receive(Claimant(), *crowd, until_s=8.0).contested_s <= 5.0


def test_who_says_the_truth_every_other_time_is_told_all_the_same():
    jumps = tuple((3.0 + 0.4 * k, 3.2 + 0.4 * k, 500.0) for k in range(20))
    other = Claimant(peer=2, seq=50, says="p", begins_s=3.05, jumps=jumps)
    assert Listener().receive(Claimant(), other, until_s=8.0).contested_s <= 5.05


QUIET = {
    "the same bytes ten seconds late": (Claimant(), Claimant(link=1, delay_s=10.0)),
    "the later link is heard first": (Claimant(begins_s=6.0), Claimant(link=1, seq=9, delay_s=8.0, begins_s=-8.0)),
    "the quick link is lost for fifteen seconds": (
        Claimant(holes=((12.0, 27.0),), loss=0.3), Claimant(link=1, seq=9, delay_s=9.0, jitter_s=0.5, begins_s=-9.0),
    ),
    "the quick link loses half, the later one changes the order": (
        Claimant(loss=0.5), Claimant(peer=2, seq=99, delay_s=5.0, jitter_s=1.0, begins_s=-5.0),
    ),
    "three links": (Claimant(), Claimant(link=1, seq=9, delay_s=3.0), Claimant(peer=2, seq=77, delay_s=10.0, loss=0.3)),
    "one place a second over either": (
        Claimant(rate_hz=1.0), Claimant(link=1, seq=9, rate_hz=1.0, delay_s=10.0, begins_s=-10.0 + 0.45),
    ),
    "a link that becomes quicker": (
        Claimant(),
        Claimant(link=1, seq=9, delay_s=7.0, ends_s=9.0),
        Claimant(link=1, seq=9, delay_s=0.5, begins_s=15.5),
    ),
    "switched on a moment ago": (
        Claimant(boots_s=-2.0), Claimant(link=1, seq=9, delay_s=10.0, begins_s=-2.0, boots_s=-2.0, loss=0.3),
    ),
    "a reboot while a link is ten seconds late": (
        Claimant(ends_s=12.0, says="pbagt"), Claimant(link=1, seq=9, delay_s=10.0, ends_s=12.0, says="pbagt"),
        Claimant(begins_s=13.3, boots_s=12.0, seq=0, says="pbagt"),
        Claimant(link=1, begins_s=13.3, boots_s=12.0, delay_s=10.0, says="pbagt"),
    ),
    "another reboot within twenty seconds": (
        Claimant(ends_s=8.0, boots_s=-4.0), Claimant(link=1, seq=9, delay_s=6.0, ends_s=8.0, boots_s=-4.0),
        Claimant(begins_s=9.3, boots_s=8.0), Claimant(link=1, begins_s=9.3, boots_s=8.0, delay_s=6.0),
    ),
    "a receiver that jumps and stays, over two links": (
        Claimant(jumps=((10.0, 1e9, 111.0),)), Claimant(link=1, seq=9, delay_s=4.0, jumps=((10.0, 1e9, 111.0),)),
    ),
    "a companion that hands on the same place by its own clock": (
        Claimant(), Claimant(191, says="pc", ahead_s=-190.0, delay_s=0.3, begins_s=2.0),
    ),
    "a companion that was switched on five seconds later": (Claimant(), Claimant(191, says="pc", ahead_s=-5.0)),
    "a second receiver some metres beside": (
        Claimant(), Claimant(220, says="p", shift=(2.5, -2.0), noise_m=0.5, ahead_s=-100.0, rate_hz=1.0),
    ),
    "a companion that was there first": (Claimant(begins_s=4.0), Claimant(191, says="pc", ahead_s=-190.0)),
    "a companion that says it is an autopilot": (Claimant(), Claimant(191, says="b")),
    "a gimbal that beats": (Claimant(), Claimant(154, says="c")),
}  # fmt: skip


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", QUIET)
def test_one_vehicle_over_late_links_and_with_its_components_is_no_contest(name):
    true, *others = QUIET[name]
    listener = Listener().receive(true, *others, until_s=40.0, look_s=1.0)
    assert listener.contested_s == math.inf, [text for text in listener.texts() if "two senders" in text]
    jumped_m = 111.0 if true.jumps else 0.0
    newest = replace(true, jumps=(), ends_s=1e9)
    off_m = [
        math.dist((east - jumped_m, north), newest.place(t)[0])
        for t, _, (east, north), valid in listener.seen
        if valid and t > 30.0
    ]
    assert len(off_m) >= 8 and max(off_m) < 3.0
    assert len([text for text in listener.texts() if "rebooted" in text]) == ("reboot" in name)


def test_a_receiver_whose_place_jumps_to_and_fro_is_no_second_sender():
    """As a jammed one does: one address, one count of packets, one clock."""
    jumps = tuple((10.0 + 1.4 * k, 10.6 + 1.4 * k, 400.0 + 90.0 * k) for k in range(8))
    listener = Listener().receive(Claimant(rate_hz=10.0, jumps=jumps), until_s=30.0, look_s=0.2)
    assert listener.contested_s == math.inf
    told = [text for text in listener.texts() if "jumps between places" in text]
    assert told == ["positions not used: it jumps between places, receiver jammed or failing"]
    first_s = next(t for t, status, _, _ in listener.seen if status.jumps)
    last_s = max(t for t, status, _, _ in listener.seen if status.jumps)
    assert 10.0 < first_s < 13.0 and 20.4 < last_s < 20.4 + 5.0
    doubtful = [(status.position_state, valid) for t, status, _, valid in listener.seen if first_s <= t <= last_s]
    assert set(doubtful) == {("refused", False)}
    assert listener.look(29.9)[3]


def test_a_jump_and_back_after_four_seconds_is_not_to_and_fro():
    listener = Listener().receive(Claimant(rate_hz=5.0, jumps=((10.0, 14.0, 111.0),)), until_s=20.0, look_s=0.2)
    assert not any(status.jumps for _, status, _, _ in listener.seen)


def test_another_sender_does_not_make_a_receiver_look_jammed():
    forged = [
        Claimant(peer=2, says="p", begins_s=5.02 + 6.0 * k, ends_s=5.1 + 6.0 * k, shift=(400.0, 0.0)) for k in range(4)
    ]
    listener = Listener().receive(Claimant(rate_hz=10.0), *forged, until_s=30.0, look_s=0.5)
    assert not any(status.jumps for _, status, _, _ in listener.seen)


def test_a_fix_that_comes_and_goes_is_one_line():
    fixes = [Claimant(says="g", holes=((10.0, 20.0),)), Claimant(says="pba")]
    flapping = [Claimant(says="gn"[k % 2], begins_s=10.0 + 0.5 * k, ends_s=10.5 + 0.5 * k) for k in range(20)]
    listener = Listener().receive(*fixes, *flapping, until_s=30.0)
    told = [text for text in listener.texts() if text.startswith("GPS fix")]
    assert told == ["GPS fix none, was 3D", "GPS fix comes and goes: 3D, none", "GPS fix 3D, steady again"]
