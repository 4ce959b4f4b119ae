"""A reader of tests, in a process of its own: does to itself what bytes of others would have it do."""

import contextlib
import os
import signal
import sys

import msgspec

from infra.processes.bounded import answer_parent


class Read(msgspec.Struct):
    what: str


class Found(msgspec.Struct, tag=True):
    data: bytes


def read(question):
    if question.what == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if question.what == "hang":
        signal.pause()
    if question.what == "ever more":
        kept = []
        while True:
            with contextlib.suppress(MemoryError):
                kept.append([kept])
    if question.what == "burn":
        while True:
            pass
    if question.what == "refuse":
        raise LookupError("no such\nthing")
    if question.what == "print":
        sys.stdout.write("words of a library")
    return Found(bytes(10_000_000_000 if question.what == "all memory" else 3_000_000))


if __name__ == "__main__":
    answer_parent(Read, read)
