"""Arrival is when the kernel got a datagram, not when it was read."""

import socket
import sys
import time

import pytest

from infra.stamped_udp import open_stamped_udp, receive_stamped
from tests.support.waiting import until

HOST = "127.0.0.1"


@pytest.fixture
def pair():
    with open_stamped_udp(1 << 20) as ours, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        ours.bind((HOST, 0))
        theirs.connect(ours.getsockname())
        yield ours, theirs


def test_nothing_is_waited_for_and_senders_are_named(pair):
    ours, theirs = pair
    with pytest.raises(BlockingIOError):
        receive_stamped(ours)
    theirs.send(b"one")
    data, sender, _ = receive_stamped(ours)
    assert (data, sender) == (b"one", theirs.getsockname())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux stamps as nanoseconds")
def test_what_lies_in_the_socket_keeps_the_time_of_its_arrival(pair):
    ours, theirs = pair

    def keeps_its_time():
        before_us = time.time_ns() // 1000
        theirs.send(b"one")
        sent_us = time.time_ns() // 1000
        time.sleep(0.05)
        return before_us - 1000 <= receive_stamped(ours)[2] <= sent_us + 1000

    # the kernel begins to stamp some time after the first socket asks for it; until then it stamps when it is read
    assert until(keeps_its_time)
