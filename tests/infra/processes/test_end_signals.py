"""Signals that ask to end are noted, and interrupt nothing."""

import os
import signal

from infra.processes.end_signals import noted_signals


def test_each_signal_is_noted_and_the_handlers_are_those_of_before_afterwards():
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    with noted_signals() as asked:
        assert not asked.to_end and not asked.hung_up
        os.kill(os.getpid(), signal.SIGHUP)
        assert asked.hung_up and not asked.to_end
        for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM):
            asked.to_end = False
            os.kill(os.getpid(), number)
            assert asked.to_end
    assert [signal.getsignal(number) for number in numbers] == before
