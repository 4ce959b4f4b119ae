"""What a worker is told to use counts the processes that work for it."""

from __future__ import annotations

import subprocess
import sys

import psutil

from gcs.batch.work import processor_s
from infra.processes.child_process import held_bytes

HOLDS_AND_WORKS = """
import time
held = bytearray(b"1" * (64 << 20))
while time.process_time() < 0.5: pass
print(flush=True)
input()
"""


def test_what_a_process_has_others_do_counts():
    us, before_s = psutil.Process(), processor_s()
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS_AND_WORKS], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        child.stdout.readline()
        assert held_bytes(us) > us.memory_info().rss + (64 << 20)
        child.communicate(b"\n")
    assert processor_s() > before_s + 0.4
