from __future__ import annotations

import pytest

from gcs.tui.terminal.pacing import FIRST_BYTES, LOST_S, MAX_BYTES, MIN_BYTES, QUEUE_S, Pacing


def begun(delay_s: float) -> Pacing:
    """With the question answered that the start asks."""
    pacing = Pacing()
    pacing.send(4, -delay_s)
    pacing.written()
    pacing.replied(0.0)
    return pacing


def carry(pacing: Pacing, rate: float, delay_s: float, *, warm_s: float, seconds: float) -> tuple[int, int, float]:
    """A line of so many bytes a second, with always more to show: bytes shown, the most queued, the longest wait.

    What is before ``warm_s`` is not counted.
    """
    now = idle = longest = 0.0
    replies: list[tuple[float, int]] = []
    shown = most = 0
    while now < seconds:
        while room := pacing.room(now):
            pacing.send(room, now)
            pacing.written()
            idle = max(idle, now) + room / rate
            replies.append((idle + delay_s, room))
            if now >= warm_s:
                most = max(most, sum(size for _, size in replies))
                longest = max(longest, idle + delay_s - now)
        now, size = replies.pop(0)
        shown += size * (now >= warm_s)
        pacing.replied(now)
    return shown, most, longest


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("rate", [20_000, 60_000, 1_000_000])
def test_a_line_is_used_and_its_queue_stays_short(rate, delay_s):
    pacing = begun(delay_s)
    shown, most, longest = carry(pacing, rate, delay_s, warm_s=5.0, seconds=25.0)
    assert shown > 0.6 * rate * 20
    assert most <= max(MIN_BYTES, 1.5 * rate * (2 * QUEUE_S + delay_s))
    assert longest <= delay_s + 2.5 * max(QUEUE_S, MIN_BYTES / rate)


def test_a_quick_terminal_is_not_held_up():
    pacing = begun(0.001)
    carry(pacing, 50e6, 0.001, warm_s=0.0, seconds=1.0)
    assert pacing.window > 500_000
    assert pacing.window <= MAX_BYTES


def test_a_terminal_that_never_replies_is_paced_by_what_the_system_takes():
    pacing = Pacing()
    pacing.send(FIRST_BYTES, 0.0)
    assert pacing.room(10 * LOST_S) == 0, "not written: still on its way"
    pacing.written()
    assert pacing.room(0.002) and not pacing.open_questions
    for i in range(1000):
        pacing.send(100, float(i))
        pacing.written()
    assert not pacing.on_its_way


def test_a_lost_reply_holds_nothing_up_for_ever():
    pacing = begun(0.05)
    pacing.send(pacing.window, 1.0)
    assert pacing.open_questions == 1
    assert not pacing.room(1.0 + LOST_S / 2)
    assert pacing.room(1.1 + LOST_S)
