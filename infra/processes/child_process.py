"""A Python module that runs in a process of its own, seen from the process that started it."""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import psutil

from infra.processes.channel import MAX_BYTES, MessageChannel
from infra.program_log import child_environment

_log = logging.getLogger(__name__)

ROOT = str(Path(__file__).resolve().parents[2])
"""Folder of our packages."""
KILL_S = 2.0
"""A process that waits for the disk in the kernel ends only when the disk answers: it is not waited for longer."""
_LAST_BYTES, _LAST_CHARACTERS = 2000, 200
"""Ends of what a process wrote: read, and reported."""

Report = TypeVar("Report")


class ProcessorTime(NamedTuple):
    """Seconds since a process began."""

    used_s: float
    waited_s: float
    """Time for which its first thread could have run and was not let, s."""


class ChildProcess(Generic[Report]):
    """One process and the channel to it.

    It has no terminal to write on, and a Ctrl-C there does not reach it: it is to end when this end of the channel
    closes, which the system does if this process dies.

    Args:
        module: run as ``python -m``; it calls :func:`infra.processes.channel.connect_to_parent`.
        reports: the type of the messages that it sends, or the union of their types.
        fds: file descriptors that it needs; they have the same numbers there.
        environment: added to this process's.

    Raises:
        OSError: the system starts no process.
    """

    def __init__(
        self,
        module: str,
        reports: type[Report] | Any,  # noqa: ANN401 - unions are no types
        *,
        fds: Collection[int] = (),
        environment: Mapping[str, str] | None = None,
        most_bytes: int = MAX_BYTES,
    ) -> None:
        their_reading, our_writing = Pipe(duplex=False)
        our_reading, their_writing = Pipe(duplex=False)
        ends = their_reading.fileno(), their_writing.fileno()
        self.channel: MessageChannel[Report] = MessageChannel(our_reading, our_writing, reports, most_bytes)
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        # our packages are found where this one is, whatever folder the station was started in
        paths = os.pathsep.join(filter(None, (ROOT, os.environ.get("PYTHONPATH"))))
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *map(str, ends)],
                pass_fds=(*fds, *ends),
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=self._output,
                env={**os.environ, **(environment or {}), **child_environment(), "PYTHONPATH": paths},
                start_new_session=True,
            )
        except OSError:
            self.channel.close()
            self._output.close()
            raise
        finally:
            their_reading.close()
            their_writing.close()
        self._module = module
        _log.info("process %d begins: %s", self._process.pid, module)
        self._status = psutil.Process(self._process.pid)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """True if it is over."""
        return self._process.poll() is not None

    @property
    def exit_reason(self) -> str:
        """Words on how it ended, and the last line that it wrote; until it is closed."""
        code = self._process.poll()
        self._output.seek(max(self._output.seek(0, os.SEEK_END) - _LAST_BYTES, 0))
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        line = f": {lines[-1].strip()[:_LAST_CHARACTERS]}" if lines else ""
        return f"signal {-code}{line}" if code is not None and code < 0 else f"exit code {code}{line}"

    @property
    def processor_time(self) -> ProcessorTime:
        """Processor time of the process so far; nothing once it is over."""
        used_s = waited_s = 0.0
        with contextlib.suppress(psutil.Error):
            times = self._status.cpu_times()
            used_s = times.user + times.system
        with contextlib.suppress(OSError):  # systems other than Linux do not tell
            waited_s = int(Path(f"/proc/{self.pid}/schedstat").read_text().split()[1]) * 1e-9
        return ProcessorTime(used_s, waited_s)

    def able_s(self, silent_s: float, before: ProcessorTime) -> float:
        """Return for how much of a silence it could have shown life: not while others had the processor, or the disk
        had it."""
        now = self.processor_time
        with contextlib.suppress(psutil.Error):
            status = self._status.status()
            if status == psutil.STATUS_RUNNING:  # for how long it waits now is counted once it is let
                return min(now.used_s - before.used_s, silent_s)
            if status == psutil.STATUS_DISK_SLEEP:
                return 0.0
        return silent_s - (now.waited_s - before.waited_s)

    @property
    def waits_for_disk(self) -> bool:
        """True if a thread of it waits in the kernel, as for a disk that hangs: it cannot be ended then."""
        with contextlib.suppress(psutil.Error):
            states = (psutil.Process(thread.id).status() for thread in self._status.threads())
            return psutil.STATUS_DISK_SLEEP in states
        return False

    def end(self, timeout_s: float) -> None:
        """Ask the process to end, else kill it."""
        self.channel.close_sending()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        self.kill()

    def kill(self) -> None:
        """Kill the process at once; what it sent before can still be received."""
        self._process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_S)

    def close(self) -> None:
        """Close the channel and forget what the process wrote; to be called by who receives."""
        if self.ended and not self._output.closed:
            _log.info("process %d ended: %s, %s", self._process.pid, self._module, self.exit_reason)
        self.channel.close()
        self._output.close()


def held_bytes(process: psutil.Process) -> int:
    """Memory that a process and those that it started hold now.

    Raises:
        psutil.Error: it is gone.
    """
    held = int(process.memory_info().rss)
    for child in process.children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            held += int(child.memory_info().rss)
    return held
