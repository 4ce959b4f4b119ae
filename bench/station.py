"""A real ``gcs fly --headless`` in a process of its own."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil


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


FLY = (sys.executable, "-c", "from gcs.cli.app import main; main()")
"""The ``gcs`` of this environment."""
CAMERA = "[camera]\nwidth = 1920\nheight = 1080\nfx = 1200.0\nfy = 1200.0\ncx = 960.0\ncy = 540.0\n"
START_S, END_S = 60.0, 60.0
"""Patience with a flight that begins, and with one that seals its recording."""
_BEGUN = re.compile(r"recording in (.*): stop with")


class StationError(RuntimeError):
    """The flight did not begin, with its output."""


def mission_text(ugvs: Sequence[int], keys: str = "none", more: str = "") -> str:
    """A mission file for UAV 1 and these vehicles."""
    vehicles = "".join(f"[[ugv]]\nsystem_id = {i}\n" for i in ugvs)
    return f'[uav]\nsystem_id = 1\n{vehicles}[signing]\nkeys = "{keys}"\n{more}'


class FlyingStation:
    """Starts the flight and waits until it records.

    Args:
        gcs: the command, as words.
        folder: where the mission, the sessions and the output are kept.
        mission: text of the mission file.
        links: of the telemetry.
        more: further words of the command line.
        patience_s: with its start.

    Attributes:
        pid: of the flight.
        ports: that it listens on.
        session: folder of its recording.
        start_s: how long the start took.

    Raises:
        StationError: it ended, or printed nothing for too long; it is ended then.
    """

    def __init__(
        self,
        gcs: Sequence[str],
        folder: Path,
        mission: str,
        links: Sequence[str],
        more: Sequence[str] = (),
        patience_s: float = START_S,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "mission.toml"
        file.write_text(mission)
        self._output_path = folder / f"output-{time.monotonic_ns()}.txt"
        words = [*gcs, "fly", str(file), "--headless", *more]
        words += [] if "--sessions" in more else ["--sessions", str(folder / "sessions")]
        words += [word for link in links for word in ("-l", link)]
        # no key, no setting and no module of whoever runs this may take part
        home = {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"), "XDG_DATA_HOME": str(folder / "data")}
        began_s = time.monotonic()
        with self._output_path.open("w") as output:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | home,
            )
        self.pid = self._process.pid
        self.ports = tuple(int(link.rpartition(":")[2]) for link in links if link.startswith(("udp", "tcp")))
        try:
            self.session = self._wait_for_session(began_s + patience_s)
        except BaseException:
            self.kill()
            raise
        self.start_s = time.monotonic() - began_s

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
                raise StationError(f"the flight ended: {self.output.strip()[-400:]}")
            time.sleep(0.05)
        raise StationError(f"the flight did not begin in time: {self.output.strip()[-400:]}")
