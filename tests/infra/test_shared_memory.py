"""Memory between processes: nothing torn or stale is handed out, in whatever order stores become visible."""

import multiprocessing
import os
import random
import time

import pytest

from infra.shared_memory import NewestValue, Ring, make_memory, map_memory

RING_BYTES = 4096
RECORDS = 20_000


def record_of(k):
    """As long as it pleases, and known by its number."""
    return k.to_bytes(4, "little") * (1 + k % 37)


def test_records_come_out_as_they_went_in_for_many_rounds():
    memory = memoryview(bytearray(RING_BYTES))
    writer, reader, taken = Ring(memory), Ring(memory), []
    for k in range(3000):
        assert writer.put(record_of(k))
        if k % 7 == 6:
            taken += reader.read_records()
    assert taken + reader.read_records() == [record_of(k) for k in range(3000)]
    assert reader.read_records() == [] and writer.read == writer.written


def test_a_full_ring_takes_no_more_until_something_is_taken_out():
    ring = Ring(memoryview(bytearray(RING_BYTES)))
    kept = sum(ring.put(bytes(92)) for _ in range(100))
    assert kept == (RING_BYTES - 16) // 100 and not ring.put(bytes(92))
    assert len(ring.read_records()) == kept and ring.put(bytes(92))


@pytest.mark.parametrize("rounds", [0, 1, 5], ids=["new memory", "stale bytes", "older bytes"])
def test_a_cursor_that_is_seen_before_the_bytes_gives_out_nothing_torn(rounds):
    """The stores of one ``put`` become visible one byte at a time, in any order, the cursor first."""
    rng = random.Random(rounds)
    ours, theirs = bytearray(1024), bytearray(1024)
    writer, reader = Ring(memoryview(ours)), Ring(memoryview(theirs))
    number = 0
    for _ in range(rounds * 40):
        assert writer.put(record_of(number))
        theirs[:] = ours
        assert reader.read_records() == [record_of(number)]
        ours[8:16] = theirs[8:16]
        number += 1
    for _ in range(200):
        late = record_of(number)
        assert writer.put(late)
        changed = [place for place in range(16, 1024) if ours[place] != theirs[place]]
        rng.shuffle(changed)
        theirs[:8] = ours[:8]  # the cursor
        for place in changed:
            assert reader.read_records() == []
            theirs[place] = ours[place]
        assert reader.read_records() == [late]
        ours[8:16] = theirs[8:16]
        number += 1


def test_a_value_is_whole_or_not_there():
    ours, theirs = bytearray(256), bytearray(256)
    writer, reader = NewestValue(memoryview(ours)), NewestValue(memoryview(theirs))
    assert reader.get() is None
    rng, before = random.Random(1), None
    for k in range(200):
        assert writer.put(record_of(k))
        changed = [place for place in range(256) if ours[place] != theirs[place]]
        rng.shuffle(changed)
        for place in changed:
            assert reader.get() in (None, before)
            theirs[place] = ours[place]
        before = record_of(k)
        assert reader.get() == before
    assert not writer.put(bytes(1000)) and NewestValue(memoryview(ours)).get() == before


def put_all(fd):
    memory = memoryview(map_memory(fd))
    ring, newest = Ring(memory[:RING_BYTES]), NewestValue(memory[RING_BYTES:])
    for k in range(RECORDS):
        newest.put(record_of(k))
        while not ring.put(record_of(k)):
            time.sleep(0)


def test_two_processes_at_full_speed():
    fd = make_memory(2 * RING_BYTES)
    memory = memoryview(map_memory(fd))
    ring, newest, taken, seen = Ring(memory[:RING_BYTES]), NewestValue(memory[RING_BYTES:]), [], set()
    writer = multiprocessing.get_context("fork").Process(target=put_all, args=(fd,))
    writer.start()
    stop_s = time.monotonic() + 120.0
    while len(taken) < RECORDS and time.monotonic() < stop_s:
        taken += ring.read_records()
        seen.add(newest.get())
    writer.join()
    os.close(fd)
    assert taken == [record_of(k) for k in range(RECORDS)]
    assert seen - {None} <= set(taken) and newest.get() == taken[-1]
