"""Bytes from elsewhere read by code that is not ours: in a process of its own, with bounds of memory and time.

The module that reads calls :func:`answer_parent` and is run by :func:`ask_child`. Whatever becomes of it, by a file
that asks for all memory, never ends or brings it down, is one line for who asked.
"""

from __future__ import annotations

import contextlib
import math
import os
import resource
import threading
import time
from collections.abc import Callable
from typing import TypeVar

import msgspec
import psutil

from infra.plain_text import plain
from infra.processes.channel import MessageChannel, connect_to_parent
from infra.processes.child_process import KILL_S, ChildProcess

_MAX_WORDS = 200
_MAX_WRITTEN = 1 << 20
"""Maximum number of bytes that it may print."""
_MAX_ANSWER = (1 << 31) - 1
_RESERVE_BYTES, _CHECK_EVERY_S = 64 << 20, 0.02
"""Memory kept free, and interval of the checks, seconds: with none left Python may try for ever to report that."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Threads that a library starts for nothing take address space."""

Question = TypeVar("Question", bound=msgspec.Struct)
Answer = TypeVar("Answer", bound=msgspec.Struct)


class UnreadError(Exception):
    """A file was not read; the message, one line, says why."""


class _Work(msgspec.Struct):
    question: msgspec.Raw
    most_bytes: int
    most_s: float


class _Failed(msgspec.Struct, tag=True):
    why: str


def ask_child(
    module: str, question: msgspec.Struct, answers: type[Answer], *, most_bytes: int, most_s: float
) -> Answer:
    """Have a module read something in a process of its own.

    Args:
        module: calls :func:`answer_parent`.
        answers: type of its answer, a Struct with a tag.
        most_bytes: most memory that the work may take.
        most_s: longest time that it may take, s.

    Raises:
        UnreadError: it could not, or needs more than it may have.
        OSError: the system starts no process.
    """
    child: ChildProcess[Answer | _Failed] = ChildProcess(
        module, answers | _Failed, environment=ONE_THREAD, most_bytes=_MAX_ANSWER
    )
    began_s = time.monotonic()
    clock = threading.Timer(most_s, child.kill)
    clock.start()
    try:
        child.channel.send(_Work(msgspec.Raw(msgspec.msgpack.encode(question)), most_bytes, most_s))
        answer = child.channel.receive()
    except (EOFError, OSError):
        answer = None
    finally:
        clock.cancel()
        child.end(KILL_S)
        ended = child.exit_reason
        child.close()
    if isinstance(answer, answers):
        return answer
    late = time.monotonic() - began_s >= most_s
    why = f"it takes longer than {most_s:.0f} s" if late else f"what read it ended: {ended}"
    raise UnreadError(plain(answer.why if isinstance(answer, _Failed) else why)[:_MAX_WORDS])


def answer_parent(asks: type[Question], read: Callable[[Question], msgspec.Struct]) -> None:
    """Answer the one question of a parent; what ``read`` raises is the answer that it could not be read."""
    parent: MessageChannel[_Work] = connect_to_parent(_Work)
    asked = parent.receive()
    if asked is None:
        return
    question = msgspec.msgpack.decode(asked.question, type=asks)
    may_answer = threading.Lock()
    """Taken by the thread that answers, so that no other one does."""
    process = psutil.Process()
    watches = threading.Event()
    threading.Thread(target=_watch, args=(parent, process, asked.most_bytes, may_answer, watches), daemon=True).start()
    watches.wait()
    _set_bounds(process.memory_info().vms + asked.most_bytes + _RESERVE_BYTES, asked.most_s)
    with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.redirect_stdout(nowhere):  # noqa: PTH123
        answer = _answer(question, read, asked.most_bytes)
    may_answer.acquire()
    # the answer is written without the bound
    resource.setrlimit(resource.RLIMIT_AS, (resource.getrlimit(resource.RLIMIT_AS)[1],) * 2)
    with contextlib.suppress(OSError):  # nobody waits for it any more
        parent.send(answer)


def bound(kind: int, most: int) -> None:
    """Bound what this process may have of a resource, ``RLIMIT_AS`` and the like; a bound from outside stays."""
    _, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _set_bounds(most_bytes: int, most_s: float) -> None:
    """Bound address space, output and processor time; a parent that is killed ends nothing."""
    for kind, most in (
        (resource.RLIMIT_AS, most_bytes),
        (resource.RLIMIT_FSIZE, _MAX_WRITTEN),
        (resource.RLIMIT_CPU, math.ceil(most_s)),
        (resource.RLIMIT_CORE, 0),
    ):
        bound(kind, most)


def _watch(
    parent: MessageChannel[_Work],
    process: psutil.Process,
    most_bytes: int,
    may_answer: threading.Lock,
    watches: threading.Event,
) -> None:
    """End this process where it has taken more than it may, from when ``watches`` is set."""
    before = process.memory_info().vms  # with what this thread takes
    watches.set()
    over = False
    while not over:
        time.sleep(_CHECK_EVERY_S)
        try:
            over = process.memory_info().vms - before > most_bytes
        except MemoryError:
            over = True
    if may_answer.acquire(blocking=False):
        with contextlib.suppress(OSError):
            parent.send(_too_much(most_bytes))
        os._exit(1)


def _too_much(most_bytes: int) -> _Failed:
    return _Failed(f"it takes more than {most_bytes / 1e6:.0f} MB of memory")


def _answer(question: Question, read: Callable[[Question], msgspec.Struct], most_bytes: int) -> msgspec.Struct:
    try:
        return read(question)
    except MemoryError:
        return _too_much(most_bytes)
    except Exception as error:  # noqa: BLE001 - what others' code raises on others' bytes is not known
        return _Failed(plain(" ".join(str(error).split())) or type(error).__name__)
