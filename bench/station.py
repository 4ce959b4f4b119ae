"""A real ``gcs fly --headless`` in a process of its own."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from tests.support.command_line import GCS


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Sums over a process and all below it."""

    processes: int = 0
    rss_mb: float = 0.0
    """Memory held, shared pages counted once for each that maps them: a shared ring counts as it is first filled."""
    own_mb: float = 0.0
    """Part of it that is neither shared nor backed by a file: where leaks are."""
    cpu_s: float = 0.0
    """Processor time since the start, of those that still run."""
    threads: int = 0
    descriptors: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(**{name: getattr(self, name) + getattr(other, name) for name in self.__slots__})


def family(pid: int) -> list[int]:
    """A process and all below it; empty when it is gone."""
    with contextlib.suppress(psutil.Error):
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    return []


def cost_of(pid: int) -> Cost:
    """Cost of a process and all below it, now; zeros when it is gone."""
    return sum(map(_cost, family(pid)), Cost())


def _cost(pid: int) -> Cost:
    """Cost of one process; zeros when it is gone."""
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(pid)
        with process.oneshot():
            memory, times = process.memory_info(), process.cpu_times()
            return Cost(
                processes=1,
                rss_mb=memory.rss / 1e6,
                own_mb=(memory.rss - memory.shared) / 1e6,
                cpu_s=times.user + times.system,
                threads=process.num_threads(),
                descriptors=process.num_fds(),
            )
    return Cost()


CAMERA = "[camera]\nwidth = 1920\nheight = 1080\nfx = 1200.0\nfy = 1200.0\ncx = 960.0\ncy = 540.0\n"
START_S, END_S = 60.0, 60.0
"""Patience with a flight that begins, and with one that seals its recording."""
_BEGUN = re.compile(r"recording in (.*): stop with")


def mission_text(ugvs: Sequence[int], keys: str = "none") -> str:
    """A mission file for UAV 1 and these vehicles."""
    vehicles = "".join(f"[[ugv]]\nsystem_id = {i}\n" for i in ugvs)
    return f'[uav]\nsystem_id = 1\n{vehicles}[signing]\nkeys = "{keys}"\n{CAMERA}'


class FlyingStation:
    """Starts ``gcs fly`` and waits until it records.

    Args:
        folder: where the mission, the sessions and the output are kept.
        mission: text of the mission file.
        port: of the telemetry.
        more: further words of the command line.

    Attributes:
        pid: of the flight.
        session: folder of its recording.

    Raises:
        RuntimeError: it ended, or printed nothing for too long; it is ended then.
    """

    def __init__(self, folder: Path, mission: str, port: int, more: Sequence[str] = ()) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "mission.toml"
        file.write_text(mission)
        self._output_path = folder / "output.txt"
        words = [*GCS, "fly", str(file), "--headless", "-l", f"udpin:127.0.0.1:{port}", *more]
        # no key, no setting and no module of whoever runs this may take part
        home = {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"), "XDG_DATA_HOME": str(folder / "data")}
        with self._output_path.open("w") as output:
            self._process = subprocess.Popen(
                [*words, "--sessions", str(folder / "sessions")],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | home,
            )
        self.pid = self._process.pid
        try:
            self.session = self._wait_for_session(time.monotonic() + START_S)
        except BaseException:
            self.kill()
            raise

    @property
    def output(self) -> str:
        """All that it wrote to stdout and stderr."""
        return self._output_path.read_text(errors="replace")

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def end(self) -> int:
        """End it as an operator does; killed when that does not help. Returns the exit code."""
        if self.running:
            self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            return self.kill()

    def kill(self) -> int:
        """SIGKILL, to it and to what it had started."""
        for pid in family(self.pid)[::-1]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        return self._process.wait()

    def _wait_for_session(self, until_s: float) -> Path:
        while time.monotonic() < until_s:
            if found := _BEGUN.search(self.output):
                return Path(found[1])
            if not self.running:
                raise RuntimeError(f"the flight ended: {self.output.strip()[-400:]}")
            time.sleep(0.05)
        raise RuntimeError(f"the flight did not begin in time: {self.output.strip()[-400:]}")
