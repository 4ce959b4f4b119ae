"""The screens on a pseudo terminal that is slow, replies late, or goes away."""

from __future__ import annotations

import os
import sys
import time

import pytest

from tests.support.bundled import ROOT
from tests.support.slow_terminal import SlowTerminal
from tests.support.waiting import until

SCRIPT = """
import itertools, os, sys, threading
from dataclasses import replace
import numpy as np
from tests.support.fake_station import FakeStation
from gcs.cli.output.console import redirect_stderr
from gcs.tui import run
where = sys.argv[1]
reads, read = itertools.count(), os.read
def counted(fd, size):
    next(reads)
    return read(fd, size)
os.read = counted
station, frames = FakeStation(live=True), itertools.count()
if sys.argv[2] == "noise":
    images = [np.random.default_rng(n).integers(0, 255, (90, 160, 3), dtype=np.uint8) for n in range(8)]
    def latest():
        frame = next(frames)
        return replace(station.snapshot, frame=frame, image=images[frame % 8])
    station.latest = latest
with redirect_stderr(None):
    ended = run(station, graphics=sys.argv[3])
left = sorted(thread.name for thread in threading.enumerate() if thread.name.startswith("t"))
with open(where, "w") as file:
    print(ended.code, ended.left, next(reads), *left, file=file)
"""
QUEUED_BYTES = 15_000
"""What may be on its way to a terminal: at 60 kB/s a quarter of a second."""
ANSWER_BYTES = 150_000
"""What may come between a key and its answer on a machine that is busy: of queued pictures it would be megabytes."""


@pytest.fixture
def begin(tmp_path):
    begun = []

    def _begin(what="still", graphics="blocks", **line):
        words = (sys.executable, "-c", SCRIPT, tmp_path / "end.txt", what, graphics)
        begun.append(SlowTerminal(words, folder=ROOT, **line))
        return begun[-1]

    yield _begin
    for terminal in begun:
        terminal.end()


def end_of(terminal, folder) -> tuple[str, str, int, list[str]]:
    assert terminal.process.wait(120) == 0
    code, left, reads, *threads = (folder / "end.txt").read_text().split()
    return code, left, int(reads), threads


@pytest.mark.slow_but_first
@pytest.mark.parametrize("replies", [True, False])
def test_pictures_that_a_slow_line_cannot_carry_are_dropped_and_keys_are_answered(begin, tmp_path, replies):
    # a line without replies is one whose far end takes no more than it shows
    terminal = begin("noise", bytes_per_s=60_000, replies=replies, lookahead=None if replies else 4_096)
    terminal.wait_for(b"UGV-17")
    for key, answer in ((b"f", "▌FLEET"), (b"e", "▌EVENTS"), (b"f", "▌FLEET")):
        before = terminal.shown.count(b"\x1b[")
        assert until(lambda before=before: terminal.shown.count(b"\x1b[") > before + 3000)
        since = terminal.press(key)
        if replies:
            assert terminal.queued <= QUEUED_BYTES
        terminal.wait_for("▌".encode(), since)
        assert terminal.shown.find("▌".encode(), since) - since <= ANSWER_BYTES, answer
    terminal.press(b"qq")  # asked, and yes
    assert end_of(terminal, tmp_path)[:2] == ("0", "True")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["closed", "hung up"])
def test_the_screens_end_with_their_terminal(begin, tmp_path, how):
    terminal = begin("noise", controls=how == "hung up")
    terminal.wait_for(b"UGV-17")
    terminal.close()
    code, left, reads, threads = end_of(terminal, tmp_path)
    assert (code, left) == ("0", "False")
    assert reads < 100, "it does not read the end over and over"
    assert threads == [], "nobody reads or writes there any more"


@pytest.mark.slow
def test_late_replies_are_no_keys(begin, tmp_path):
    terminal = begin(replies=False)
    terminal.wait_for(b"UGV-17")
    for part in (
        b"\x1b[?64;1;2;6;9;15;16;17;18;21",
        b";22;28c",
        b"\x1b[0n\x1b[",
        b"?62;4c\x1b_Gi=31;OK",
        b"\x1b\\\x1b[6;20;10t",
    ):
        os.write(terminal.keeper, part)
        time.sleep(0.01)
    since = terminal.press(b"f")
    terminal.wait_for("▌".encode(), since)  # the help would be in the way
    terminal.press(b"qq")  # asked, and yes
    assert end_of(terminal, tmp_path)[:2] == ("0", "True")


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [0.06, 0.25])
def test_a_key_at_the_start_and_replies_on_images_that_come_late_open_nothing(begin, tmp_path, delay_s):
    terminal = begin(graphics="auto", delay_s=delay_s, environment={"VTE_VERSION": "7600"})
    terminal.press(b"x")
    terminal.wait_for(b"UGV-17")
    assert b"\x1b[c" in terminal.shown, "it was asked"
    time.sleep(0.6)
    since = terminal.press(b"f")
    terminal.wait_for("▌".encode(), since)  # the help would be in the way
    terminal.press(b"qq")  # asked, and yes
    assert end_of(terminal, tmp_path)[:2] == ("0", "True")
