"""Whatever reading does to the process that reads is one line for who asked."""

import signal

import msgspec
import pytest

from infra.processes.bounded import UnreadError, _Work, ask_child
from infra.processes.child_process import ChildProcess
from tests.support.children.bounded_child import Found, Read
from tests.support.waiting import until

MODULE = "tests.support.children.bounded_child"


@pytest.mark.parametrize("what", ["whole", "print"])
def test_what_was_read_comes_whole(what):
    answer = ask_child(MODULE, Read(what), Found, most_bytes=100_000_000, most_s=120.0)
    assert len(answer.data) == 3_000_000


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("all memory", "it takes more than 100 MB of memory"),
        ("ever more", "it takes more than 100 MB of memory"),
        ("crash", "what read it ended: signal 11"),
        ("refuse", "no such thing"),
    ],
)
def test_what_brings_it_down_is_one_line(what, why):
    with pytest.raises(UnreadError, match=why) as caught:
        ask_child(MODULE, Read(what), Found, most_bytes=100_000_000, most_s=120.0)
    assert "\n" not in str(caught.value)


def test_what_never_ends_is_ended():
    with pytest.raises(UnreadError, match="it takes longer than 2 s"):
        ask_child(MODULE, Read("hang"), Found, most_bytes=100_000_000, most_s=2.0)


def test_one_whose_parent_is_killed_has_an_end_all_the_same():
    child = ChildProcess(MODULE, Found)
    try:
        child.channel.send(_Work(msgspec.Raw(msgspec.msgpack.encode(Read("burn"))), 100_000_000, 1.0))
        assert until(lambda: child.ended)
        assert child.exit_reason == f"signal {signal.SIGXCPU}"
    finally:
        child.kill()
        child.close()
