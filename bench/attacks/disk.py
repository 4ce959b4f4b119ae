"""A receiver that is held up: by a file system that is frozen, and by a stop signal."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.attacks.actors import rover, uav, vehicle_schedules
from bench.attacks.records import first_warning
from bench.attacks.report import AttackRow
from bench.attacks.run import Flown, Options, fly
from bench.attacks.stage import TRUE, PacketSchedule, SenderFactory, Stage
from bench.attacks.wire import ComponentEncoder
from bench.station import FlyingStation, family

IDS = tuple(range(11, 23))
FREEZES_S = ((4.0, 2.0), (9.0, 5.0), (16.0, 1.0))
"""When, and for how long, the file system is frozen."""
FLY_S = 22.0
STOPS_S = 2.0
IMAGE_BYTES = 256_000_000


def _lines(new_sender: SenderFactory) -> list[PacketSchedule]:
    found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
    for system_id in IDS:
        found += vehicle_schedules(rover(system_id), ComponentEncoder(system_id), new_sender())
    return found


def _judge(flown: Flown, attack: str, case: str) -> AttackRow:
    sent = sum(count for party, count in flown.sent.count.items() if party[0] == TRUE)
    found = sum(count for party, count in flown.recorded.items() if party[0] == TRUE)
    false = [event for event in flown.events if event.loud and "no heartbeat" in event.text]
    restarted = first_warning(flown.events, "started again")
    notes = [f"{len(false)} false 'no heartbeat'"] * bool(false)
    notes += ["the receiving process was replaced"] * bool(restarted)
    notes += [f"ends with {flown.exit_code}"] * (flown.exit_code != 0)
    return AttackRow(
        attack=attack, case=case, sent=sent, lost=sent - found, held=sent == found and not false, note="; ".join(notes)
    )


def frozen_disk(options: Options) -> list[AttackRow]:
    """A frozen file system under the recording (needs root): nothing is lost, no vehicle is reported silent."""
    tools = [shutil.which(name) for name in ("mkfs.ext4", "mount", "umount", "fsfreeze")]
    if sys.platform != "linux" or os.geteuid() != 0 or None in tools:
        return [AttackRow(attack="frozen disk", case="ext4", held=True, note="not played: needs root and mkfs.ext4")]
    with _mounted(options.folder / "image") as mount:
        flown = fly(options, "frozen", IDS, _lines, FLY_S, more=["--sessions", str(mount)], during=_freezing(mount))
        longest_s = max(length_s for _, length_s in FREEZES_S)
        return [_judge(flown, "frozen disk", f"ext4, {len(FREEZES_S)} times, up to {longest_s:.0f} s")]


@contextmanager
def _mounted(image: Path) -> Iterator[Path]:
    """An ext4 file system of its own in a file."""
    mount = image.with_name("mount")
    mount.mkdir()
    with image.open("wb") as file:
        file.truncate(IMAGE_BYTES)
    subprocess.run(["mkfs.ext4", "-q", image], check=True)
    subprocess.run(["mount", "-o", "loop", image, mount], check=True)
    try:
        yield mount
    finally:
        subprocess.run(["umount", mount], check=True)


def _freezing(mount: Path) -> Callable[[FlyingStation, Stage], None]:
    def during(station: FlyingStation, stage: Stage) -> None:
        for at_s, length_s in FREEZES_S:
            stage.wait(at_s)
            subprocess.run(["fsfreeze", "-f", mount], check=True)
            try:
                stage.wait(at_s + length_s)
            finally:
                subprocess.run(["fsfreeze", "-u", mount], check=True)

    return during


def stopped_processes(options: Options) -> list[AttackRow]:
    """SIGSTOP for two seconds, to the process that writes the log and to the one that folds: nothing is lost."""
    return [_stopped(options, "the receiving process", _writers), _stopped(options, "the station", lambda s: [s.pid])]


def _stopped(options: Options, case: str, processes_of: Callable[[FlyingStation], Sequence[int]]) -> AttackRow:
    def during(station: FlyingStation, stage: Stage) -> None:
        stage.wait(4.0)
        pids = processes_of(station)
        if not pids:
            raise RuntimeError("no process has the log open")
        try:
            _signal(pids, signal.SIGSTOP)
            stage.wait(4.0 + STOPS_S)
        finally:
            _signal(pids, signal.SIGCONT)

    return _judge(fly(options, f"stopped-{len(case)}", IDS, _lines, 10.0, during=during), "stopped process", case)


def _signal(pids: Sequence[int], number: signal.Signals) -> None:
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue  # replaced meanwhile


def _writers(station: FlyingStation) -> list[int]:
    """Children that have the telemetry log open."""
    found = []
    for pid in family(station.pid)[1:]:
        try:
            files = [os.readlink(each) for each in Path(f"/proc/{pid}/fd").iterdir()]  # noqa: PTH115
        except OSError:
            continue
        found += [pid] * any(name.endswith("telemetry.tlog") for name in files)
    return found
