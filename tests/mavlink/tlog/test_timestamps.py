"""What becomes of the times of a log: right ones, torn ones, those of clocks that were set or never set."""

import numpy as np
import pytest

from mavlink.protocol.packet import Packet
from tests.support.tlog_records import PACKETS, T0, frames_of, index_of, record


def test_impossible_times_take_the_one_before():
    packets = list(PACKETS)
    packets[0] = Packet(0, packets[0].raw)
    packets[5] = Packet(2**62, packets[5].raw)
    packets[50] = Packet(packets[50].t_us + 3_600_000_000, packets[50].raw)
    index = index_of(b"".join(map(record, packets)))
    assert np.flatnonzero(~index.time_ok).tolist() == [0, 5, 50]
    assert index.t_us[[0, 5, 50]].tolist() == [PACKETS[1].t_us, PACKETS[4].t_us, PACKETS[49].t_us]
    assert index.counts.bad_times == 3
    assert [d.reason for d in index.damage] == ["impossible time"] * 3
    assert all(d.stop - d.start == 8 for d in index.damage)


def test_a_second_writers_clock_is_believed_too():
    hour = 3_600_000_000
    packets = [Packet(p.t_us + hour * (i % 2), p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.time_ok.all()


def test_a_message_after_a_silence_is_believed():
    minute = 60_000_000
    packets = [Packet(T0 + [0, 1, 2, 300, 600, 601, 602][i] * minute // 100 * 100, PACKETS[i].raw) for i in range(7)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.time_ok.all()


def test_two_stamps_with_the_same_flipped_bit_do_not_vouch_for_each_other():
    packets = list(PACKETS)
    for i in (60, 200):
        packets[i] = Packet(packets[i].t_us ^ (1 << 33), packets[i].raw)
    index = index_of(b"".join(map(record, packets)))
    assert np.flatnonzero(~index.time_ok).tolist() == [60, 200]


def test_a_step_of_the_clock_keeps_the_order():
    packets = [Packet(p.t_us - (3_600_000_000 if i >= 150 else 0), p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.counts.backward_steps == 1
    assert index.time_ok.all()


def test_little_endian_times_are_recognised():
    index = index_of(b"".join(record(p, "<") for p in PACKETS))
    assert index.time_source == "little-endian"
    assert index.t_us.tolist() == [p.t_us for p in PACKETS]


def test_file_without_times_keeps_its_order_and_says_so():
    data = b"".join(p.raw for p in PACKETS)
    index = index_of(data)
    assert index.time_source == "none"
    assert frames_of(data, index) == [p.raw for p in PACKETS]
    assert (np.diff(index.t_us) > 0).all()
    assert not index.time_ok.any()
    assert index.damage == ()


@pytest.mark.parametrize("start_us", [5_000_000, 315_964_800_000_000])
def test_a_clock_that_was_never_set_is_believed(start_us):
    """A computer without a battery begins in 1970, a receiver without a fix in 1980."""
    packets = [Packet(p.t_us - T0 + start_us, p.raw) for p in PACKETS]
    index = index_of(b"".join(map(record, packets)))
    assert index.time_source == "big-endian"
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.damage == ()


@pytest.mark.parametrize("at", [20, 150, 280])
def test_a_clock_that_is_set_from_1970_keeps_both_times(at):
    packets = [p if i >= at else Packet(p.t_us - T0 + 5_000_000, p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]
    assert index.time_ok.all()


def test_flights_of_different_years_in_one_file_keep_their_times():
    years = 5 * 366 * 86_400_000_000
    packets = [Packet(p.t_us + years * (i >= 100), p.raw) for i, p in enumerate(PACKETS)]
    index = index_of(b"".join(map(record, packets)))
    assert index.t_us.tolist() == [p.t_us for p in packets]


@pytest.mark.parametrize("stamp", [0, 2**64 - 1])
def test_stamps_that_say_nothing_keep_the_order(stamp):
    index = index_of(b"".join(stamp.to_bytes(8, "big") + p.raw for p in PACKETS))
    assert frames_of(b"".join(stamp.to_bytes(8, "big") + p.raw for p in PACKETS), index) == [p.raw for p in PACKETS]
    assert not index.time_ok.any()
    assert (np.diff(index.t_us) > 0).all()
    assert index.t_us[0] >= 0
