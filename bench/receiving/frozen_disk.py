"""A flight whose file system is frozen for a while: what is recorded, counted and reported.

    sudo .venv/bin/python -m bench.receiving.frozen_disk --write bench/results/frozen_disk.md

``gcs fly --headless`` records into an ext4 file system of its own, in a file, which ``fsfreeze`` stops in the middle of
the flight: every write waits in the kernel, as on a network disk that is away, and a process that waits there cannot
even be killed. Needs root, and changes nothing but that file system; ends with a message where that is not to be had.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.ports import free_port
from bench.process_tree import family
from bench.receiving.senders import send_fleet
from gcs.session.log import SessionLog

FLY = (sys.executable, "-c", "from gcs.cli.app import main; main()", "fly")
TOOLS = ("fsfreeze", "mkfs.ext4", "mount", "umount")
IMAGE_BYTES = 256 << 20
BEFORE_S, AFTER_S = 4.0, 4.0
"""Flown with a disk that is well."""
START_S, END_S = 60.0, 60.0
COLUMNS = (
    "stands still for",
    "sent",
    "in the log",
    "counted as recorded",
    "receivers replaced",
    "told after",
    "false alarms of silence",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FreezeCase:
    """One flight."""

    name: str
    frozen_s: float
    kill: bool = False
    """Whether the receiving process is killed half way through."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreezeResult:
    """What became of it."""

    sent: int
    logged: int
    """Different records in the log, by what each vehicle sent."""
    counted: int
    """Packets that the flight reports as recorded."""
    restarts: int
    silences: int
    """Alarms that a vehicle was silent; all sent all the time."""
    reported_after_s: float
    """From the stop to the alarm of it; NaN: never raised."""


@contextmanager
def disk(folder: Path) -> Iterator[Path]:
    """A mounted file system of its own."""
    image, place = folder / "disk.img", folder / "disk"
    with image.open("wb") as file:
        file.truncate(IMAGE_BYTES)
    place.mkdir()
    subprocess.run(["mkfs.ext4", "-q", image], check=True)
    subprocess.run(["mount", "-o", "loop", image, place], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


@contextmanager
def frozen(place: Path) -> Iterator[None]:
    """Nothing can be written to a file system."""
    subprocess.run(["fsfreeze", "-f", place], check=True)
    try:
        yield
    finally:
        subprocess.run(["fsfreeze", "-u", place], check=True)


def fly(case: FreezeCase, vehicles: int, rate: float) -> FreezeResult:
    """One flight."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="frozen-")))
        place = stack.enter_context(disk(folder))
        ugvs = "".join(f"[[ugv]]\nsystem_id = {k}\n" for k in range(2, vehicles + 1))
        (folder / "mission.toml").write_text(f"[uav]\nsystem_id = 1\n{ugvs}")
        port = free_port()
        words = [*FLY, folder / "mission.toml", "--headless", "--sessions", place / "sessions", "-l", str(port)]
        output = stack.enter_context((folder / "output.txt").open("w+"))
        flight = subprocess.Popen([*map(str, words)], stdout=output, stderr=subprocess.STDOUT)
        try:
            session = _session(place / "sessions", flight)
            spawn = multiprocessing.get_context("spawn")
            ours, theirs = spawn.Pipe()
            seconds = BEFORE_S + case.frozen_s + AFTER_S
            fleet = spawn.Process(target=send_fleet, args=(port, vehicles, rate, seconds, theirs))
            fleet.start()
            time.sleep(BEFORE_S)
            frozen_us = time.time_ns() // 1000
            with frozen(place):
                time.sleep(case.frozen_s / 2)
                if case.kill:
                    os.kill(_receiver(flight.pid), signal.SIGKILL)
                time.sleep(case.frozen_s / 2)
            fleet.join()
            time.sleep(2.0)
        finally:
            flight.send_signal(signal.SIGINT)
            flight.wait(END_S)
        return _result(session, sum(ours.recv()), frozen_us)


def _session(folder: Path, flight: subprocess.Popen[bytes]) -> Path:
    until_s = time.monotonic() + START_S
    while time.monotonic() < until_s and flight.poll() is None:
        if found := list(folder.glob("*/telemetry.tlog")):
            time.sleep(2.0)  # the second receiving process is there
            return found[0].parent
        time.sleep(0.1)
    raise RuntimeError("the flight did not begin")


def _receiver(flight: int) -> int:
    """The receiving process that works: of the two the older one."""
    words = {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in family(flight)}
    return min(pid for pid, line in words.items() if "mavlink.ingest" in line)


def _result(session: Path, sent: int, frozen_us: int) -> FreezeResult:
    events = [json.loads(line) for part in sorted(session.glob("events*.jsonl")) for line in part.open()]
    log = SessionLog(session / "telemetry.tlog")
    reported_us = [event["time_us"] for event in events if "the disk does not answer" in event["text"]]
    texts = Counter(event["text"] for event in events)
    return FreezeResult(
        sent=sent,
        logged=len(log),
        counted=tomllib.loads((session / "session.toml").read_text())["session"]["packets"],
        restarts=sum(count for text, count in texts.items() if "another process took over" in text),
        silences=sum(count for text, count in texts.items() if text.endswith("no heartbeat") and "over" not in text),
        reported_after_s=(reported_us[0] - frozen_us) * 1e-6 if reported_us else float("nan"),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.receiving.frozen_disk", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--rate", type=float, default=1000.0, help="packets a second of all vehicles")
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument(
        "--seconds", type=float, default=[5.0, 30.0], nargs="+", help="for which nothing can be written"
    )
    parser.add_argument("--write", type=Path, help="put the table into this file")
    chosen = parser.parse_args()
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if os.geteuid() or missing:
        print(f"skipped: needs root, to mount and to freeze{', and ' + ', '.join(missing) if missing else ''}")
        return
    cases = [FreezeCase(name=f"{s:g} s", frozen_s=s) for s in chosen.seconds]
    least_s = min(chosen.seconds)
    cases.append(FreezeCase(name=f"{least_s:g} s, receiver killed meanwhile", frozen_s=least_s, kill=True))
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for case in cases:
        r = fly(case, chosen.vehicles, chosen.rate)
        counts = f"{r.sent:,} | {r.logged:,} | {r.counted:,} | {r.restarts} | {r.reported_after_s:.1f} s | {r.silences}"
        lines.append(f"| {case.name} | {counts} |")
        print(lines[-1], flush=True)
    about = f"{chosen.vehicles} vehicles, {chosen.rate:,.0f} packets a second."
    title = "# A file system that is frozen in flight"
    text = "\n".join([title, "", f"`python -m bench.receiving.frozen_disk`: {about}", "", *lines])
    print(text)
    if chosen.write:
        chosen.write.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
