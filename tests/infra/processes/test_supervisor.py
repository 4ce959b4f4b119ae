"""A child process that dies, hangs, lies or is no longer needed."""

import os
import signal
import time
from pathlib import Path

import pytest

from infra.processes.child_process import ChildProcess
from infra.processes.supervisor import Supervisor
from infra.program_log import LogFile
from tests.support.children.supervised_child import Begin, Do, Done

PATIENCE_S = 0.3
WITHIN_S = 120.0


class Owner:
    def __init__(self, **options):
        self.said, self.failures, self.begun, self.excuses, self.starts = [], [], 0, False, 0
        self.refuses = 0
        self.supervisor = Supervisor(
            "test",
            start=self.start,
            begin=self.begin,
            watch=self.watch,
            replaced=self.replaced,
            excused=lambda process: self.excuses,
            **{
                "watch_s": 0.05,
                "start_s": WITHIN_S,
                "stop_s": WITHIN_S,
                "pauses_s": (0.0, 0.05),
                "steady_s": 0.0,
                **options,
            },
        )

    def start(self):
        if self.refuses:
            self.refuses -= 1
            raise BlockingIOError("no more processes")
        self.starts += 1
        return ChildProcess("tests.support.children.supervised_child", Done)

    def begin(self, process):
        self.begun += 1
        process.channel.send(Begin(self.begun))

    def watch(self, process, timeout_s):
        message = process.channel.receive(timeout_s)
        if message is None:
            return None
        self.said.append((message.number, message.what))
        return PATIENCE_S if message.what == "be quick" else WITHIN_S

    def replaced(self, failure, alive_s):
        assert alive_s <= time.monotonic()
        self.failures.append(failure)

    def do(self, what):
        self.supervisor.process.channel.send(Do(what), WITHIN_S)

    def until(self, condition):
        stop_s = time.monotonic() + WITHIN_S
        while not condition() and time.monotonic() < stop_s:
            time.sleep(0.01)
        return condition()

    def hears(self, number, what):
        return self.until(lambda: (number, what) in self.said)


@pytest.fixture
def own():
    owners = []

    def make(**options):
        owner = Owner(**options)
        owners.append(owner)
        owner.supervisor.supervise()
        assert owner.hears(1, "begin")
        return owner

    yield make
    for owner in owners:
        owner.supervisor.stop()
        assert owner.supervisor.process.ended


def test_messages_go_both_ways_and_the_end_is_orderly(own):
    owner = own()
    for k in range(50):
        owner.do(f"{k}")
    assert owner.hears(1, "49")
    owner.supervisor.stop()
    assert owner.said == [(1, what) for what in ("begin", *map(str, range(50)), "end")]
    assert owner.supervisor.restarts == 0 and owner.failures == []
    owner.supervisor.stop()
    with pytest.raises(OSError, match="closed"):
        owner.do("more")


def test_one_that_dies_is_replaced_and_its_last_words_are_known(own):
    owner = own()
    owner.do("before")
    owner.do("die")
    assert owner.hears(2, "begin")
    assert owner.until(lambda: owner.failures == ["died (exit code 1: these are its last words)"])
    assert owner.said[:2] == [(1, "begin"), (1, "before")], "what it sent before is received"
    os.kill(owner.supervisor.process.pid, signal.SIGKILL)
    assert owner.hears(3, "begin")
    assert owner.until(lambda: owner.failures[1:] == ["died (signal 9)"])


@pytest.mark.slow_but_first
@pytest.mark.parametrize("what", ["hang", "burn"])
def test_one_that_hangs_is_replaced_unless_it_is_excused(own, what):
    owner = own()
    owner.excuses = True
    owner.do("be quick")
    owner.do(what)
    assert owner.hears(1, "be quick")
    time.sleep(3 * PATIENCE_S)
    assert owner.failures == []
    owner.excuses = False
    assert owner.hears(2, "begin")
    assert owner.until(lambda: owner.failures and "showed no life for" in owner.failures[0])


def test_one_that_sends_nonsense_is_replaced(own):
    owner = own(stop_s=0.1)
    owner.do("nonsense")
    assert owner.hears(2, "begin")


def test_a_spare_takes_over_and_another_is_prepared(own):
    owner = own(spare=True)
    assert owner.until(lambda: owner.starts == 2)
    assert owner.until(lambda: owner.supervisor.spare is not None)
    spare = owner.supervisor.spare
    owner.do("die")
    assert owner.hears(2, "begin") and owner.supervisor.process is spare
    assert owner.until(lambda: owner.starts == 3)
    assert owner.until(lambda: owner.supervisor.spare is not None)
    spare = owner.supervisor.spare
    owner.supervisor.stop()
    assert spare.ended


def test_a_system_that_starts_no_process_is_asked_again(own):
    owner = own()
    owner.refuses = 2
    owner.do("die")
    assert owner.hears(2, "begin") and owner.refuses == 0


def test_the_last_process_is_not_replaced(own):
    owner = own()
    owner.supervisor.replaces = False
    owner.do("die")
    owner.supervisor._thread.join(WITHIN_S)
    assert not owner.supervisor._thread.is_alive() and owner.starts == 1


def test_one_that_does_not_end_when_it_is_asked_is_killed(own):
    owner = own(stop_s=0.1)
    owner.do("hang")
    owner.supervisor.stop()
    assert owner.supervisor.process.ended


def test_one_that_was_never_looked_after_is_ended():
    owner = Owner()
    owner.supervisor.stop()
    assert owner.supervisor.process.ended


def test_only_the_time_counts_in_which_a_process_can_run(own):
    owner = own(stop_s=0.1)
    process = owner.supervisor.process
    before = process.processor_time
    owner.do("burn")
    assert owner.until(lambda: process.processor_time.used_s > before.used_s + 0.1)
    used_s = process.processor_time.used_s - before.used_s
    assert used_s <= process.able_s(1000.0, before) < 500.0, "it has hardly been let"
    assert process.able_s(0.05, before) == 0.05, "it has had the processor"
    assert not process.waits_for_disk
    os.kill(process.pid, signal.SIGSTOP)
    assert owner.until(lambda: process.able_s(1000.0, before) > 500.0), "it was stopped"
    process.kill()
    assert process.processor_time == (0.0, 0.0) and not process.waits_for_disk


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the system does not tell")
def test_time_that_others_had_the_processor_is_taken_off_afterwards_too(own):
    owner = own(stop_s=0.1)
    process = owner.supervisor.process
    before = process.processor_time
    rivals = [ChildProcess("tests.support.children.supervised_child", Done) for _ in range(3)]
    for each in (process, *rivals):
        os.sched_setaffinity(each.pid, {min(os.sched_getaffinity(0))})
    try:
        for rival in rivals:
            rival.channel.send(Begin(0))
            rival.channel.send(Do("burn"))
        owner.do("burn")
        assert owner.until(lambda: process.processor_time.waited_s > before.waited_s + 0.5)
        os.kill(process.pid, signal.SIGSTOP)
        assert owner.until(lambda: process._status.status() == "stopped")
        waited_s = process.processor_time.waited_s - before.waited_s
        assert process.able_s(2.0, before) == pytest.approx(2.0 - waited_s)
    finally:
        for rival in rivals:
            rival.kill()
            rival.close()


@pytest.mark.parametrize(("able_s", "replaced"), [(0.5 * PATIENCE_S, False), (2.0 * PATIENCE_S, True)])
def test_one_that_others_keep_from_running_is_left_alone(own, monkeypatch, able_s, replaced):
    owner = own()
    asked = []
    monkeypatch.setattr(ChildProcess, "able_s", lambda *given: asked.append(given) or able_s)
    owner.do("be quick")
    owner.do("hang")
    assert owner.until(lambda: len(asked) > 3 or owner.failures)
    assert bool(owner.failures) == replaced


def test_begins_ends_and_replacements_are_logged(own, tmp_path):
    log = LogFile(tmp_path / "program.log")
    owner = own()
    owner.do("die")
    assert owner.hears(2, "begin")
    assert owner.until(lambda: owner.supervisor.restarts == 1)
    owner.supervisor.stop()
    log.close()
    text = log.path.read_text()
    assert text.count("begins: tests.support.children.supervised_child") == 2
    assert text.count("ended: tests.support.children.supervised_child") == 2
    assert "these are its last words); another has begun" in text
