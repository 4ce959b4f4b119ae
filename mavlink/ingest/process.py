"""One run of the ingest process, seen from the station."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import mavlink
from mavlink.errors import LinkError
from mavlink.ingest.child import ACCEPT, COMMAND, GO
from mavlink.ingest.ingest_memory import IngestMemory, Slot
from mavlink.ingest.plan import Plan

__all__ = ["IngestProcess"]

START_S = 20.0
"""A start that takes longer has failed."""
_STOP_S = 15.0
_KILL_S = 2.0
"""One that waits for the disk in the kernel ends only when the disk answers: it is not waited for longer."""
_SEND_S = 0.2
_LAST_WORDS = 2000


class IngestProcess:
    """Starts the process, which then waits for its turn: it has imported all it needs, and opened nothing.

    Args:
        plan: with the numbers of memory and sockets in this process; ``control`` is filled in.
        memory: the same memory.
        files: file descriptors that the process needs.
    """

    def __init__(self, plan: Plan, memory: IngestMemory, files: Collection[int]) -> None:
        self.generation = 0
        """Which of a flight's processes it is, from 1; 0 before its turn."""
        self.began_s = time.monotonic()
        """When it was started, then when its turn came."""
        self.control, theirs = socket.socketpair()
        self.control.settimeout(_SEND_S)
        self._memory = memory
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        told = replace(plan, control=theirs.fileno())
        # the package is found where this one is, whatever folder the station was started in
        home = str(Path(mavlink.__file__).parent.parent)
        paths = os.pathsep.join(path for path in (home, os.environ.get("PYTHONPATH", "")) if path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "mavlink.ingest", told.to_text()],
                pass_fds=(*files, theirs.fileno()),
                stdin=subprocess.DEVNULL,
                stdout=self._words,
                stderr=self._words,
                env=os.environ | {"PYTHONPATH": paths},
                start_new_session=True,
            )
        except OSError as error:
            self.control.close()
            self._words.close()
            raise LinkError(f"the ingest process cannot be started: {error.strerror or error}") from error
        finally:
            theirs.close()

    @property
    def pid(self) -> int:
        """Its id."""
        return self._process.pid

    @property
    def ready(self) -> bool:
        """Whether it has opened everything."""
        return self.generation > 0 and self._memory.slots[Slot.READY] == self.generation

    @property
    def dead(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    @property
    def reason(self) -> str:
        """Why it ended, as far as is known."""
        code = self._process.poll()
        self._words.seek(0, os.SEEK_END)
        self._words.seek(max(self._words.tell() - _LAST_WORDS, 0))
        lines = self._words.read().decode(errors="replace").strip().splitlines()
        said = f": {lines[-1]}" if lines else ""
        return f"signal {-code}{said}" if code is not None and code < 0 else f"exit code {code}{said}"

    def waits_for_processor(self, silent_s: float, cpu_s: float) -> bool:
        """Whether it shows no life only because others have the processor: it could run and has hardly been let.

        Args:
            silent_s: for how long it has shown no life.
            cpu_s: its processor time before that.
        """
        state, now_s = self._proc()
        return state == "R" and now_s - cpu_s < 0.5 * silent_s

    @property
    def cpu_s(self) -> float:
        """Processor time so far, 0 where the system does not say."""
        return self._proc()[1]

    def _proc(self) -> tuple[str, float]:
        """State and processor time, as in proc(5)."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
            return fields[0], (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        except (OSError, IndexError, ValueError):
            return "", 0.0

    def go(self, generation: int) -> None:
        """It is this process's turn; :attr:`ready` says when it has opened everything.

        Raises:
            LinkError: it has ended.
        """
        self.generation = generation
        self.began_s = time.monotonic()
        try:
            self.control.sendall(GO.pack(generation))
        except OSError as error:
            raise LinkError(f"the ingest process has ended: {self.reason}") from error

    def send(self, link: int, data: bytes, peer: int) -> None:
        """Has a frame sent.

        Raises:
            LinkError: the process does not take it.
        """
        try:
            self.control.sendall(COMMAND.pack(link, len(data), peer) + data)
        except OSError as error:
            raise LinkError(f"the ingest process does not take what is to be sent: {error}") from error

    def accept_held(self, system_id: int) -> None:
        """Has it accept what it holds of a system.

        Raises:
            LinkError: the process does not take it.
        """
        self.send(ACCEPT, b"", system_id)

    def stop(self) -> None:
        """Has it write everything and end."""
        try:
            self.control.shutdown(socket.SHUT_WR)
            self._process.wait(_STOP_S)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
        self._let_go()

    def kill(self) -> None:
        """Ends it at once; what is in its sockets stays there for the next."""
        self._process.kill()
        self._let_go()

    def _let_go(self) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_KILL_S)
        self.control.close()
        self._words.close()
