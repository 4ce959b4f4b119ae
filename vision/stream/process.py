"""The parent's end of the video's own process: start, ask, listen, kill."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.stream.messages import SLOT_BYTES, Request, Settings, WorkerReport, decode, encode, map_slot

__all__ = ["Process"]

ROOT = str(Path(__file__).resolve().parents[2])


class Process:
    """One child process.

    It has no terminal to write on, and a Ctrl-C there does not reach it: it ends when this end of the pipe closes.
    """

    def __init__(self, settings: Settings, slot_fd: int, socket_fd: int) -> None:
        theirs_in, self._requests = Pipe(duplex=False)
        self._reports, theirs_out = Pipe(duplex=False)
        # two threads that close one pipe may close the descriptor of somebody else
        self._closing = threading.Lock()
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        fds = theirs_in.fileno(), theirs_out.fileno(), slot_fd, socket_fd
        # the package is found where this one is, whatever folder the station was started in
        paths = [ROOT, os.environ.get("PYTHONPATH", "")]
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "vision.stream.stream_worker", *map(str, fds)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._words,
            pass_fds=[fd for fd in fds if fd >= 0],
            start_new_session=True,
            # numpy only carries frames there: threads for algebra would take memory for nothing
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "OPENBLAS_NUM_THREADS": "1"},
        )
        theirs_in.close()
        theirs_out.close()
        self._slot: NDArray[np.uint8] = np.frombuffer(map_slot(slot_fd), dtype=np.uint8)
        self._send(encode(settings))

    @property
    def pid(self) -> int:
        """Of the child."""
        return self._child.pid

    def ask(self, number: int, wait_s: float) -> None:
        """Ask for the newest frame."""
        self._send(encode(Request(number=number, wait_s=wait_s)))

    def hear(self, timeout_s: float) -> WorkerReport | None:
        """The next message, None when none comes in time.

        Raises:
            EOFError: the process is gone.
            ValueError: it tells nonsense.
        """
        try:
            if not self._reports.poll(timeout_s):
                return None
            return decode(self._reports.recv_bytes(1 << 20), WorkerReport)
        except OSError as error:
            raise EOFError from error

    def image(self, width: int, height: int) -> NDArray[np.uint8] | None:
        """A copy (height, width, 3) of the frame that was handed over last, None if it cannot be of that size."""
        size = width * height * 3
        if not 0 < size <= SLOT_BYTES or width <= 0:
            return None
        return self._slot[:size].reshape(height, width, 3).copy()

    def stop(self) -> None:
        """Ask it to seal the recording and end."""
        with self._closing:
            if not self._requests.closed:
                self._requests.close()

    def end(self, timeout_s: float) -> str:
        """Wait for its end, then make it; how it ended, in words."""
        self.stop()
        try:
            code = self._child.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._child.kill()
            code = self._child.wait()
        finally:
            self._reports.close()
        words = self._last_words()
        return f"was ended by signal {-code}{words}" if code < 0 else f"ended with code {code}{words}"

    def _last_words(self) -> str:
        """What it wrote when it died, at most a line."""
        if self._words.closed:
            return ""
        with self._words:
            self._words.seek(0)
            lines = self._words.read(1 << 16).decode(errors="replace").strip().splitlines()
        return f" ({lines[-1].strip()[:200]})" if lines else ""

    @property
    def waits_for_disk(self) -> bool:
        """Whether a thread of it waits in the kernel, as for a disk that hangs: it cannot be ended then."""
        try:
            states = [task.joinpath("stat").read_text() for task in Path(f"/proc/{self.pid}/task").iterdir()]
        except OSError:
            return False
        return any(state.rpartition(")")[2].split()[:1] == ["D"] for state in states)

    def kill(self) -> None:
        """End it at once; what it said before can still be heard."""
        self._child.kill()

    def _send(self, data: bytes) -> None:
        try:
            with self._closing:
                self._requests.send_bytes(data)
        except OSError:
            # gone, or stopped by another thread: hearing tells
            return
